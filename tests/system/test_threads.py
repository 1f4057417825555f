"""Threads that share out the steps of large solids, and several threads of Python: the same numbers as one."""

import contextlib
import json
import os
import subprocess
import sys

import pytest

import percuss
import places
import shared_out
from percuss import threads
from percuss.march import arrays
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


# ------------------------------------------------------------------------ loops that are shared out among threads


def in_process(*arguments, before="", most=3):
    """Return what `shared_out` tells in a process of its own that may have so many threads."""
    environment = {**os.environ, "NUMBA_NUM_THREADS": str(most), "PYTHONPATH": os.pathsep.join(sys.path)}
    file = places.SUPPORT / "shared_out.py"
    code = f"{before}\nimport runpy; runpy.run_path({str(file)!r}, run_name='__main__')"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.deep
@pytest.mark.parametrize("names", ["tet4,weight", "viscous,stages of rings"])
def test_the_bits_do_not_depend_on_the_threads(names, tmp_path):
    """Code with shared loops is compiled in the first process, and loaded after serial code, and first, in others."""
    expected = {name: shared_out.told(shared_out.run(name, 1))[1:] for name in names.split(",")}
    for counts, more in (("321", ()), ("13", (tmp_path / "a.nc",)), ("2", ())):
        ends = in_process(names, counts, *more)
        assert ends["small"] == [1, False]
        for name, runs in ends["runs"].items():
            for count, (there, *found) in zip(counts, runs, strict=True):
                assert there == int(count)
                assert found == list(expected[name]), (name, count)
        if more:
            digest, notes = expected[names.split(",")[0]]
            assert ends["at once"] == [[3, digest, notes]] * 2
            assert ends["child"] == [
                1,
                digest,
                [*notes, f"one thread made the steps of large solids: {threads.FORKED}"],
            ]
            same, line = ends["again"]
            assert same
            assert ", compiled, 3 threads, marched in " in line


@pytest.mark.deep
@pytest.mark.parametrize(
    "before",
    [
        "import sys; sys.modules |= dict.fromkeys(['numba.np.ufunc.omppool', 'numba.np.ufunc.tbbpool'])",
        "import numba; numba.config.THREADING_LAYER = 'workqueue'; numba.get_num_threads()",
    ],
    ids=["no layer", "launched by others"],
)
def test_without_threads_that_may_run_at_once_a_run_is_serial_and_says_so(before):
    there, digest, notes = in_process("tet4", "2", before=before)["runs"]["tet4"][0]
    expected = shared_out.told(shared_out.run("tet4", 1))
    said = f"one thread made the steps of large solids: {threads.NO_LAYER}"
    assert (there, digest, notes) == (1, expected[1], [*expected[2], said])


def test_one_thread_in_studies_and_comparisons(monkeypatch):
    monkeypatch.setattr(arrays, "FEW_NUMBERS", 0)
    (run,) = percuss.compare(percuss.load(shared_out.CASES["weight"]))
    assert run.result.summary["threads"] == 1


@pytest.mark.parametrize("failing", [0, 5, 10, 33, 99, 100])
@pytest.mark.parametrize(("pace", "alone"), [(0.5, 10), (1.4, 10), (3.0, 10), (3.0, 0)])
def test_one_thread_goes_on_where_threads_lose_time(monkeypatch, failing, pace, alone):
    clock, made, now = [0.0], [], [0]

    @contextlib.contextmanager
    def limited_to(number):
        now[0] = number
        yield

    def advance(first, stop):
        ends = min(stop, failing)
        made.extend(now * (ends - first))
        clock[0] += (ends - first) * (1.0 if now[0] == 1 else pace)
        return ends - first

    monkeypatch.setattr(threads, "limited_to", limited_to)
    monkeypatch.setattr(threads.time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(threads, "PARTS", 10)
    monkeypatch.setattr(threads, "FEW", 8 if alone else 101)  # of fewer steps none is made alone
    assert threads.made_faster(100, 2, advance) == failing
    parts = {0.5: 9, 1.4: 3, 3.0: 1 if alone else 9}[pace]
    by_threads = 10 * parts if alone else 100
    assert made == ([1] * alone + [2] * by_threads + [1] * 100)[:failing]
    assert threads.made_faster(0, 2, lambda *part: made.append(part) or 0) == 0
    assert made[-1] == (0, 0)  # what compiles the loop
