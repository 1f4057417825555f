"""The same case gives the same bits: whatever ran before it, beside it, or around it."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import scipy.linalg  # noqa: F401 - a library of BLAS of its own
from threadpoolctl import ThreadpoolController, threadpool_limits

import percuss
import places
from strategies import hunek

CASES = {
    "wu": hunek(8, end=0.5),
    "auto": hunek(8, 0.5, "central-difference", {"name": "penalty"}) | {"time": {"courant": "auto", "end": 0.5}},
    "stages": hunek(8, 0.5, "noh-bathe", {"name": "penalty"}, end=0.5),
}
# Runs cases in the order given, under a profiler or a tracer if one is named, and prints all their bits.
RUNS = """
import cProfile, json, sys
cases, around = json.loads(sys.argv[1]), sys.argv[2]
if around == "profiler":
    cProfile.Profile().enable()
elif around == "tracer":
    sys.setprofile(lambda *event: None)
    sys.settrace(lambda *event: None)
import percuss
bits = {}
for name, case in cases.items():
    result = percuss.run(percuss.load(case))
    del result.summary["seconds"]
    arrays = {key: values.tobytes().hex() for key, values in result.arrays.items()}
    bits[name] = [arrays, result.summary, result.provenance["resolved"]]
print(json.dumps(bits))
"""
LONG = {"refine": 150, "time.end": None, "time.steps": 5}  # sums of more than ten thousand terms


def threads_of_blas():
    return [library.get_num_threads() for library in ThreadpoolController().select(user_api="blas").lib_controllers]


@pytest.mark.skipif(threads_of_blas() == [], reason="no library of BLAS whose threads can be counted")
def test_bits_do_not_depend_on_the_threads_of_blas():
    """Sums of more than ten thousand terms are split among threads, and their order changes the last digits."""
    case = percuss.load(places.CASES / "doyen-impact.yaml", LONG)
    errors = []
    for threads in (1, 2, 4):
        with threadpool_limits(threads, user_api="blas"):
            errors.append(percuss.run(case).summary["exact"]["displacement_error"])
    assert len(set(errors)) == 1


def test_eigenvalues_that_choose_the_step_are_found_by_one_thread(monkeypatch):
    """The step that `courant: auto` takes depends on their last digits, and all histories on the step."""
    law = {"name": "row", "epsilon_s": 1.3, "rate": 1e-4}  # which the black box certifies
    case = hunek(5, contact=law, integrator="central-difference") | {"time": {"courant": "auto", "steps": 3}}
    found, eigenvalues = [], np.linalg.eigvals
    monkeypatch.setattr(np.linalg, "eigvals", lambda matrix: found.append(threads_of_blas()) or eigenvalues(matrix))
    with threadpool_limits(2, user_api="blas"):
        percuss.run(percuss.load(case, plugins=[places.SUPPORT / "bodies" / "laws.py"]))
        assert {threads for counts in found for threads in counts} == {1}
        assert set(threads_of_blas()) == {2}


def bits_of(names, around="", **environment):
    """Run cases in a process of their own; return their bits by name."""
    cases = json.dumps({name: CASES[name] for name in names})
    made = subprocess.run(
        [sys.executable, "-c", RUNS, cases, around],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    return json.loads(made.stdout)


@pytest.mark.deep
def test_bits_do_not_depend_on_the_process():
    """Alone, or in any order after others; profiled or traced; with any number of threads and any seed of hashes."""
    expected = bits_of(CASES)
    assert bits_of(["stages"])["stages"] == expected["stages"]
    threads = {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "3", "PYTHONHASHSEED": "7"}
    assert bits_of(reversed(CASES), "profiler", **threads) == expected
    assert bits_of(CASES, "tracer", PYTHONHASHSEED="8") == expected


@pytest.mark.deep
def test_bits_do_not_depend_on_who_compiled_them(tmp_path):
    """Just compiled, and under a tracer, as from the cache."""
    expected = bits_of(CASES)
    for around in ("", "tracer"):
        own = {"NUMBA_CACHE_DIR": str(tmp_path / f"cache {around}")}
        assert bits_of(["auto"], around, **own)["auto"] == expected["auto"]
