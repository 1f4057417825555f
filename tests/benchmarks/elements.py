"""What a step of an element of finite strain costs, of rubber and over the element of full integration.

    python tests/benchmarks/elements.py [--rounds N]

A free block of some thousand cells turns, so that its material is strained a little. All elements take turns on one
core; each line has the least time of an element and step, and that over `quad4` in a plane and `hex8` in space.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))
from cells import case_of, march_of, settled

RUBBER = {"name": "neo-hookean", "young": 1.0, "density": 1.0, "poisson": 0.3}
SIDES = {2: 40, 3: 12}
STEPS = 200
ELEMENTS = {
    2: ("quad4", "quad4-mean", "quad4-one-point", "tri3"),
    3: ("hex8", "hex8-mean", "hex8-one-point", "tet4"),
}


def model(element: str, dim: int) -> Any:
    """Return the model of a block of an element."""
    shape = {"size": [1.0] * dim, "elements": [SIDES[dim]] * dim, "cells": element.partition("-")[0]}
    body = {"block": shape, "at": [0.0] * dim, "material": RUBBER, "element": element}
    body["spin"] = 0.1 if dim == 2 else [0.1, 0.05, -0.1]
    return settled(case_of({"block": body}, {}, STEPS))


def main() -> None:
    """Print a line for each element."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    for dim, names in ELEMENTS.items():
        marches = {name: (march_of(made := model(name, dim)), made.bodies["block"].count) for name in names}
        turns = [{name: march()[0] / STEPS / count for name, (march, count) in marches.items()} for _ in range(rounds)]
        least = {name: min(turn[name] for turn in turns) for name in names}
        for name, seconds in least.items():
            print(f"{name:16} {1e9 * seconds:6.0f} ns {seconds / least[names[0]]:5.2f}", flush=True)


if __name__ == "__main__":
    main()
