"""The memory that a node takes, which the framework states, and the estimate of a run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import percuss
from percuss.march.estimate import START
from percuss.mesh.size_limits import BYTES_PER_NODE, bytes_in_words

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
