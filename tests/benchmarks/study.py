"""Many short runs: `percuss.study` on two workers against a plain loop of `percuss.run` in one process.

    python tests/benchmarks/study.py [--runs N] [--workers N]

Prints runs a second of both, their ratio, and what a run costs beyond the run itself. The ratio is to be at least 1.6
on two cores that are free.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import percuss

HUNEK = Path(__file__).resolve().parents[2] / "cases" / "hunek.yaml"
SMALL = {"bodies.short.bar.elements": 20, "bodies.long.bar.elements": 40}
FIRST, LAST = 0.05, 2.0


def plain(runs: int) -> tuple[float, float]:
    """Return runs a second of the loop that anybody would write, and core-seconds a run."""
    case = percuss.load(HUNEK, {**SMALL, "expect": ()})
    percuss.run(case)
    started, busy = time.perf_counter(), time.process_time()
    for beta in np.geomspace(FIRST, LAST, runs):
        with contextlib.suppress(percuss.RunError):
            percuss.run(case, {"method.contact.beta_s": float(beta)})
    return runs / (time.perf_counter() - started), (time.process_time() - busy) / runs


def study(runs: int, workers: int) -> tuple[float, float]:
    """Return runs a second of a study, start and end included, and core-seconds a run."""
    values = f"{FIRST}:{LAST}:log:{runs}"
    given = {"percuss-study": 1, "cases": [str(HUNEK)], "set": SMALL, "vary": {"method.contact.beta_s": values}}
    with tempfile.TemporaryDirectory() as folder:
        before, started = os.times(), time.perf_counter()
        made = percuss.study(given, Path(folder) / "study.sqlite", workers=workers)
        after, speed = os.times(), runs / (time.perf_counter() - started)
        assert made.complete
        assert len(made.table) == runs
    return speed, (sum(after[:4]) - sum(before[:4])) / runs


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    loop_runs = max(200, given.runs // 10)
    before = plain(loop_runs)
    speed, busy = study(given.runs, given.workers)
    after = plain(loop_runs)  # the machine may be busier than it was
    loop, alone = (0.5 * (one + two) for one, two in zip(before, after, strict=True))
    spread = f"before {before[0]:.1f}, after {after[0]:.1f}"
    print(f"plain loop   {loop:8.1f} runs/s, {1e3 * alone:.2f} core-ms a run ({spread})")
    print(f"study        {speed:8.1f} runs/s, {1e3 * busy:.2f} core-ms a run, {given.workers} workers, with start-up")
    by_core = given.workers * alone / busy
    print(f"ratio        {speed / loop:8.2f} by the clock, {by_core:.2f} by core time: what cores that are free give")


if __name__ == "__main__":
    main()
