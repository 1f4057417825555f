"""Make `ironing-block.msh` anew: `python ironing_block.py`.

A block 1.2 wide and .9 high on an arc that is .3 deep, whose lowest point is the origin, of 12 x 6 quadrilaterals. The
arc and the side x = .6, which goes ahead, are the group `foot`; the upper side is `top`.
"""

from pathlib import Path

import numpy as np

ACROSS, UP = 12, 6
WIDE, HIGH, DEEP = 1.2, 0.9, 0.3

radius = (DEEP**2 + 0.25 * WIDE**2) / (2.0 * DEEP)
angle = np.arcsin(0.5 * WIDE / radius) * np.linspace(-1.0, 1.0, ACROSS + 1)
arc = radius * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)
upper = np.stack([np.linspace(-0.5 * WIDE, 0.5 * WIDE, ACROSS + 1), np.full(ACROSS + 1, DEEP + HIGH)], axis=1)
nodes = np.concatenate([arc + (upper - arc) * k / UP for k in range(UP + 1)])
number = 1 + np.arange(len(nodes)).reshape(UP + 1, ACROSS + 1)
cells = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
side = np.concatenate([number[0], number[1:, -1]])  # from the back along the arc and up
edges = {1: np.stack([side[:-1], side[1:]], axis=1), 2: np.stack([number[-1, 1:], number[-1, :-1]], axis=1)}

# Lines of elements: number, kind (1 an edge, 3 a quadrilateral), two tags, nodes.
elements = [f"1 2 {group} {group} {a} {b}" for group, lines in edges.items() for a, b in lines]
elements += [f"3 2 3 3 {' '.join(map(str, corners))}" for corners in cells]
lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"]
lines += ["$PhysicalNames", "3", '1 1 "foot"', '1 2 "top"', '2 3 "block"', "$EndPhysicalNames"]
lines += ["$Nodes", str(len(nodes)), *(f"{k} {x:.12g} {y:.12g} 0" for k, (x, y) in enumerate(nodes, 1)), "$EndNodes"]
lines += ["$Elements", str(len(elements)), *(f"{k} {line}" for k, line in enumerate(elements, 1)), "$EndElements"]
Path(__file__).with_name("ironing-block.msh").write_text("\n".join(lines) + "\n", encoding="ascii")
