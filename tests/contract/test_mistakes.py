"""One mistake of each kind in a plug-in: a run names it with file and line, and a study goes on.

The plug-ins are the templates of `percuss new` with one line put into one method.
"""

import ast
import json
import os
import re
import signal
import subprocess
import sys

import pytest

from command_line import percuss_command
from fake_studies import TWO_BARS
from percuss.cli.scaffold import new


def written(folder, method, line):
    """Write the template of a family with a line put into one method, and its case; return case and plug-in."""
    family, _, name = method.partition(".")
    files = new("my-method", family, folder).files
    (plugin,) = [path for path in files if path.suffix == ".py"]
    (case,) = [path for path in files if path.suffix == ".yaml" and ".study" not in path.suffixes]
    text = plugin.read_text()
    (place,) = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef) and node.name == name]
    lines = text.splitlines()
    at = place.body[1].lineno - 1  # behind the docstring
    lines.insert(at, " " * place.body[1].col_offset + line)
    lines.insert(1, "import numpy as np")
    plugin.write_text("\n".join(lines) + "\n")
    small = re.sub(r"elements: \d+", "elements: 3", case.read_text()).replace("end: 0.35", "end: 0.15")
    case.write_text(small.replace("[20, 5]", "[4, 2]").replace("end: 2.5", "end: 0.5"))
    return case, plugin


IN_A_RUN = {
    "an exit": ("contact.bind", "raise SystemExit(0)", "SystemExit: 0"),
    "an error": ("contact.bind", "raise RuntimeError('plan B')", "RuntimeError: plan B"),
    "not finite": ("load.amplitude", "return time * np.nan", "amplitude returned nan"),
    "a wrong shape": ("mass.nodal", "return element_mass", "nodal returned numbers of shape (3,), expected (4,)"),
    "another kind": ("shape.mesh", "return at", "mesh returned a ndarray of float64, expected a Mesh"),
    "nothing": ("contact.bind", "return None", "bind returned nothing, expected LinearLaw"),
    "writes": ("element.bind", "body.mesh.lengths[0] = 9.0", "bind changes an array that it was handed"),
    "a kernel writes": ("material.stress", "parameters[0] = 1.0", "assignment destination is read-only"),
}  # fmt: skip


@pytest.mark.parametrize("kind", IN_A_RUN)
def test_a_run_names_file_and_line(kind, tmp_path):
    method, line, said = IN_A_RUN[kind]
    case, plugin = written(tmp_path, method, line)
    done = percuss_command("run", case, "--json", "-o", "out.nc", cwd=tmp_path, plain=True)
    assert done.returncode == 2, done.stdout
    assert not (tmp_path / "out.nc").exists()
    assert len(done.stderr.splitlines()) == 1
    assert re.match(rf"error: {plugin}:\d+: ", done.stderr)
    assert said in done.stderr
    assert json.loads(done.stdout)["error"] in done.stderr


def test_what_a_plug_in_prints_is_no_part_of_the_output(tmp_path):
    case, _ = written(tmp_path, "mass.nodal", "print('HELLO')")
    done = percuss_command("run", case, "--json", cwd=tmp_path, plain=True)
    assert json.loads(done.stdout)["status"] == "done"
    assert "HELLO" in done.stderr


def test_a_crash_names_the_line_of_the_plug_in(tmp_path):
    (tmp_path / "far.py").write_text("\n__import__('ctypes').string_at(0)\n")
    command = [sys.executable, "-m", "percuss", "plugins", "--plugin", "far.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == -signal.SIGSEGV
    assert 'far.py", line 2' in done.stderr


CASE = {**TWO_BARS, "method": {"contact": "fated"}, "time": {"steps": 4, "courant": 0.5}}
FATES = """
import ctypes, os, signal, sys, time
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw


@dataclass(frozen=True)
class Fated(ContactLaw):
    '''A penalty with a fate.'''

    name = "fated"
    summary = "A penalty with a fate"
    fate: str = "none"

    def bind(self, points, dt):
        if self.fate == "raises":
            raise RuntimeError("plan B")
        if self.fate == "leaves":
            sys.exit(4)
        if self.fate == "exits":
            os._exit(3)
        if self.fate == "endless":
            while True: pass
        if self.fate == "crashes":
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.fate == "is killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.fate == "prints":
            os.write(1, b"HELLO")
            print("HELLO")
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)
"""


def line_of(text):
    return 1 + FATES[: FATES.index(text)].count("\n")


@pytest.mark.deep
def test_a_study_goes_on_whatever_a_plug_in_does(tmp_path):
    (tmp_path / "case.yaml").write_text(json.dumps(CASE))
    (tmp_path / "fates.py").write_text(FATES)
    fates = {
        "none": ("done", ""),
        "raises": ("failed", f"fates.py:{line_of('raise Run')}: RuntimeError: plan B"),
        "leaves": ("failed", f"fates.py:{line_of('sys.exit')}: SystemExit: 4"),
        "exits": ("lost", "its worker process ended with exit code 3, twice"),
        "endless": ("failed", "no result after 8 s (--longest)"),
        "crashes": ("lost", "its worker process was killed by SIGSEGV, twice"),
        "is killed": ("lost", "its worker process was killed by SIGKILL, twice"),
        "prints": ("done", ""),
    }
    study = {"percuss-study": 1, "cases": ["case.yaml"], "vary": {"method.contact.fate": [*fates]}}
    (tmp_path / "study.yaml").write_text(json.dumps(study))
    options = ["--plugin", "fates.py", "--json", "--workers", "2", "--longest", "8"]
    command = [sys.executable, "-m", "percuss", "study", "study.yaml", *options]
    plain = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=tmp_path, env=plain, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert f'fates.py", line {line_of("signal.SIGSEGV")}' in done.stderr
    rows = {row["method.contact.fate"]: row for row in json.loads(done.stdout)["rows"]}
    for fate, (status, reason) in fates.items():
        assert rows[fate]["status"] == status, rows[fate]
        assert reason in rows[fate]["reason"]
