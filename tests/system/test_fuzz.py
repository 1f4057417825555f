"""Bad input of every kind ends with success or with one clear message: no traceback, no warning, no breakdown.

The deep test takes as many inputs as `PERCUSS_FUZZ` says.
"""

import os
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bad_input
import percuss
from bad_input import GOOD, SHARES, Bench, Ground
from percuss.errors import PercussError

COUNT = int(os.environ.get("PERCUSS_FUZZ", "500"))
QUICK = {
    "case": 60,
    "value": 60,
    "edge": 30,
    "table": 40,
    "result": 40,
    "store": 12,
    "study": 8,
    "command": 12,
    "plug-in": 8,
}


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    bench = Bench(Ground(tmp_path_factory.mktemp("ground")).make())
    yield bench
    bench.close()


@pytest.mark.parametrize("kind", SHARES)
def test_no_input_ends_badly(bench, kind):
    bad = {}
    for seed in range(QUICK[kind]):
        word, detail = bench.try_(kind, seed)
        if word not in {*GOOD, "slow"}:  # how long a second is depends on the machine
            bad[seed] = word, detail
    assert not bad


NUMBERS = st.floats() | st.integers() | st.integers(-(10**30), 10**30) | st.sampled_from([10**4000, -(10**400)])
VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(max_size=40) | st.sampled_from(["auto", "matched", "x" * 10_000]),
    lambda items: st.lists(items, max_size=4) | st.dictionaries(st.text(max_size=8), items, max_size=3),
    max_leaves=8,
)


@given(st.data())
def test_no_value_at_any_path_ends_badly(bench, data):
    path, value = data.draw(st.sampled_from(bench.paths)), data.draw(VALUES)
    dotted = ".".join("short" if part == "*" else part for part in path)
    message = "right"
    try:
        percuss.load(bench.data["hunek.yaml"], {dotted: value})
    except PercussError as error:
        message = str(error)
    assert 0 < len(message) < 10_000


@pytest.mark.deep
def test_many_inputs_in_processes_of_their_own():
    command = [sys.executable, bad_input.__file__, str(COUNT), "--start", str(10**6)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
