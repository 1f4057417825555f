"""Measure what the certificate costs: beside the run it is for, and at ten thousand elements.

Each line is the best of five; the certificate should stay below .1 s or 5 % of the run, whichever is larger.
"""

import time
from pathlib import Path

import percuss
from percuss.certificate.verdict import certificate, settled
from percuss.march.march import March

HUNEK = Path(__file__).parent.parent.parent / "cases" / "hunek.yaml"
PAIRS = [
    ("wu-predictor-corrector", {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0}),
    ("wu-predictor-corrector", {"name": "penalty", "beta_s": 1.0}),
    ("central-difference", {"name": "penalty", "beta_s": 0.25}),
    ("central-difference", {"name": "bipenalty", "beta_s": 0.25, "ratio": 2.0}),
    ("central-difference", {"name": "tied"}),
]


def best(action, count=5):
    """Return the shortest of `count` times [s]."""
    taken = []
    for _ in range(count):
        started = time.perf_counter()
        action()
        taken.append(time.perf_counter() - started)
    return min(taken)


def main() -> None:
    """Print a table."""
    print(f"{'elements':>9} {'certificate':>12} {'march':>10}  pair")
    for refine in (1, 34):
        for integrator, law in PAIRS:
            changes = {"refine": refine, "method.integrator": integrator, "method.contact": law}
            model = settled(percuss.load(HUNEK, {**changes, "time.courant": 0.5})).model
            March(model).run()
            told = best(lambda model=model: certificate(model))
            march = best(lambda model=model: March(model).run(), 2)
            elements = model.bodies.n_nodes - len(model.bodies)
            print(f"{elements:9d} {told:10.4f} s {march:8.4f} s  {integrator} + {law['name']}")


if __name__ == "__main__":
    main()
