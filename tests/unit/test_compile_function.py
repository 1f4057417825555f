"""Functions compiled for compiled callers alone compute what numba's own functions compute, fresh and from disk."""

import subprocess
import sys

import pytest

from percuss.solver.compiler import compile_function

CALLEES = """
from percuss.solver.compiler.compile_function import compile_callee

def _mean(values, divisor):
    if divisor == 0:
        raise ValueError("the divisor is zero", divisor)
    total = 0.0
    for value in values:
        total += value / divisor
    return total

mean = compile_callee(_mean, cache=True, error_model="numpy", forceinline=True)

def _twice(values, divisor):
    print("divisor", divisor)
    return mean(values, divisor) + mean(values, divisor)

twice = compile_callee(_twice, cache=True, error_model="numpy")
"""
ENTRY = """
import sys
import numpy as np
if "plain" in sys.argv:
    sys.modules["percuss.solver.compiler.numba_pipelines"] = None  # as with another version of numba
from percuss.solver.compiler.compile_function import compile_entry
from callees import mean, twice

def scaled(values, divisor):
    return FACTOR * twice(values, divisor)

scaled = compile_entry(scaled, cache=True, error_model="numpy")
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
        if not program.exists():  # numba compiles again what is in a file with another time
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
    assert again == [*texts, "0 0 1"]  # the entry is restored whole, and needs no callee
    assert other == [texts[0], "15.0", *texts[2:], "0 1 0"]  # another entry restores what it calls


def test_this_version_of_numba_has_what_callees_need():
    assert compile_function.pipelines() is not None
