"""The memory that a node takes, which the framework states, and the fit of the benchmark of growth."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from benchmarks.scale import SERIES, exponent, once

import pages
from percuss.certificate.step_itself import MOST_ALONE
from percuss.mesh.size_limits import BYTES_PER_NODE

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.deep
def test_certificate_and_run_of_a_million_elements_take_less_memory_than_is_stated():
    pytest.importorskip("resource")  # it reports the largest memory of a process
    program = ROOT / "tests" / "benchmarks" / "scale.py"
    command = [sys.executable, str(program), "--one", "elements", "1000000", "1"]
    measured = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert measured["nodes"] == 1_000_002
    # more than displacement, velocity, mass and its inverse, and stiffness: else nothing was measured
    assert 40 < measured["memory"] / measured["nodes"] < BYTES_PER_NODE


def test_the_page_states_the_memory_of_a_node():
    assert f"at most {BYTES_PER_NODE} bytes for each node and dimension" in pages.everything()


def test_the_page_states_of_how_many_contacts_each_one_is_closed_alone():
    assert f"and of more than {MOST_ALONE} contacts with none and all" in pages.everything()


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


@pytest.mark.parametrize("method", [name for name in SERIES if "contacts" in name])
def test_functions_called_grow_with_the_number_of_contacts_and_no_faster(method):
    """Calls are counted and not timed; 100 to 400 contacts would be sixteen times as many in a quadratic part."""
    few, some, many = (calls_of(contacts, method) for contacts in (100, 200, 400))
    assert many - some < 2.2 * (some - few)


def test_the_exponent_is_that_of_the_part_that_grows():
    sizes = [10**k for k in range(7)]
    for power in (0.5, 1.0, 2.0):
        times = [1e-3 + 1e-4 * size**power for size in sizes]
        assert exponent(sizes, times) == pytest.approx(power, abs=0.1)
    assert np.isnan(exponent(sizes, [1e-3] * 7))
