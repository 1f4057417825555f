"""What the exact solutions cost: fronts, seconds and closings.

``python tests/benchmarks/exact.py [--seed N] [--most N]``. Rows of 2 to 6 unlike touching bars between fixed ends, over
5, 10 and 20 transits of the slowest bar; the shipped impact of two bars; a hundred bounces of the shipped falling bar.
Warm: each is solved once before it is timed, and the best of three is shown.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

import percuss
from percuss.contact.contact_problem import contact_problem
from percuss.contact.model import Model
from percuss.march.model_of_case import model_of
from percuss.methods.registry import Registry

CASES = Path(__file__).resolve().parents[2] / "cases"


def row(count: int, rng: Any) -> dict[str, Any]:
    """Return touching bars of drawn lengths, materials and velocities, fixed at both ends."""
    bodies: dict[str, Any] = {}
    at = 0.0
    for k in range(count):
        length = float(rng.uniform(0.5, 2.0))
        bodies[f"b{k}"] = {
            "bar": {"length": length, "elements": 1},
            "at": at,
            "material": {"young": float(rng.uniform(0.5, 4.0)), "density": float(rng.uniform(0.5, 4.0))},
            "area": float(rng.uniform(0.5, 2.0)),
            "velocity": float(rng.uniform(-1.0, 1.0)),
        }
        at += length
    bodies["b0"]["fixed"] = ["left"]
    bodies[f"b{count - 1}"]["fixed"] = ["right"]
    contacts = {f"c{k}": {"between": [f"b{k - 1}.right", f"b{k}.left"]} for k in range(1, count)}
    return {
        "percuss": 1, "bodies": bodies, "contacts": contacts, "time": {"end": 1.0, "step": 0.1}
    }  # fmt: skip


def timed(what: str, model: Model, end: float, most: int) -> None:
    """Print one line of the table."""
    engine = Registry.load().get("solutions", "bars-in-a-row")(most_fronts=most)
    best = np.inf
    for _ in range(4):  # the first compiles
        started = time.perf_counter()
        solution = engine.solve(contact_problem(model), end)
        best = min(best, time.perf_counter() - started) if _ else np.inf
    closings = sum(len(contact.closed) for contact in solution.contacts.values())
    late = 0.97 * solution.reached
    energy, work = sum(solution.energy(late)), solution.work(late)
    start = sum(solution.energy(0.0))
    lost = abs(energy - start - work) / max(start, energy, abs(work))
    print(
        f"{what:30} {solution.reached / end:8.1%} {solution.fronts:10d} {closings:9d} {best:10.4f} "
        f"{1e6 * best / solution.fronts:10.2f} {lost:10.1e}",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--most", type=int, default=2_000_000, help="fronts after which the engine stops")
    options = parser.parse_args()
    print(f"{'':30} {'reached':>8} {'fronts':>10} {'closings':>9} {'seconds':>10} {'us/front':>10} {'energy':>10}")
    timed("hunek", model_of(percuss.load(CASES / "hunek.yaml")), 0.8, options.most)
    timed("doyen-bounce, 100 bounces", model_of(percuss.load(CASES / "doyen-bounce.yaml")), 50 * 16 / 3, options.most)
    for count in range(2, 7):
        model = model_of(percuss.load(row(count, np.random.default_rng(options.seed))))
        slowest = max(2.0 / float(body.frequency.min()) for body in model.bodies.values())  # of its one element
        for transits in (5, 10, 20):
            timed(f"{count} bars, {transits} transits", model, transits * slowest, options.most)


if __name__ == "__main__":
    main()
