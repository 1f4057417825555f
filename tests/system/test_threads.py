"""Several threads at once, in a process that has compiled nothing yet: the same numbers as one after the other."""

import json
import os
import subprocess
import sys

import pytest

import percuss
import places
from strategies import hunek

LAWS = places.SUPPORT / "bodies" / "laws.py"
RUNS = """
import json, sys, threading, percuss
cases, plugin = json.loads(sys.argv[1]), sys.argv[2]
start, ends = threading.Barrier(len(cases)), [None] * len(cases)
def work(k):
    start.wait()
    try:
        result = percuss.run(percuss.load(cases[k], plugins=[plugin]))
        seconds = result.summary["seconds"]
        ends[k] = [result.summary["compiled"], float(result.arrays["contact_force"].max()), seconds["march"]]
    except Exception as error:
        ends[k] = repr(error)
threads = [threading.Thread(target=work, args=(k,)) for k in range(len(cases))]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
print(json.dumps(ends))
"""


@pytest.mark.deep
def test_runs_in_threads_of_a_cold_process(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment.pop("NUMBA_DISABLE_JIT", None)
    bipenalty = {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0}
    cases = [
        hunek(6, contact="penalty", integrator="central-difference", end=0.3),
        hunek(7, contact=bipenalty, end=0.3),
        hunek(6, contact="nitsche-kernel", end=0.3),
        hunek(6, contact=bipenalty, end=0.3),
    ]
    command = [sys.executable, "-c", RUNS, json.dumps(cases), str(LAWS)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    alone = [percuss.run(percuss.load(case, plugins=[LAWS]), compiled=False) for case in cases]
    for (compiled, peak, march), expected in zip(json.loads(done.stdout), alone, strict=True):
        assert compiled
        assert peak == pytest.approx(float(expected.arrays["contact_force"].max()), rel=1e-11)
        assert march < 1.0  # no other thread's compiling is in it
