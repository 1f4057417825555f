"""Functions compiled for compiled callers alone compute what numba's own functions compute, fresh and from disk."""

import json
import os
import subprocess
import sys
import types
from importlib import metadata

import numpy as np
import pytest

import percuss
from percuss.compiler.marks import called
from percuss.compiler.specialise import Specialiser
from percuss.compiling import numba_inside
from strategies import hunek

CALLEES = """
from percuss.compiler.compile_function import compile_function

def _mean(values, divisor):
    if divisor == 0:
        raise ValueError("the divisor is zero", divisor)
    total = 0.0
    for value in values:
        total += value / divisor
    return total

mean = compile_function(_mean, entry=False, key="mean", error_model="numpy", forceinline=True)

def _twice(values, divisor):
    print("divisor", divisor)
    return mean(values, divisor) + mean(values, divisor)

twice = compile_function(_twice, entry=False, key="twice", error_model="numpy")
"""
ENTRY = """
import sys
import numpy as np
if "plain" in sys.argv:
    sys.modules["percuss.numba_inside"] = None  # as with another version of numba
from percuss.compiler.compile_function import compile_function
from callees import mean, twice

def scaled(values, divisor):
    return FACTOR * twice(values, divisor)

scaled = compile_function(scaled, entry=True, key="scaled by FACTOR", error_model="numpy")
print(scaled(np.arange(5.0), 4))
try:
    scaled(np.arange(5.0), 0)
except ValueError as error:
    print(error.args)
print(*(sum(function.stats.cache_hits.values()) for function in (mean, twice, scaled)))
"""


@pytest.fixture
def answer(tmp_path):
    """Return a function that runs an entry which multiplies by a factor, and returns what it prints."""
    (tmp_path / "callees.py").write_text(CALLEES)

    def answer(factor: int, *arguments: str) -> list[str]:
        program = tmp_path / f"times_{factor}.py"
        program.write_text(ENTRY.replace("FACTOR", str(factor)))
        done = subprocess.run(
            [sys.executable, str(program), *arguments],
            capture_output=True,
            text=True,
            env={"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PATH": ""},
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    return answer


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments", [(), pytest.param(("plain",), marks=pytest.mark.deep)], ids=["callees", "plain numba"]
)
def test_callees_compute_print_and_raise_fresh_and_from_disk(answer, arguments):
    fresh, again, other = answer(1, *arguments), answer(1, *arguments), answer(3, *arguments)
    texts = ["divisor 4", "5.0", "divisor 0", "('the divisor is zero', 0)"]
    assert fresh == [*texts, "0 0 0"]
    stored = not arguments  # plain numba compiles anew each time
    assert again == [*texts, f"0 0 {stored:d}"]  # the entry is restored whole, and needs no callee
    assert other == [texts[0], "15.0", *texts[2:], f"0 {stored:d} 0"]  # another entry restores what it calls


def test_this_version_of_numba_has_what_percuss_takes_from_inside_it():
    import numba  # noqa: F401  before that nothing inside it is asked

    assert numba_inside() is not None


def version(text):
    return tuple(int(part) for part in text.split(".")[:2])


def test_the_versions_of_numba_that_were_tried_are_the_declared_ones_and_this_one():
    """A newer one is to be tried with all tests, and then named: until then the fall-back stands in for surprises."""
    from percuss.numba_inside import TRIED

    (declared,) = (line for line in metadata.requires("percuss") if line.startswith("numba"))
    assert declared == f"numba>={TRIED[0]}"
    assert version(TRIED[0]) <= version(metadata.version("numba")) <= version(TRIED[1])


PLAIN = """
import sys
sys.modules["percuss.numba_inside"] = None
import numpy as np
import percuss
from percuss.compiling import numba_inside

case, file = sys.argv[1:3]
result = percuss.run(percuss.load(case))
assert result.summary["compiled"], result.summary["compiled_why"]
assert numba_inside() is None
np.savez(file, **result.arrays)
"""


@pytest.mark.deep
def test_without_names_from_inside_numba_a_case_gives_the_same_numbers(tmp_path):
    case = tmp_path / "case.yaml"
    case.write_text(json.dumps(hunek(8, integrator="wu-predictor-corrector", end=0.5)))
    program = tmp_path / "program.py"
    program.write_text(PLAIN)
    file = tmp_path / "plain.npz"
    environment = dict(os.environ, XDG_CACHE_HOME=str(tmp_path / "cache"))
    subprocess.run([sys.executable, str(program), str(case), str(file)], env=environment, check=True)
    plain, given = np.load(file), percuss.run(percuss.load(case))
    assert given.summary["compiled"]
    assert list(given.arrays) == plain.files
    for name, array in given.arrays.items():
        np.testing.assert_array_equal(array, plain[name], err_msg=name, strict=True)


def _doubled(x):
    return 2.0 * x


def _added(x):
    return _doubled(x) + 1.0


def test_a_called_function_is_linked_into_its_entry(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # what is restored from there does not tell its parts
    monkeypatch.setitem(globals(), "_doubled", called(types.FunctionType(_doubled.__code__, globals(), "_doubled")))
    kernel = Specialiser().bind(_added, entry=True)
    assert kernel(3.0) == 7.0
    (compiled,) = kernel.overloads.values()
    defined = [each.name for each in compiled.library._final_module.functions if not each.is_declaration]
    assert not any("_doubled" in name for name in defined)


TOGETHER = """
import sys, time
from pathlib import Path
from numba.core.compiler import CompilerBase
from percuss.compiler.compile_function import compile_function

folder, count = Path(sys.argv[1]), int(sys.argv[2])
compile_all = CompilerBase._compile_bytecode

def slowly(self):
    time.sleep(1.0)
    print("compiled")
    if "dies" in sys.argv:
        sys.stdout.flush()
        os._exit(1)
    return compile_all(self)

CompilerBase._compile_bytecode = slowly

def added(x):
    return x + 1.0

import os
entry = compile_function(added, entry=True, key="added")
(folder / f"ready {os.getpid()}").touch()
while len(list(folder.glob("ready *"))) < count:
    time.sleep(0.01)
print(entry(2.0))
"""


def together(tmp_path, *arguments):
    """Return what three processes print that need the same function at the same time; `arguments` are of the first."""
    program = tmp_path / "together.py"
    program.write_text(TOGETHER)
    processes = [
        subprocess.Popen(
            [sys.executable, str(program), str(tmp_path), "3", *(arguments if k == 0 else ())],
            stdout=subprocess.PIPE,
            text=True,
            env={"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PATH": ""},
        )
        for k in range(3)
    ]
    return [process.communicate(timeout=120)[0].split() for process in processes]


@pytest.mark.deep
def test_of_several_processes_one_compiles(tmp_path):
    assert sorted(together(tmp_path)) == [["3.0"], ["3.0"], ["compiled", "3.0"]]


@pytest.mark.deep
def test_nobody_waits_for_a_process_that_has_died(tmp_path):
    first, *others = together(tmp_path, "dies")
    assert first in (["compiled"], ["3.0"])
    assert sorted(others) == [["3.0"], ["compiled", "3.0"]] or first == ["3.0"]
