"""Code that nothing names never runs: files that happen to lie where a command is typed, or beside a plug-in."""

import json
import os
import subprocess
import sys

import numba
import numpy as np
import pytest
import yaml

import percuss
from fake_studies import TWO_BARS

# A file instead of each of these modules tells that it was imported, and fails.
THIRD_PARTY = {"matplotlib", "numba", "numpy", "pyarrow", "rich", "scipy", "typer", "xarray", "yaml"}
STRAY = """with open({sentinel!r}, "a") as file:
    file.write({name!r} + chr(10))
raise ImportError({name!r} + " is imported from the current folder")
"""
# The script that an installer writes, for several commands; it lies in the folder too, which Python puts on the path.
SCRIPT = """import sys
from percuss.__main__ import main
for words in sys.argv[1:]:
    sys.argv = [__file__, *words.split()]
    try:
        main()
    except SystemExit as done:
        if done.code:
            raise SystemExit(f"{words}: {done.code}")
"""
STUDY = {
    "percuss-study": 1,
    "title": "stiffness",
    "cases": ["case.yaml"],
    "methods": {"integrators": ["wu-predictor-corrector"], "contacts": ["bipenalty"]},
    "vary": {"method.contact.beta_s": [0.1, 0.2]},
}
COMMANDS = (
    "run case.yaml -o result.nc --plot result.png",
    "check case.yaml",
    "compare case.yaml --contact penalty,bipenalty",
    "study study.yaml --workers 2",
    "recommend case.yaml --error 50% --runs 10 --workers 2 --contact bipenalty",
    "stability case.yaml",
    "waves case.yaml",
    "report study.sqlite -o report.html",
    "verify result.nc",
    "plugins",
    "schema",
    "new soft --kind contact --single-file",
    "run soft.yaml",
    "verify --plugin soft.py",
)
# A plug-in that notes, in each process that imports it, the path and the environment that it finds there.
LAW = """import dataclasses, json, os, sys
from percuss import ContactLaw, LinearLaw

with open(f"seen-{os.getpid()}.json", "w") as file:
    json.dump([sys.path, os.environ.get("PYTHONSAFEPATH")], file)


@dataclasses.dataclass(frozen=True)
class Noting(ContactLaw):
    '''A regularised multiplier.

    Formula: ``lambda >= 0``, ``g_{n+1} + lambda / eps_s >= 0``, one of them zero.
    '''

    name = "noting"
    summary = "Multiplier with a compliance"
    references = ("Wriggers: Computational Contact Mechanics, Springer 2006",)
    guarantees = ("never pulls",)

    def bind(self, points, dt):
        return LinearLaw(at="end", sigma=1.0 / points.stiffness, active="all", sign=">= 0")
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with a case and a study."""
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(TWO_BARS), encoding="utf-8")
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(STUDY), encoding="utf-8")
    return tmp_path


def execute(folder, *words, **variables):
    environment = {**os.environ, **variables}
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, timeout=500, check=False
    )


@pytest.mark.parametrize(
    "commands", [COMMANDS[1:4:2], pytest.param(COMMANDS, marks=pytest.mark.deep)], ids=["a study", "every command"]
)
def test_commands_import_nothing_from_a_folder_full_of_shadows(folder, commands):
    sentinel = folder / "sentinel"
    for name in sorted({*sys.stdlib_module_names, *THIRD_PARTY, "sitecustomize", "usercustomize"} - {"__main__"}):
        (folder / f"{name}.py").write_text(STRAY.format(sentinel=str(sentinel), name=name), encoding="utf-8")
    (folder / "script").write_text(SCRIPT, encoding="utf-8")
    done = execute(folder, "script", *commands)
    assert not sentinel.exists(), sentinel.read_text(encoding="utf-8")
    assert done.returncode == 0, done.stderr


def test_every_command_is_among_them():
    from command_line import COMMAND

    assert {words.split()[0] for words in COMMANDS} == set(COMMAND.commands)


def test_workers_of_a_session_do_not_inherit_the_empty_entry_of_its_path(folder):
    """What they inherit is all else, the path of the user too; what a plug-in starts there has no path of ours."""
    (folder / "noting.py").write_text(LAW, encoding="utf-8")
    session = "import sys; sys.path.insert(0, ''); import percuss; percuss.study(STUDY)".replace(
        "STUDY", "'study.yaml', workers=2, plugins=['noting.py']"
    )
    done = execute(folder, "-P", "-c", session, PYTHONPATH=str(folder / "own"))
    assert done.returncode == 0, done.stderr
    seen = [json.loads(file.read_text(encoding="utf-8")) for file in folder.glob("seen-*.json")]
    assert sum("" in path for path, _ in seen) == 1  # that of the session
    for path, variable in seen:
        assert str(folder) not in path
        assert str(folder / "own") in path
        assert variable is None


def test_a_plug_in_takes_no_place(folder, monkeypatch):
    """A plug-in may be called like a module of Python."""
    monkeypatch.chdir(folder)
    (folder / "random.py").write_text(LAW, encoding="utf-8")
    before = sys.path.copy(), sys.modules["random"]
    percuss.load("case.yaml", {"method.contact": "noting"}, plugins=["random.py"])
    assert (sys.path, sys.modules["random"]) == before


def test_machine_code_is_loaded_from_no_folder_that_a_file_in_the_current_folder_names(tmp_path, monkeypatch):
    """numba reads `.numba_config.yaml` in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: here", encoding="utf-8")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "here")  # as it is once numba has read that file
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    assert percuss.compiled_function(twice)(np.ones(2)).sum() == 4.0
    assert list((tmp_path / "cache").rglob("*.nbi"))
    assert not (tmp_path / "here").exists()


def twice(values):
    return values + values
