"""Kernels bound, compiled and stored by numba: the same numbers, no second compilation, no stale code.

A compiled kernel that does not see an edit is a wrong number that looks right.
"""

import ctypes
import json
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba import types

import percuss
import percuss_methods
from marks import deep
from percuss import cache, jit
from percuss import digest as sources
from percuss.jit import Binder, compiled_function, jit_disabled, plain
from percuss.step import build
from percuss.step.linked import Block, CannotLink, at
from strategies import REGISTRY, hunek

# -------------------------------------------------------------------------------------------------- blocks of memory


class Inner(NamedTuple):
    flag: bool
    table: np.ndarray
    small: np.int8


class Data(NamedTuple):
    inner: Inner
    single: np.float32
    column: np.ndarray
    nothing: tuple[()]
    mixed: tuple[np.float32, tuple[complex, int]]
    last: np.int16


def weighed(data):
    """Return a number to which every part of the data contributes with a weight of its own."""
    inner, (first, (phase, whole)) = data.inner, data.mixed
    total = 3.0 * inner.small + 5.0 * data.single + 13.0 * first + 17.0 * whole + 23.0 * data.last
    total += 227.0 * phase.real + 229.0 * phase.imag + (7.0 if inner.flag else 0.0)
    for i in range(inner.table.shape[0]):
        for j in range(inner.table.shape[1]):
            total += (31.0 + 3 * i + j) * inner.table[i, j]
    for i in range(data.column.size):
        total += (101.0 + i) * data.column[i]
    return total


@pytest.mark.parametrize("flag", [True, False])
def test_compiled_code_reads_from_a_block_what_was_put_into_it(flag):
    column = np.arange(12.0).reshape(4, 3)[:, 1]
    column.flags.writeable = False
    inner = Inner(flag, np.array([[1.5, -2.0], [0.25, 8.0]]), np.int8(-3))
    data = Data(inner, np.float32(1.25), column, (), (np.float32(0.5), (2.0 - 3.0j, -5)), np.int16(-300))
    helper = numba.njit(weighed)
    read = numba.cfunc(types.float64(types.CPointer(numba.typeof(data))))(lambda place: helper(at(place)))
    function = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p)(read.address)
    assert function(Block(data).address) == weighed(data)


def test_other_values_are_refused():
    masked = np.ma.array([1.0, 2.0], mask=[True, False])
    for value in ("a text", None, [1.0], (1.0, {"a": 1}), np.longdouble(1.0), 2**63, -(2**63) - 1, masked):
        with pytest.raises(CannotLink, match=r"not an? "):
            Block((1.0, value))


# ----------------------------------------------------------------------------------------- kernels of plug-ins in runs

LAW = """
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
from percuss import ContactLaw

class Bound(NamedTuple):
    stiffness: np.ndarray
    mode: float

@dataclass(frozen=True)
class Spring(ContactLaw):
    \"\"\"A penalty as a kernel.\"\"\"

    name = "spring"
    summary = "Penalty as a kernel"

    def bind(self, points, dt):
        return Bound(0.25 * points.stiffness, 1.0)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = bound.mode * bound.stiffness[p] * max(-trial.gap[p], 0.0)
"""


@pytest.mark.slow
def test_a_law_whose_data_compiled_code_cannot_read_runs_in_python_and_says_why(tmp_path):
    file = tmp_path / "law.py"
    file.write_text(LAW.replace(", 1.0)", ', "plain")').replace("bound.mode * ", ""))
    runs = {}
    for law in ("spring", {"name": "penalty", "beta_s": 0.25}):
        case = percuss.load(hunek(6, integrator="central-difference", contact=law, end=0.1), plugins=[file])
        runs[str(law)] = percuss.run(case)
    result, truth = runs.values()
    assert result.summary["compiled"] is False
    assert "not a str" in result.summary["compiled_why"][0]
    assert truth.summary["compiled"] is True
    peak = truth.arrays["contact_force"].max()
    assert np.abs(result.arrays["contact_force"] - truth.arrays["contact_force"]).max() < 1e-12 * peak


@pytest.mark.deep
@pytest.mark.slow
@pytest.mark.parametrize("says_so", [True, False], ids=["says so", "does not"])
def test_a_law_that_allocates_arrays_is_compiled(tmp_path, says_so):
    """One that does not say so is compiled once more, and counts references from then on."""
    text = LAW[: LAW.index("for p in range")] + "multiplier[:] = bound.stiffness * np.maximum(-trial.gap, 0.0)\n"
    text = text.replace('    name = "spring"\n', f'    name = "spring"\n    allocates = {says_so}\n')
    file = tmp_path / "law.py"
    file.write_text(text)
    before = set(build._ALLOCATING)
    case = hunek(6, integrator="central-difference", contact="spring", end=0.1)
    result = percuss.run(percuss.load(case, plugins=[file]))
    assert result.summary["compiled"], result.summary["compiled_why"]
    assert len(build._ALLOCATING - before) == (not says_so)


# ------------------------------------------------------------------------------------------------------ bound functions

SCALE = 2.0


def doubled(x):
    return SCALE * x


def closed(factor):
    def times(x):
        return factor * doubled(x)

    return times


def digest(function, slots=()):
    return Binder(dict(slots)).bind(function).digest


def given(text, **names):
    """A function named `f` from a text, with global variables; it lies in no file."""
    variables = {"__name__": "__console__", **names}
    exec(text, variables)
    return variables["f"]


def test_what_a_function_reads_is_in_its_digest(monkeypatch):
    first = digest(doubled)
    assert digest(doubled) == first
    assert digest(closed(2.0)) == digest(closed(2.0)) != digest(closed(3.0))
    monkeypatch.setitem(globals(), "SCALE", 3.0)
    assert digest(doubled) != first
    text = "def f(x):\n    return h.C * A[1] * T[0] * x\n"
    module = type(sys)("helpers")
    module.C = 1.0
    read = {"h": module, "A": np.array([1.0, 2.0]), "T": (1.0, 2)}
    found = {digest(given(text, **read))}
    found |= {digest(given(text, **{**read, **other})) for other in ({"A": np.array([1.0, 3.0])}, {"T": (2.0, 2)})}
    module.C = 2.0
    found.add(digest(given(text, **read)))
    found.add(digest(given(text.replace("T[0]", "T[1]"), **read)))
    found.add(digest(given(text.replace("(x)", "(x, y=1)"), **read)))
    assert len(found) == 6


def product_sum(values):
    total = 0.0
    for i in range(values.size):
        total += doubled(values[i]) * values[i]
    return total


@pytest.mark.parametrize("first", [{"forceinline": True}, {"fastmath": {"reassoc": True, "nsz": True}}, {}])
def test_a_function_has_the_same_options_whoever_calls_it_first(first):
    """Numba gives a function what it lacks from the first caller: numbers would hang on what was compiled before."""
    binder = Binder({})
    caller = binder.bind(product_sum, first)
    assert numba.njit(**jit_options(caller))(caller.value)(np.ones(3)) == 6.0
    options = binder.callee(doubled).value.targetoptions
    assert (options["fastmath"], options["forceinline"], options["error_model"]) == (False, True, "numpy")
    assert Binder({}, inline={}).callee(doubled).value.targetoptions["forceinline"] is False
    assert Binder({}).callee(jit.called(lambda x: x)).value.targetoptions["forceinline"] is False


def jit_options(bound):
    return {name: value for name, value in bound.options.items() if name not in jit.UNDOCUMENTED}


def test_a_kernel_without_a_file_is_compiled_and_not_stored(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    text = "def f(x):\n    return C * x\n"
    assert compiled_function(given(text, C=2.0))(3.0) == 6.0
    assert compiled_function(given(text, C=4.0))(3.0) == 12.0
    assert not list(tmp_path.rglob("*.nb?"))


def slot(x):
    raise NotImplementedError


def calls_slot(x, offset=1.0):
    return slot(x) + offset


@numba.njit(fastmath=True)
def jitted(x):
    return doubled(x)


@pytest.mark.parametrize("fill", [doubled, jitted, closed(0.5)], ids=["plain", "jitted", "closure"])
def test_a_slot_is_filled_in_compiled_code_as_in_python(fill):
    truth = plain(calls_slot, {slot: fill})
    assert truth(3.0) == (13.0 if fill.__name__ == "times" else 7.0) - (9.0 if fill.__name__ == "times" else 0.0)
    function = compiled_function(calls_slot, {slot: fill})
    assert function(3.0) == truth(3.0)
    assert function(x=3.0, offset=2.0) == truth(3.0, 2.0)


@pytest.fixture
def afresh(monkeypatch, loop_anew):
    """A process that has compiled nothing, and finds nothing on disk."""
    monkeypatch.setattr(jit, "cache_folder", lambda: None)
    for memory in ("_CALLEES", "_ENTRIES"):
        monkeypatch.setattr(jit, memory, {})
    monkeypatch.setattr(jit, "_UNKNOWN", set())
    return loop_anew


def test_an_option_that_numba_does_not_know_is_left_out(afresh, monkeypatch):
    options_of = Binder._options
    monkeypatch.setattr(Binder, "_options", lambda *one, **more: {**options_of(*one, **more), "no_such_option": True})
    monkeypatch.setattr(jit, "UNDOCUMENTED", jit.UNDOCUMENTED | {"no_such_option"})
    assert compiled_function(calls_slot, {slot: doubled})(3.0) == 7.0
    assert {"no_such_option"} == jit._UNKNOWN


@pytest.mark.parametrize(
    "integrator", [deep("central-difference"), pytest.param("noh-bathe", marks=pytest.mark.nightly)]
)
def test_without_undocumented_options_the_numbers_are_the_same(integrator, afresh):
    case = percuss.load(hunek(8, integrator=integrator, contact="penalty", end=0.5))
    jit._UNKNOWN.update(jit.UNDOCUMENTED)
    plainly = percuss.run(case)
    assert plainly.summary["compiled"], plainly.summary["compiled_why"]
    for memory in (jit._CALLEES, jit._ENTRIES, jit._UNKNOWN):
        memory.clear()
    afresh()
    for name, array in percuss.run(case).arrays.items():
        # The compiler may add the terms of an energy in another order.
        near = {"rtol": 1e-13, "atol": 1e-13 * np.abs(array).max(initial=0.0)} if "energy" in name else {"rtol": 0.0}
        np.testing.assert_allclose(plainly.arrays[name], array, err_msg=name, **near)


# --------------------------------------------------------------------------------------------------- stored, and stale

HELPERS = "def pushed(stiffness, gap):\n    return 1.0 * stiffness * max(-gap, 0.0)\n"
RUN = """
import json, sys, percuss
result = percuss.run(percuss.load(json.loads(sys.argv[1])))
print(json.dumps([result.summary["compiled"], result.arrays["contact_force"].max()]))
"""
CALL = """
import numpy as np
from percuss.jit import compiled_function
from percuss.step import bulk
print(compiled_function(bulk.kinetic)(np.ones(3), np.ones(3)))
"""


def in_a_process(folder, code, *arguments, **environment):
    """What a program prints in a process of its own, with a cache folder of its own, and the files there afterwards."""
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    given = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": path, **environment}
    given["PYTHONDONTWRITEBYTECODE"] = "1"  # bytecode does not see an edit within the same second
    given.pop("NUMBA_DISABLE_JIT", None)
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=given)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), set((folder / "cache").rglob("*.nb?"))


@pytest.mark.deep
def test_a_second_process_compiles_nothing_until_a_file_of_the_method_is_edited(tmp_path):
    package = tmp_path / "theirs"
    package.mkdir()
    (package / "__init__.py").write_text("")
    called = LAW.replace("bound.stiffness[p] * max(-trial.gap[p], 0.0)", "pushed(bound.stiffness[p], trial.gap[p])")
    (package / "law.py").write_text(f"from theirs.helpers import pushed\n{called}")
    (package / "helpers.py").write_text(HELPERS)
    info = tmp_path / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[percuss]\nmethods = theirs\n")
    case = json.dumps(hunek(10, integrator="central-difference", contact="spring", end=0.3))
    (compiled, first), stored = in_a_process(tmp_path, RUN, case)
    assert compiled
    assert stored
    assert in_a_process(tmp_path, RUN, case) == ([True, first], stored)
    (package / "helpers.py").write_text(HELPERS.replace("1.0 *", "2.0 *"))
    (compiled, force), files = in_a_process(tmp_path, RUN, case)
    assert compiled
    assert first * 1.1 < force < 2.0 * first
    assert files > stored
    assert len(files - stored) == 2  # of the law alone, an index and a file of machine code


@pytest.mark.deep
@pytest.mark.slow
def test_an_edited_kernel_of_percuss_is_seen_by_the_next_process(tmp_path):
    for package in (percuss, percuss_methods):
        folder = Path(package.__file__).parent
        shutil.copytree(folder, tmp_path / folder.name, ignore=shutil.ignore_patterns("__pycache__"))
    first, stored = in_a_process(tmp_path, CALL)
    assert first == 1.5
    assert in_a_process(tmp_path, CALL) == (first, stored)
    kernels = tmp_path / "percuss" / "step" / "bulk.py"
    kernels.write_text(kernels.read_text().replace("return 0.5 * total", "return 5.0 * total"))
    assert in_a_process(tmp_path, CALL)[0] == 15.0


def test_the_cache_folder_is_for_its_user_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "own"))
    assert cache.cache_folder() == tmp_path / "own" / "percuss"
    assert os.name != "posix" or stat.S_IMODE(cache.cache_folder().stat().st_mode) == 0o700
    (tmp_path / "file").write_text("in its place")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    assert cache.cache_folder() is None


@pytest.mark.parametrize("folder", ["missing", "read-only", "damaged"])
def test_any_cache_folder_will_do(tmp_path, monkeypatch, folder):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    beside = {*Path(__file__).parent.rglob("*.nb?")}
    if folder == "missing":
        monkeypatch.setattr(jit, "cache_folder", lambda: None)
    if folder == "read-only":
        monkeypatch.setattr(os, "access", lambda path, mode: False)  # for a superuser none is
    monkeypatch.setattr(jit, "_ENTRIES", {})
    if folder == "damaged":
        assert compiled_function(doubled)(3.0) == 6.0
        jit._ENTRIES.clear()
        for file in cache.cache_folder().rglob("*.nb?"):
            file.write_bytes(b"none of it")
    assert compiled_function(doubled)(3.0) == 6.0
    assert not list(tmp_path.rglob("*.nb?"))  # damaged files are removed, and written by the next process
    assert {*Path(__file__).parent.rglob("*.nb?")} == beside


def source_digest_of(file):
    """The digest of a file as a new process finds it."""
    sources._digest.cache_clear()
    sources.source_digest.cache_clear()
    return sources.source_digest(str(file))


def test_an_edit_of_any_file_of_a_package_gives_its_methods_another_digest(tmp_path):
    folder = tmp_path / "theirs" / "laws"
    folder.mkdir(parents=True)
    method, *others = [folder / name for name in ("mine.py", "__init__.py", "../__init__.py", "../util.py")]
    for file in (method, *others):
        file.write_text("A = 1\n")
    first = source_digest_of(method)
    for file in (method, *others):
        file.write_text("A = 2\n")
        assert sources.source_digest(str(method)) == first  # a process has the digest of what it has imported
        assert source_digest_of(method) != first
        file.write_text("A = 1\n")
        assert source_digest_of(method) == source_digest_of(file) == first  # there is one a package
    alone = tmp_path / "alone.py"
    alone.write_text("A = 1\n")
    before = source_digest_of(alone)
    (tmp_path / "other.py").write_text("A = 1\n")
    assert source_digest_of(alone) == before
    alone.write_text("A = 2\n")
    assert source_digest_of(alone) != before


# ------------------------------------------------------------------------------------------------ all shipped kernels

# Each scheme with bars; each element and material with a scheme of either loop, whose kernels are all the same.
BODIES = [
    *({"bodies.short.element": name} for name in REGISTRY.names("elements")),
    {"bodies.short.material": {"name": "bilinear-plastic", "young": 100.0, "density": 0.01, "yield_stress": 0.02}},
]
QUICK = [
    *({"method.contact": name} for name in REGISTRY.names("contacts")),
    *({"method.mass": name} for name in REGISTRY.names("masses")),
]
DEEP = [  # each compiles a loop of its own
    *({"method.integrator": name} for name in REGISTRY.names("integrators")),
    *({"method.integrator": scheme} | bodies for scheme in ("central-difference", "noh-bathe") for bodies in BODIES),
]


def words(changes):
    return " ".join(value if isinstance(value, str) else value["name"] for value in changes.values())


@pytest.mark.skipif(jit_disabled(), reason="compilation is switched off")
@pytest.mark.parametrize("changes", [*QUICK, *map(deep, DEEP)], ids=words)
def test_every_registered_method_is_compiled(changes):
    """Plain Python gives the same numbers, a hundred times slower: nothing else would show that a kernel is none."""
    base = hunek(4, integrator="central-difference", contact="penalty", end=0.05)
    try:
        result = percuss.run(percuss.load(base, changes))
    except (percuss.RefusedPair, percuss.InputError):
        pytest.skip("refused")
    assert result.summary["compiled"], result.summary["compiled_why"]
