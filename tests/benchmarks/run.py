"""One whole run against its own march: `percuss.run` of two bars at several mesh sizes.

    python tests/benchmarks/run.py [--repeats N]

Prints for each mesh the time of a warm run, of its march, their ratio, and where the rest goes: reading the values that
differ from the case, model and march, certificate, exact solution, and everything else. The ratio is to be at most 3
where the march takes a millisecond or more. Each time is the smallest of the repeats.

A second table has shipped cases of solids: the share of a run in which it looks for what its contact points do not see,
at the end alone and at 50 snapshots. It is to be at most 2 % where a run takes half a second or more.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import percuss
from percuss.results import encounters

CASES = Path(__file__).resolve().parents[2] / "cases"
HUNEK = CASES / "hunek.yaml"
SOLIDS = ("strip-impact", "disk-on-wall", "wolff-bucher", "two-spheres")
ELEMENTS = (10, 30, 100, 300, 1000, 3000)  # of the shorter bar; the longer one has twice as many
PARTS = ("march", "build", "certificate", "exact")


def smallest(case: percuss.Case, repeats: int) -> dict[str, float]:
    """Return the smallest time of a run and of each of its parts [s]."""
    best: dict[str, float] = {}
    for _ in range(repeats):
        started = time.perf_counter()
        result = percuss.run(case)
        seconds = {part: result.summary["seconds"][part] for part in PARTS}
        seconds["run"] = time.perf_counter() - started
        best = {part: min(value, best.get(part, value)) for part, value in seconds.items()}
    return best


def share_of_notes(case: percuss.Case, repeats: int) -> tuple[float, float]:
    """Return the smallest CPU time of a run, and the share of it in which its notes on solids are made."""
    notes, made = encounters.notes_of_solids, []

    def timed(*arguments: Any) -> list[str]:
        started = time.process_time()
        found = notes(*arguments)
        made.append(time.process_time() - started)
        return found

    encounters.notes_of_solids, runs = timed, []
    for _ in range(repeats):
        started = time.process_time()
        percuss.run(case)
        runs.append(time.process_time() - started)
    encounters.notes_of_solids = notes
    return min(runs), min(made) / min(runs)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=60, help="runs of the smallest mesh; fewer of larger ones")
    given = parser.parse_args()
    print(f"{'elements':>9}{'steps':>8}{'run ms':>10}{'march ms':>10}{'ratio':>7}   of the rest, per cent of the run")
    for elements in ELEMENTS:
        case = percuss.load(
            HUNEK, {"bodies.short.bar.elements": elements, "bodies.long.bar.elements": 2 * elements, "expect": ()}
        )
        steps = percuss.run(case).summary["steps"]
        best = smallest(case, max(3, given.repeats * 10 // max(10, elements)))
        shares = {part: 100.0 * best[part] / best["run"] for part in PARTS[1:]}
        other = 100.0 * (1.0 - sum(best[part] for part in PARTS) / best["run"])
        words = ", ".join(f"{part} {share:.0f}" for part, share in (*shares.items(), ("other", other)))
        print(
            f"{3 * elements:9d}{steps:8d}{1e3 * best['run']:10.2f}{1e3 * best['march']:10.2f}"
            f"{best['run'] / best['march']:7.2f}   {words}"
        )
    print(f"\n{'solids':>16}{'snapshots':>11}{'run s':>8}   notes, per cent of the run")
    for name in SOLIDS:
        for fields in (0, 50):
            case = percuss.load(CASES / f"{name}.yaml", {"record.fields": fields, "expect": ()})
            run, share = share_of_notes(case, max(2, given.repeats // 20))
            print(f"{name:>16}{fields:11d}{run:8.2f}   {100.0 * share:.2f}")


if __name__ == "__main__":
    main()
