"""Plug-ins with a misdeed: each is named with file and line, in a run and in a study, which goes on.

The plug-ins are the templates of `percuss new` with one line put into one method.
"""

import ast
import gc
import itertools
import json
import os
import re
import signal
import subprocess
import sys
import warnings

import numpy as np
import pytest

import percuss
from command_line import percuss_command
from fake_studies import TWO_BARS
from percuss.cli.scaffold import new

# The line that each misdeed puts at the beginning of a method, and what is said of it.
BIASED = "it keeps state between calls, draws random numbers or reads the clock"
DEEDS = {
    "raises": ("raise RuntimeError('plan B')", "RuntimeError: plan B"),
    "exits": ("sys.exit(3)", "a plug-in ends the process (3): raise an error instead"),
    "exits at once": ("os._exit(3)", "a plug-in ends the process (3): raise an error instead"),
    "keeps state": ("CALLS.append(1); bias = 1e-3 * len(CALLS)", BIASED),
    "draws at random": ("bias = np.random.rand()", BIASED),
    "reads the clock": ("bias = clock.perf_counter() % 1.0", BIASED),
}
# For each method: the family, what a bias is put in, and lines that give nan, a wrong shape, or write to an argument.
METHODS = {
    "contact.bind": (
        ("sigma=compliance", "sigma=compliance * (1.0 + bias)"),
        ("return LinearLaw(at='end', sigma=np.nan, active='all')", "LinearLaw.sigma is not finite"),
        ("return LinearLaw(at='end', sigma=np.ones(7), active='all')", "has shape (7,), expected (1,) or a number"),
        ("points.stiffness[0] = 0.0", "bind changes an array that it was handed"),
    ),
    "integrator.bind": (
        ("response=(0.0, 0.0, 1.0)", "response=(0.0, 0.0, 1.0 + bias)"),
        (
            "return LeapFrog(ContactState('predicted', 'predicted', 'none', (0.0, 0.0, np.nan)), end_of_step(dt))",
            "returned as the response of `explicit` nan at index 2",
        ),
        (
            "return LeapFrog(ContactState('predicted', 'predicted', 'none', (0.0, 1.0)), end_of_step(dt))",
            "numbers of shape (2,), expected (3,)",
        ),
        ("self.__dict__['order'] = 3", "bind changes the component itself"),
    ),
    "load.amplitude": (
        ("return self.peak *", "return (1.0 + bias) * self.peak *"),
        ("return time * np.nan", "amplitude returned nan at the time "),
        ("return np.ones(3)", "amplitude returned numbers of shape (3,)"),
        ("time[...] = 0.0", "amplitude changes an array that it was handed"),
    ),
    "material.stress": (
        ("] * strain", "] * strain * (1.0 + bias)"),
        ("return np.nan", "stress gave nan, expected finite numbers"),
        ("return parameters", "expected one number"),
        ("parameters[0] = 1.0", "stress changes what it was handed to read"),
    ),
    "element.internal_force": (
        ("axial = ", "axial = (1.0 + bias) * "),
        ("force[:] = np.nan; return", "internal_force gave [nan nan], expected finite numbers"),
        ("force[:] = np.ones(3)", "could not broadcast"),
        ("displacement[0] = 1.0", "internal_force changes what it was handed to read"),
    ),
    "element.bind": (
        ("np.full(h.size, body.section)", "np.full(h.size, body.section * (1.0 + bias))"),
        ("return MyMethodArrays(*[body.mesh.lengths * np.nan] * 3)", "bind returned as `length` nan at index 0"),
        ("return body.mesh.lengths", "bind returned a ndarray of float64, expected a NamedTuple"),
        ("body.mesh.lengths[0] = 9.0", "bind changes an array that it was handed"),
    ),
    "solid-material.stress_2d": (
        ("return xx * s_xx", "return (1.0 + bias) * xx * s_xx"),
        ("return np.nan, 0.0, 0.0, 0.0", "stress_2d gave (nan, 0.0, 0.0, 0.0), expected finite numbers"),
        ("return parameters", "expected 4 numbers"),
        ("parameters[0] = 1.0", "stress_2d changes what it was handed to read"),
    ),
    "solid-material.stored_2d": (
        ("squares = ", "squares = bias + "),
        ("return np.nan", "stored_2d gave nan, expected finite numbers"),
        ("return parameters", "expected one number"),
        ("gradient[0] = 1.0", "stored_2d changes what it was handed to read"),
    ),
    "solid-element.force": (
        ("volume = 0.5", "volume = 0.5 * (1.0 + bias)"),
        ("force[:] = np.nan; return", "force gave [nan nan nan nan nan nan], expected finite numbers"),
        ("force[:] = np.ones(7)", "could not broadcast"),
        ("displacement[0, 0] = 1.0", "force changes what it was handed to read"),
    ),
    "solid-element.volumes": (
        ("volumes: Floats = 0.5", "volumes: Floats = 0.5 * (1.0 + bias)"),
        ("return np.full((len(body.mesh.cells[self.cell]), 1), np.nan)", "volumes returned nan at index 0, 0"),
        ("return np.ones(3)", "volumes returned numbers of shape (3,)"),
        ("body.mesh.nodes[0] = 9.0", "volumes changes an array that it was handed"),
    ),
    "pairing.points": (
        ("gap = -(apart", "gap = bias - (apart"),
        (
            "first = first._replace(positions=first.positions * np.nan)",
            "points returned as `gap` nan at index 0",
        ),
        ("return np.ones(3)", "points returned a ndarray of float64, expected percuss.PairedPoints"),
        ("first.areas[0] = 9.0", "points changes an array that it was handed"),
    ),
    "mass.nodal": (
        ("at_nodes(element_mass)", "at_nodes(element_mass) * (1.0 + bias)"),
        ("return np.append(element_mass, np.nan)", "nodal returned nan at index 3"),
        ("return element_mass", "nodal returned numbers of shape (3,), expected (4,)"),
        ("element_mass[0] = 9.0", "nodal changes an array that it was handed"),
    ),
    "shape.mesh": (
        ("0.5 * self.length / count", "0.5 * self.length / count * (1.0 + bias)"),
        ("at = at * np.nan", "mesh returned as `nodes` nan at index 0"),
        ("return at", "mesh returned a ndarray of float64, expected a Mesh"),
        ("at[0] = 9.0", "mesh changes an array that it was handed"),
    ),
    "solution.solve": (
        ("Rebound(problem, end)", "Rebound(problem, end * (1.0 - bias))"),
        ("end = np.nan", "reached the time nan"),
        ("return np.ones(3)", "solve returned a ndarray of float64, expected an Exact"),
        ("problem.bodies.clear()", "AttributeError: 'mappingproxy' object"),
    ),
    "measure.of": (
        ("float(i**2 / s)", "float(i**2 / s) * (1.0 + bias)"),
        ("return float('nan')", "of returned nan at index 0; None says that there is no number"),
        ("return np.ones(3)", "of returned numbers of shape (3,), expected ()"),
        ("result.histories['contact_force'].values[0] = 1.0", "of changes an array that it was handed"),
    ),
}
OWN = ("gives nan", "has the wrong shape", "writes its inputs")
ENDS, BIASES = list(DEEDS)[:3], list(DEEDS)[3:]
# Each method and each misdeed once: the others are the same few lines of code, asked in another order.
QUICK = {
    ("contact.bind", "keeps state"), ("contact.bind", "exits at once"), ("integrator.bind", "has the wrong shape"),
    ("load.amplitude", "gives nan"), ("load.amplitude", "draws at random"), ("material.stress", "writes its inputs"),
    ("element.internal_force", "exits"), ("element.bind", "writes its inputs"), ("mass.nodal", "has the wrong shape"),
    ("shape.mesh", "reads the clock"),
}  # fmt: skip
# Each method with its own misdeeds, and with an end and a bias in turn.
ALL = [
    (method, deed)
    for k, method in enumerate(METHODS)
    for deed in (*DEEDS, *OWN)
    if deed in (ENDS[k % 3], BIASES[k % 3], *OWN) or (method, deed) in QUICK
]


def written(folder, method, deed):
    """Write the template of a family with a misdeed and its case; return case, plug-in and what is said."""
    family, _, name = method.partition(".")
    bias, *own = METHODS[method]
    line, said = DEEDS[deed] if deed in DEEDS else own[OWN.index(deed)]
    files = new("my-method", family, folder, single_file=True).files
    (plugin,) = [path for path in files if path.suffix == ".py"]
    (case,) = [path for path in files if path.suffix == ".yaml" and ".study" not in path.suffixes]
    text = plugin.read_text()
    if said == BIASED:
        assert bias[0] in text
        text = text.replace(*bias)
    (place,) = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef) and node.name == name]
    lines = text.splitlines()
    at = place.body[1].lineno - 1  # behind the docstring
    lines.insert(at, " " * place.body[1].col_offset + line)
    lines.insert(1, "import os, sys\nimport time as clock\nimport numpy as np\nCALLS = []\nbias = 0.0")
    plugin.write_text("\n".join(lines) + "\n")
    small = re.sub(r"elements: \d+", "elements: 3", case.read_text()).replace("end: 0.35", "end: 0.15")
    small = small.replace("[20, 5]", "[4, 2]").replace("end: 2.5", "end: 0.5")
    case.write_text(small)
    return case, plugin, said


@pytest.mark.parametrize(
    ("method", "deed"),
    [
        pytest.param(*each, marks=() if each in QUICK else pytest.mark.deep)
        for each in ALL
        if each[0] != "measure.of" and not each[0].startswith("solution")
    ],
)
def test_a_misdeed_is_named_with_file_and_line(method, deed, tmp_path):
    case, plugin, said = written(tmp_path, method, deed)
    done = percuss_command("run", case, "--json", cwd=tmp_path, plain=True)
    assert done.returncode == 2, done.stdout
    assert len(done.stderr.splitlines()) == 1
    assert re.match(rf"error: {plugin}:\d+: ", done.stderr)
    assert said in done.stderr
    assert json.loads(done.stdout)["error"] in done.stderr


@pytest.mark.deep
@pytest.mark.parametrize("deed", [*DEEDS, *OWN])
@pytest.mark.parametrize("method", ["solution.solve", "measure.of"])
def test_a_misdeed_of_what_looks_at_a_run_fails_its_row(method, deed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    case, plugin, said = written(tmp_path, method, deed)
    measure = ["my-method" if method == "measure.of" else "steps"]
    workers = 2 if deed == "exits at once" else 1  # which makes the runs in this process
    study = {"percuss-study": 1, "cases": [str(case)], "measure": measure}
    made = percuss.study(study, workers=workers, plugins=[plugin])
    (row,) = made.as_records()
    assert row["status"] == "failed"
    assert f"{plugin}:" in row["reason"]
    assert said in row["reason"]


# What a plug-in does in one line, and what is said of it beside file and line.
FAR = {
    "a generator's exit": ("raise GeneratorExit('g')", "GeneratorExit: g"),
    "an interrupt": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "a cancellation": ("raise asyncio.CancelledError", "CancelledError"),
    "its own": ("raise type('Own', (BaseException,), {})('mine')", "Own: mine"),
    "a group": (
        "raise BaseExceptionGroup('many', [KeyboardInterrupt()])",
        "BaseExceptionGroup: many (1 sub-exception)",
    ),
    "an end of iteration": ("raise StopIteration", "StopIteration"),
    "no text": (
        "raise type('Mute', (Exception,), {'__str__': lambda self: 1 / 0})",
        "Mute: its text cannot be shown (ZeroDivisionError)",
    ),
    "a wrong input": ("raise percuss.InputError('x')", "InputError: x"),
    "a stop of a run": ("raise percuss.RunError('x')", "RunError: x"),
    "aborts": ("os.abort()", "a plug-in ends the process (None): raise an error instead"),
    "closes files": (
        "os.closerange(0, 256)",
        "os.closerange closes file 0, which percuss needs",
    ),
    "closes a stream": ("os.close(2)", "os.close closes file 2, which percuss needs"),
    "overwrites numpy": ("np.zeros = np.ones", "overwrites numpy.zeros, which others use too"),
    "overwrites Python": ("builtins.len = lambda it: 1", "overwrites builtins.len, which others use too"),
    "overwrites a class": ("percuss.ContactLaw.refuses = None", "overwrites ContactLaw.refuses, which others use too"),
}
QUICK_FAR = {
    ("at_import", "an interrupt"), ("at_import", "overwrites numpy"), ("at_options", "a generator's exit"),
    ("at_options", "overwrites Python"), ("at_bind", "an interrupt"), ("at_bind", "no text"),
    ("at_bind", "closes files"), ("at_bind", "overwrites a class"), ("at_bind", "a stop of a run"),
}  # fmt: skip
LATER = ("its own", "a group", "an end of iteration", "no text", "a wrong input", "overwrites Python")
FAR_PLUGIN = """
import asyncio, builtins, gc, math, os, sys
import numpy as np
import percuss
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw
{at_import}

@dataclass(frozen=True)
class Far(ContactLaw):
    '''A penalty.'''

    name = "far"
    summary = "A penalty"

    def __post_init__(self):
        {at_options}

    def bind(self, points, dt):
        {at_bind}
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)
"""
PLACES = ("at_import", "at_options", "at_bind")
FAR_CASE = {**TWO_BARS, "method": {"contact": "penalty"}, "time": {"steps": 4, "courant": 0.5}}


@pytest.fixture
def far(tmp_path, monkeypatch):
    """Return a function that writes a plug-in with a line at a place, and that returns file and line of it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("numba.config.DISABLE_JIT", True)
    (tmp_path / "case.yaml").write_text(json.dumps(FAR_CASE))

    def write(place, line):
        text = FAR_PLUGIN.format(**{**dict.fromkeys(PLACES, "pass"), place: line})
        (tmp_path / "far.py").write_text(text)
        return f"far.py:{1 + text.partition(line)[0].count(chr(10))}: "

    return write


@pytest.mark.parametrize(
    ("place", "deed"),
    [
        pytest.param(place, deed, marks=() if (place, deed) in QUICK_FAR else pytest.mark.deep)
        for place, deed in itertools.product(PLACES, FAR)
    ],
)
def test_a_plug_in_that_goes_far_is_named(far, place, deed):
    line, said = FAR[deed]
    said = "SystemExit" if (place, deed) == ("at_import", "aborts") else said
    where = far(place, line)
    done = percuss_command("run", "case.yaml", "--plugin", "far.py", "--set", "method.contact=far")
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert f"{where}{said}" in done.stderr
    assert "Traceback" not in done.stderr
    assert (np.zeros(1), len([])) == (0.0, 0)


@pytest.mark.parametrize(
    "deed", ["an interrupt", "overwrites numpy", *(pytest.param(deed, marks=pytest.mark.deep) for deed in LATER)]
)
def test_a_plug_in_that_goes_far_costs_its_own_runs_alone(far, deed):
    line, said = FAR[deed]
    where = far("at_bind", line)
    study = {"percuss-study": 1, "cases": ["case.yaml"], "methods": {"contacts": ["far", "penalty"]}}
    bad, good = percuss.study(study, workers=1, plugins=["far.py"]).as_records()
    assert (bad["status"], good["status"]) == ("failed", "done")
    assert f"{where}{said}" in bad["reason"]


def test_a_measure_that_goes_far_costs_its_own_runs_alone(far, tmp_path):
    far("at_bind", "pass")
    measure = "@dataclass(frozen=True)\nclass M(percuss.Measure):\n    'm'\n    name = 'm'\n    summary = 'm'\n"
    with (tmp_path / "far.py").open("a") as file:
        file.write(f"\n\n{measure}    def of(self, result):\n        raise GeneratorExit\n")
    study = {"percuss-study": 1, "cases": ["case.yaml"], "measure": ["m"]}
    (row,) = percuss.study(study, workers=1, plugins=["far.py"]).as_records()
    assert row["status"] == "failed"
    assert re.search(r"measure m: .*far\.py:\d+: GeneratorExit", row["reason"])


CHANGES = {
    "errors of numpy": ("np.seterr(all='raise')", np.geterr),
    "garbage": ("gc.disable()", gc.isenabled),
    "folder": ("os.chdir('/')", os.getcwd),
    "switches": ("sys.setswitchinterval(1.0)", sys.getswitchinterval),
    "warnings": ("__import__('warnings').simplefilter('error')", lambda: warnings.filters[:]),
    "Ctrl-C": ("__import__('signal').signal(2, lambda *_: None)", lambda: signal.getsignal(signal.SIGINT)),
}


@pytest.mark.parametrize("place", ["at_bind", pytest.param("at_import", marks=pytest.mark.deep)])
@pytest.mark.parametrize("change", CHANGES)
def test_what_a_plug_in_changes_for_others_is_put_back(far, place, change):
    line, state = CHANGES[change]
    far(place, line)
    before = state()
    percuss.run(percuss.load({**FAR_CASE, "method": {"contact": "far"}}, plugins=["far.py"]))
    assert state() == before


NO_NUMBERS = {"an object": "object", "a complex number": "complex", "a text": "str", "more digits": "np.longdouble"}


@pytest.mark.parametrize("kind", NO_NUMBERS)
def test_what_is_no_real_number_is_told_at_the_plug_in(far, kind):
    far("at_bind", f"return LinearLaw(at='explicit', sigma=np.ones(1).astype({NO_NUMBERS[kind]}))")
    case = percuss.load({**FAR_CASE, "method": {"contact": "far"}}, plugins=["far.py"])
    with pytest.raises(percuss.PluginError, match=r"far\.py:\d+: contact law far: .*, expected (real )?numbers"):
        percuss.run(case)


def test_a_crash_names_the_line_of_the_plug_in(far, tmp_path):
    where = far("at_import", "__import__('ctypes').string_at(0)")
    command = [sys.executable, "-m", "percuss", "plugins", "--plugin", "far.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == -signal.SIGSEGV
    assert f'far.py", line {where.split(":")[1]}' in done.stderr


def test_an_error_that_nothing_catches_is_one_line(far, tmp_path):
    at_bind = "t = __import__('threading').Thread(target=lambda: 1 / 0); t.start(); t.join()"
    where = far("at_bind", at_bind)
    command = [
        sys.executable,
        "-m",
        "percuss",
        "check",
        "case.yaml",
        "--plugin",
        "far.py",
        "--set",
        "method.contact=far",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    (line,) = [line for line in done.stderr.splitlines() if "ZeroDivisionError" in line]
    assert f"{where}ZeroDivisionError: division by zero; nothing catches it here" in line
    assert "Traceback" not in done.stderr


def test_what_a_plug_in_prints_is_no_part_of_the_output(tmp_path):
    case, plugin, _ = written(tmp_path, "mass.nodal", "raises")
    plugin.write_text(plugin.read_text().replace("raise RuntimeError('plan B')", "print('HELLO')"))
    done = percuss_command("run", case, "--json", cwd=tmp_path, plain=True)
    assert json.loads(done.stdout)["status"] == "done"
    assert re.search(rf"note: {plugin}:\d+ prints to standard output, which is for results", done.stderr)
    assert done.stderr.count("note: ") == 1
    assert done.stderr.count("HELLO") >= 1


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
    case, *_ = written(tmp_path, "mass.nodal", "raises")
    text = case.read_text().replace("plugins: [my_method.py]\n", "").replace("mass: my-method", "")
    case.write_text(text.replace("contact: bipenalty", "contact: fated"))
    (tmp_path / "fates.py").write_text(FATES)
    fates = {
        "none": ("done", ""),
        "raises": ("failed", f"fates.py:{line_of('raise Run')}: RuntimeError: plan B"),
        "exits": ("failed", f"fates.py:{line_of('os._exit')}: a plug-in ends the process (3)"),
        "endless": ("failed", f"fates.py:{line_of('while')}: no step was completed for 8 s (`stalled_after`"),
        "crashes": ("failed", f"fates.py:{line_of('os.kill')}: its worker process died 3 times here: Segmentation"),
        "is killed": ("lost", "its worker process died 3 times"),
        "prints": ("done", ""),
    }
    study = {"percuss-study": 1, "cases": [case.name], "stalled_after": 8, "vary": {"method.contact.fate": [*fates]}}
    (tmp_path / "study.yaml").write_text(json.dumps(study))
    options = ["--plugin", "fates.py", "--json", "--workers", "2"]
    command = [sys.executable, "-m", "percuss", "study", "study.yaml", *options]
    plain = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=tmp_path, env=plain, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    rows = {row["method.contact.fate"]: row for row in json.loads(done.stdout)["rows"]}
    for fate, (status, reason) in fates.items():
        assert rows[fate]["status"] == status, rows[fate]
        assert reason in rows[fate]["reason"]
