"""Cost of each part of a run against elements, steps and contacts, and the exponent of its growth.

    python tests/benchmarks/scale.py [--series NAME ...] [--most N] [--repeats N]

Four series: a bar that hits another, with more and more elements, or steps; and rows of bars, all pressed together,
with more and more contacts, with a law evaluated at the current gap and with one at the predicted gap. Each size is
measured in a process of its own, which makes a small run of the same kind first, so that compiled code is there and
the memory is that of one size. Times are CPU times [s], the smallest of the repeats. Parts: reading the case, model,
certificate, march of all steps, result with the exact solution. Memory is what the peak of the process grew by, and
the same for each element, step or contact.

The exponent p of a part is that of n^p, by least squares of the logarithms over the sizes at which the part takes at
least ten times as long as at its cheapest, so that a constant share does not flatten it. Arrays that fit into the
caches of the processor take less time for each element than those that do not: across that size the exponent, of the
model above all, is above 1, on either side of it 1.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import percuss
from percuss.blas import one_blas_thread
from percuss.certificate import verdict
from percuss.march.march import March
from percuss.march.recording import recordable
from percuss.results.assemble import result_of

PARTS = ("load", "model", "certificate", "march", "result")
DOMINATES = 10.0  # times the cheapest: sizes from which on a part is taken to grow
ENOUGH = 3.0  # CPU seconds after which nothing is repeated
PENALTY = {"integrator": "central-difference", "contact": "penalty"}
BIPENALTY = {"integrator": "wu-predictor-corrector", "contact": "bipenalty"}


def two_bars(elements: int, steps: int, velocity: float, every: int) -> dict[str, Any]:
    """Return the case of a bar that hits another, with as many elements in both together."""
    half = max(1, elements // 2)
    bar = {"bar": {"length": 10.0, "elements": half}, "material": {"young": 100.0, "density": 0.01}, "area": 1.0}
    return {
        "percuss": 1,
        "bodies": {"left": {**bar, "velocity": velocity}, "right": {**bar, "at": 10.0, "fixed": ["right"]}},
        "contacts": {"tip": {"between": ["left.right", "right.left"]}},
        "method": PENALTY,
        "time": {"courant": 0.5, "steps": steps},
        "record": {"every": every},
    }


def pressed_bars(contacts: int, method: Mapping[str, Any], velocity: float) -> dict[str, Any]:
    """Return the case of a row of unlike bars, each of which runs into the next."""
    bodies = {
        f"b{k}": {
            "bar": {"length": 1.0, "elements": 4},
            "at": float(k),
            "material": {"young": 1.0 + 0.3 * (7 * k % 5), "density": 1.0},
            "area": 1.0,
            "velocity": velocity * (contacts - k),
        }
        for k in range(contacts + 1)
    }
    between = {f"c{k}": {"between": [f"b{k}.right", f"b{k + 1}.left"]} for k in range(contacts)}
    return {
        "percuss": 1,
        "bodies": bodies,
        "contacts": between,
        "method": method,
        "time": {"courant": 0.5, "steps": 10},
        "record": {"probes": []},
    }


class Series(NamedTuple):
    """Sizes, and the case of a size; its velocity differs from repeat to repeat, so that no solution is kept."""

    what: str
    sizes: tuple[int, ...]
    case: Callable[[int, float], dict[str, Any]]


SERIES = {
    "elements": Series(
        "elements, 100 steps, central difference with penalty",
        tuple(10**k for k in range(2, 7)),
        lambda size, velocity: two_bars(size, 100, velocity, 10),
    ),
    "steps": Series(
        "steps, 100 elements, central difference with penalty, every step recorded",
        tuple(10**k for k in range(2, 7)),
        lambda size, velocity: two_bars(100, size, velocity, 1),
    ),
    "contacts": Series(
        "contacts, 10 steps, central difference with penalty",
        tuple(10**k for k in range(5)),
        lambda size, velocity: pressed_bars(size, PENALTY, 1e-3 * velocity),
    ),
    "contacts-predicted": Series(
        "contacts, 10 steps, Wu's predictor-corrector with bipenalty",
        tuple(10**k for k in range(5)),
        lambda size, velocity: pressed_bars(size, BIPENALTY, 1e-3 * velocity),
    ),
}


@one_blas_thread()
def once(data: dict[str, Any]) -> dict[str, float]:
    """Return the CPU time of each part of a run [s]: the way of `percuss.run`, part by part."""
    clock = [time.process_time()]

    def lap() -> float:
        clock.append(time.process_time())
        return clock[-1] - clock[-2]

    case = percuss.load(data)
    load = lap()
    model, criterion = verdict.settled(case)
    march = March(recordable(model))
    build = lap()
    certificate = verdict.certificate(model, criterion)
    certified = lap()
    march.compile()
    lap()
    outcome = march.run(None, marginal=certificate["stable"] == "marginal")
    marched = lap()
    if outcome.status != "done" or not outcome.kernels.compiled:
        raise SystemExit(f"the run is {outcome.status}, compiled: {outcome.kernels.compiled}")
    result_of(march, outcome, certificate)
    return {
        "load": load, "model": build, "certificate": certified, "march": marched, "result": lap(),
        "nodes": model.bodies.n_nodes,
    }  # fmt: skip


def measure(name: str, size: int, repeats: int) -> dict[str, float]:
    """Return the smallest CPU time of each part, the number of nodes and the growth of the peak memory [bytes]."""
    series = SERIES[name]
    once(series.case(min(size, 100), 0.1))
    before, started = peak_memory(), time.process_time()
    best: dict[str, float] = {}
    memory = 0.0
    for repeat in range(repeats):
        seconds = once(series.case(size, 0.1 * (1.0 + 1e-3 * (repeat + 1))))
        best = {part: min(value, best.get(part, math.inf)) for part, value in seconds.items()}
        memory = memory or peak_memory() - before  # later repeats stand beside what is left of the first
        if time.process_time() - started > ENOUGH:
            break
    best["memory"] = memory
    return best


def peak_memory() -> float:
    """Return the largest memory that this process has had [bytes].

    On Linux what the system calls the largest resident set begins with that of the process that started this one; the
    high-water mark does not.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        marks = dict(line.split(":", 1) for line in status.read_text(encoding="ascii").splitlines())
        return 1024.0 * float(marks["VmHWM"].split()[0])
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * (1 if sys.platform == "darwin" else 1024)


def in_child(name: str, size: int, repeats: int) -> dict[str, float]:
    """Return what `measure` finds in a process of its own."""
    command = [sys.executable, __file__, "--one", name, str(size), str(repeats)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def exponent(sizes: list[int], values: list[float]) -> float:
    """Return the exponent of growth where the size dominates, nan if that is at fewer than two sizes."""
    n, t = np.array(sizes, dtype=float), np.array(values)
    where = t >= DOMINATES * t.min()
    return float(np.polyfit(np.log(n[where]), np.log(t[where]), 1)[0]) if where.sum() > 1 else math.nan


def main() -> None:
    """Print one table a series."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--series", nargs="+", choices=SERIES, default=list(SERIES))
    parser.add_argument("--most", type=int, default=10**6, help="largest size")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        name, size, repeats = given.one
        print(json.dumps(measure(name, int(size), int(repeats))))
        return
    for name in given.series:
        series = SERIES[name]
        sizes = [size for size in series.sizes if size <= given.most]
        print(f"\n{series.what}")
        print(f"{'size':>9}" + "".join(f"{part:>13}" for part in PARTS) + f"{'MiB':>9}{'bytes each':>12}")
        found = []
        for size in sizes:
            found.append(in_child(name, size, given.repeats))
            row = found[-1]
            times = "".join(f"{row[part]:13.3e}" for part in PARTS)
            print(f"{size:9d}{times}{row['memory'] / 2**20:9.1f}{row['memory'] / size:12.0f}", flush=True)
        fitted = (exponent(sizes, [row[part] for row in found]) for part in PARTS)
        print(f"{'exponent':>9}" + "".join(f"{'-' if math.isnan(p) else format(p, '.2f'):>13}" for p in fitted))


if __name__ == "__main__":
    main()
