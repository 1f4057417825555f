"""What contact costs a step of solids, over that without contact: sliding small and large, with and without friction.

    python tests/benchmarks/sliding.py [--rounds N]

Two blocks of squares or of hexahedra lie on each other and one slides. All kinds of contact are marched in turns, on
one thread, by CPU time; a ratio is the median over the rounds. ``searches`` marches with a search for candidates in
each step, of which a run makes one in some tens of steps. Mortar slides in two dimensions.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

import percuss
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.step.parts.sliding import Sliding

MESHES = {"2 x 220 x 220 squares": ([1.0, 1.0], [220, 220], 20), "101 306 hexahedra": ([1.0] * 3, [37, 37, 37], 4)}
FRICTION = {"name": "coulomb", "mu": 0.3}
KINDS: dict[str, dict[str, Any] | None] = {
    "no contact": None,
    "small": {},
    "small, friction": {"friction": FRICTION},
    "large": {"sliding": "large"},
    "large, friction": {"sliding": "large", "friction": FRICTION},
    "large, friction, searches": {"sliding": "large", "friction": FRICTION},
    "large, mortar": {"sliding": "large", "pairing": "mortar"},
    "large, mortar, friction": {"sliding": "large", "pairing": "mortar", "friction": FRICTION},
}


def marched(size: list[float], elements: list[int], contact: dict[str, Any] | None) -> March:
    """Return the march of two blocks, ready for its first step."""
    across = len(size) - 1
    solid = {"young": 1.0, "density": 1.0, "poisson": 0.3}
    body = {"block": {"size": size, "elements": elements}, "material": solid}
    upper = {"at": [*[0.003, 0.002][:across], 1.0], "velocity": [*[0.02, 0.01][:across], -0.01]}
    seam = {"between": ["upper.bottom", "lower.top"]}
    case = percuss.load(
        {
            "percuss": 1,
            "bodies": {"lower": body | {"at": [0.0] * len(size)}, "upper": body | upper},
            "contacts": {} if contact is None else {"seam": seam | contact},
            "method": {"contact": "regularised-lagrange", "pairing": "node-to-segment"},
            "time": {"steps": 1000, "courant": 0.5},
        }
    )
    march = March(model_of(case))
    march.compile()
    march._start_stepper()
    return march


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=10)
    rounds = parser.parse_args().rounds
    print(f"{'':26} {'ms a step':>10} {'over no contact':>16}")
    for mesh, (size, elements, steps) in MESHES.items():
        kinds = [kind for kind in KINDS if len(size) == 2 or "mortar" not in kind]
        marches = {kind: marched(size, elements, KINDS[kind]) for kind in kinds}
        times: dict[str, list[float]] = {kind: [] for kind in kinds}
        for first in range(0, rounds * steps, steps):
            for kind, march in marches.items():
                amplitudes, began = march.stepper.amplitudes(first, steps), time.process_time()
                for n in range(first, first + steps):
                    if kind.endswith("searches"):
                        next(one for one in march.arrays.parts if isinstance(one, Sliding)).data.allowed[0] = -1.0
                    march.advance(amplitudes[n - first : n - first + 1], n, 1)
                times[kind].append(1e3 * (time.process_time() - began) / steps)
        print(mesh)
        for kind, found in times.items():
            ratio = np.median(np.array(found) / np.array(times["no contact"]))
            print(f"  {kind:24} {min(found):10.3f} {ratio:16.3f}")


if __name__ == "__main__":
    main()
