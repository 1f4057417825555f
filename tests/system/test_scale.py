"""The memory that a node takes, which the framework states, and the fit of the benchmark of growth."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from benchmarks.scale import SERIES, once

import pages
import percuss
from percuss.certificate.black_box import MOST_ALONE
from percuss.march.estimate import START
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.march.recording import recordable
from percuss.mesh.size_limits import (
    BYTES_OF_RUN,
    BYTES_PER_NODE,
    BYTES_PER_SOLID_NODE,
    MOST_FACTORED,
    bytes_in_words,
    bytes_of_nodes,
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


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("hunek", {"refine": 4}),
        ("fifty-impacts", {}),
        ("hunek", {"method.integrator": "chung-lee", "method.contact": "penalty"}),
        ("tilted-blocks", {"refine": 2}),
        ("strip-unlike", {"record.every": 20}),
        ("disk-on-wall", {"refine": 0.5, "bodies.disk.disk.cells": "tri3"}),
    ],
)
def test_the_estimated_time_of_the_steps_is_within_a_factor_of_three(name, changes):
    """Over that of a case on the same machine: how fast it is no estimate can know."""
    share = estimated_over_taken(name, changes) / estimated_over_taken("smooth-pulse", {"refine": 2})
    assert 1.0 / 3.0 < share < 3.0


def estimated_over_taken(name, changes):
    case = percuss.load(ROOT / "cases" / f"{name}.yaml").with_overrides(changes)
    percuss.run(case)  # compiles
    times = []
    for _ in range(3):
        march = March(recordable(model_of(case)))
        march.compile()  # binding its kernels takes as long as a thousand short steps
        before = time.process_time()
        march.run()
        times.append(time.process_time() - before)
    return percuss.check(case).data["estimate"]["seconds"] / min(times)


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


def test_the_page_states_the_memory_of_a_node():
    small, large = (bytes_of_nodes(count, 3, of_bar=False) / 1e9 for count in (5_000, 16_000))
    for words in (
        f"at most {BYTES_PER_NODE} bytes for each node and dimension",
        f"of bodies in two dimensions about {BYTES_PER_SOLID_NODE / 1000:.0f} kilobytes",
        f"A body of more than {MOST_FACTORED // 1000} 000 nodes is not factored",
        f"its run takes about {BYTES_OF_RUN / 1000:.0f} kilobytes for each node",
        f"5 000 nodes take about {small:.1f} GB, 16 000 nodes about {large:.1f} GB",
        f"and of more than {MOST_ALONE} contacts with none and all",
    ):
        assert words in pages.everything()


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
