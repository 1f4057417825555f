"""The memory that a node takes, which the framework states, and the fit of the benchmark of growth."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks.scale import SERIES, once

import percuss
from percuss.march.estimate import START
from percuss.mesh.size_limits import (
    BYTES_PER_NODE,
    bytes_in_words,
)

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.nightly
def test_certificate_and_run_of_a_million_elements_take_less_memory_than_is_stated():
    pytest.importorskip("resource")  # it reports the largest memory of a process
    program = ROOT / "tests" / "benchmarks" / "scale.py"
    command = [sys.executable, str(program), "--one", "elements", "1000000", "1"]
    measured = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert measured["nodes"] == 1_000_002
    # more than displacement, velocity, mass and its inverse, and stiffness: else nothing was measured
    assert 40 < measured["memory"] / measured["nodes"] < BYTES_PER_NODE


SOLID = """
import json, sys
import percuss
from benchmarks.scale import peak_memory

def block(across, cells):
    body = {"block": {"size": [1, 1], "elements": [across, across], "cells": cells}, "at": [0.0, 0.0],
            "material": {"young": 1, "density": 1, "poisson": 0.3}, "velocity": [0.0, -0.01]}
    contact = {"floor": {"body": "a.bottom", "wall": [0.0, 0.0]}}
    time = {"courant": 0.5, "steps": 9}
    return percuss.load({"percuss": 1, "bodies": {"a": body}, "contacts": contact, "time": time})

percuss.run(block(4, sys.argv[2]))
before, case = peak_memory(), block(int(sys.argv[1]), sys.argv[2])
found = percuss.check(case).data["estimate"]["bytes"]
percuss.run(case)
print(json.dumps([found, peak_memory() - before]))
"""


@pytest.mark.nightly
@pytest.mark.parametrize(("across", "cells"), [(60, "quad4"), (200, "tri3")])
def test_the_estimated_memory_of_a_body_in_two_dimensions_is_near_that_of_its_run(across, cells):
    pytest.importorskip("resource")
    command = [sys.executable, "-c", SOLID, str(across), cells]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests")}
    told = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    estimated, taken = json.loads(told.splitlines()[-1])
    assert 0.5 < estimated / taken < 2.0


def test_the_estimate_follows_elements_steps_and_records():
    case = percuss.load(ROOT / "cases" / "tilted-blocks.yaml")

    def estimate(**changes):
        found = percuss.check(case.with_overrides(changes))
        return found.text, found.data["estimate"]["seconds"], found.data["estimate"]["bytes"]

    text, seconds, size = estimate()
    sweeps = "more if many coupled contact points press"
    assert f"the steps take less than 1 s once they are compiled, {sweeps}, and the run about" in text
    assert sweeps not in percuss.check(percuss.load(ROOT / "cases" / "hunek.yaml")).text
    assert bytes_in_words(size) in text
    _, fewer_records, _ = estimate(**{"record.every": 1000})
    assert fewer_records - START == pytest.approx(0.5 * (seconds - START), rel=0.1)
    text, finer, more = estimate(**{"refine": 4, "time.end": 600})
    assert finer == pytest.approx(100 * 4**3 * (seconds - START), rel=0.1)
    assert f"the steps take about {finer:.0f} s" in text
    assert more > 10 * size


def calls_of(contacts, method):
    """Return how many functions the parts of one run of a row of bars call."""
    series = SERIES[method]
    once(series.case(contacts, 0.1))
    count = 0

    def called(_, event, __):
        nonlocal count
        count += event in {"call", "c_call"}

    sys.setprofile(called)
    try:
        once(series.case(contacts, 0.1001))
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.deep
@pytest.mark.parametrize("method", [name for name in SERIES if "contacts" in name])
def test_functions_called_grow_with_the_number_of_contacts_and_no_faster(method):
    """Calls are counted and not timed; 100 to 400 contacts would be sixteen times as many in a quadratic part."""
    few, some, many = (calls_of(contacts, method) for contacts in (100, 200, 400))
    assert many - some < 2.2 * (some - few)
