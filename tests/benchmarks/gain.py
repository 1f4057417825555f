"""What energy the pairs without a guarantee gain: central difference with penalty and with bipenalty.

``python tests/benchmarks/gain.py [--seed N] [--rows N]``. Rows of 2 to 4 unlike bars, free or between walls; modulus,
density, area, length and element size of each bar drawn over a factor of ten, log-uniformly, Courant number from .3 to
.95. Each row runs until its contacts have closed ten times, or for `LONGEST` transits of its slowest bar. The gain is
the largest energy over that at the start, less 1: no load acts. A run exploded where it was stopped or the gain is
above 10.
"""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import numpy as np

import percuss
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.march.starting_state import initial_velocity
from percuss.results import ledger

CLOSINGS = 10
LONGEST = 64
EXPLODED = 10.0
LAWS = {
    "penalty": {"name": "penalty"},
    "penalty, beta_s .25": {"name": "penalty", "beta_s": 0.25},
    "bipenalty": {"name": "bipenalty"},
    "beta_s 1, matched": {"name": "bipenalty", "beta_s": 1.0, "ratio": "matched"},
    "beta_s 1, ratio 1": {"name": "bipenalty", "beta_s": 1.0, "ratio": 1.0},
    "beta_s .5, free-step": {"name": "bipenalty", "beta_s": 0.5, "ratio": "free-step"},
    "beta_s 2, matched": {"name": "bipenalty", "beta_s": 2.0, "ratio": "matched"},
}


class Gains(NamedTuple):
    """Of many rows: the gain of each, infinite where it exploded, and how often its contacts closed."""

    gains: Any
    closings: Any

    @property
    def median(self) -> float:
        return float(np.median(self.gains))

    @property
    def most(self) -> float:
        return float(np.quantile(self.gains, 0.95, method="higher"))

    @property
    def largest(self) -> float:
        return float(self.gains.max())

    @property
    def exploded(self) -> float:
        return float(np.isinf(self.gains).mean())


def row(rng: Any) -> dict[str, Any]:
    """Return bars that touch or nearly so, of drawn velocities, between walls at both, one or no end."""

    def drawn(low: float) -> float:
        return float(low * 10.0 ** rng.uniform())

    bodies: dict[str, Any] = {}
    at = 0.0
    count = int(rng.integers(2, 5))
    for k in range(count):
        length, size = drawn(1.0), drawn(0.03)
        bodies[f"b{k}"] = {
            "bar": {"length": length, "elements": max(2, round(length / size))},
            "at": at,
            "material": {"young": drawn(1.0), "density": drawn(1.0)},
            "area": drawn(1.0),
            "velocity": float(rng.uniform(-1.0, 1.0)),
        }
        at += length + (float(rng.uniform(0.0, 0.1)) if rng.uniform() < 0.5 else 0.0)
    last = f"b{count - 1}"
    contacts: dict[str, Any] = {f"c{k}": {"between": [f"b{k - 1}.right", f"b{k}.left"]} for k in range(1, count)}
    walls = int(rng.integers(0, 4))
    if walls & 1:
        contacts["left"] = {"body": "b0.left", "wall": 0.0}
    if walls & 2:
        contacts["right"] = {"body": f"{last}.right", "wall": bodies[last]["at"] + bodies[last]["bar"]["length"]}
    return {
        "percuss": 1, "bodies": bodies, "contacts": contacts, "record": {"probes": []},
        "time": {"end": 1.0, "courant": float(rng.uniform(0.3, 0.95))},
    }  # fmt: skip


def gain(case: dict[str, Any], law: dict[str, Any]) -> tuple[float, int]:
    """Return the gain of one row, infinite where it exploded, and how often its contacts closed."""
    case = {**case, "method": {"integrator": "central-difference", "contact": law}}
    slowest = max(
        one["bar"]["length"] * (one["material"]["density"] / one["material"]["young"]) ** 0.5
        for one in case["bodies"].values()
    )
    transits = 4
    while True:
        case["time"] = {**case["time"], "end": transits * slowest}
        march = March(model_of(percuss.load(case)))
        outcome = march.run(None)
        found = ledger.energies(march, outcome)
        energy = found["kinetic_energy"] + found["elastic_energy"]
        start = 0.5 * float(march.model.bodies.mass @ (initial_velocity(march.model) ** 2).sum(axis=1))
        pressed = outcome.record.contact_force[: outcome.records] != 0.0
        closings = int((pressed[1:] & ~pressed[:-1]).sum() + pressed[0].sum())
        most = float(np.nanmax(energy)) / start - 1.0
        if outcome.status == "unstable" or most > EXPLODED:
            return np.inf, closings
        if closings >= CLOSINGS or transits >= LONGEST:
            return most, closings
        transits *= 2


def gains(law: dict[str, Any], rows: int, seed: int) -> Gains:
    """Return the gains of `rows` drawn rows with a contact law; the same rows for every law."""
    found = [gain(row(np.random.default_rng([seed, k])), law) for k in range(rows)]
    return Gains(np.array([one for one, _ in found]), np.array([closings for _, closings in found]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rows", type=int, default=400)
    options = parser.parse_args()
    print(f"{'':30} {'median':>9} {'95 %':>9} {'largest':>9} {'exploded':>9} {'closings':>9}")
    for name, law in LAWS.items():
        found = gains(law, options.rows, options.seed)
        print(
            f"{name:30} {found.median:9.2%} {found.most:9.2%} {found.largest:9.2%} {found.exploded:9.2%} "
            f"{np.median(found.closings):9.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
