"""Figures of bodies in two and three dimensions that the page of theory shows and the tests of truth assert.

Unless said otherwise they are those of a program written apart from percuss; lengths, moduli and densities are 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

NODES, GAUSS, MORTAR = "node-to-segment", "gauss-points", "mortar"
FOUR = {"name": GAUSS, "points_on_facet": 4}
NAMES = {NODES: f"`{NODES}`", GAUSS: f"`{GAUSS}`, 2", str(FOUR): f"`{GAUSS}`, 4", MORTAR: f"`{MORTAR}`"}

# Blocks of 5 and 7 cells across under a uniform pressure. At rest: the largest error of the stress in triangles and in
# quadrilaterals (found here; the other program has 13 to 18, 3 to 4, and .7 to .9 %). In an impact with
# regularised-lagrange, beta_s 1, at a Courant number of .7: the least and the largest pressure, and the largest speed
# across over that of impact. Those of four Gauss points were found here. In space, at rest: boxes of 3 by 3 against 4
# by 2 hexahedra, 7 along (found here; the other program has 22 to 29, 5 to 7, and 1 to 1.3 %).
AT_REST = {NODES: (0.139, 0.185), GAUSS: (0.0339, 0.0408), str(FOUR): (0.0067, 0.0081)}
IN_SPACE = {NODES: 0.278, GAUSS: 0.0670, str(FOUR): 0.0125}
IN_AN_IMPACT = {NODES: (0.91, 1.06, 0.020), GAUSS: (0.98, 1.02, 0.0031), str(FOUR): (1.00, 1.01, 0.00049)}

# The largest eigenvalue of S W over 2 / (rho h_n), by cells and their numbers across, for the pairings of `NAMES`.
RESPONSES = {
    ("quad4", (4,)): (1.0, 1.0, 1.0, 1.0),
    ("quad4", (4, 4)): (2.0, 2.0, 2.0, 2.0),
    ("quad4", (6, 4)): (2.02, 2.001, 2.000, 2.000),
    ("quad4", (5, 7)): (2.40, 2.005, 2.000, 2.31),
    ("tri3", (5, 7)): (2.85, 2.07, None, 2.63),
}

# Critical steps times the speed of longitudinal waves over the edge of a square or cube: of one cell with its own mass,
# and of 20 by 20 or 7 by 7 by 7 of them.
STEPS = {
    ("quad4", "strain"): {0.0: (1.0, 1.0), 0.3: (0.8367, 0.991), 0.45: (0.7416, 0.942)},
    ("quad4", "stress"): {0.0: (1.0, 1.0), 0.3: (0.877, 0.998), 0.45: (0.831, 0.989)},
    ("tri3", "strain"): {0.0: (0.6667, 0.695), 0.3: (0.6410, 0.693), 0.45: (0.5975, 0.687)},
    ("quad4", "axisymmetric"): {0.0: (0.5774, 0.5774), 0.3: (0.647, 0.651), 0.45: (0.674, 0.748)},
    ("hex8", ""): {0.0: (1.0, 1.0), 0.3: (0.7338, 0.961), 0.45: (0.6159, 0.866)},
    ("tet4", ""): {0.0: (0.5412, 0.644), 0.3: (0.4885, 0.671), 0.45: (0.4303, 0.645)},
}

# The largest energy over that of the start of a block that bounces between two walls, for `BETA_S` (of Young's
# modulus), with contact points at nodes and at Gauss points; None where it grows without bound.
CENTRAL, WU, GROWS = "central-difference", "wu-predictor-corrector", None
BETA_S = (0.25, 1.0, 2.0, 10.0)
PENALTY = {"name": "penalty"}
FREE_STEP, MATCHED = ({"name": "bipenalty", "ratio": ratio} for ratio in ("free-step", "matched"))
ENERGIES: list[tuple[str, dict[str, str], float, tuple[Any, ...], tuple[Any, ...]]] = [
    (CENTRAL, PENALTY, 0.5, (1, 1, 1, GROWS), (1, 1, 1, 9.8)),
    (CENTRAL, PENALTY, 0.9, (1, 1.09, GROWS, GROWS), (1, 1, GROWS, GROWS)),
    (CENTRAL, FREE_STEP, 0.5, (1.004, 1.02, 1.02, 1.5), (1.002, 1.01, 1.02, 1.15)),
    (CENTRAL, FREE_STEP, 0.9, (1.02, 1.13, 1.43, 5e8), (1.01, 1.06, 1.17, 8e4)),
    (CENTRAL, MATCHED, 0.5, (1.04, 1.24, 1.6, 2.2), (1.03, 1.17, 1.44, 1.6)),
    (CENTRAL, MATCHED, 0.9, (1.11, 3.0, 51, 1e11), (1.09, 1.8, 6.6, 1e15)),
    (WU, PENALTY, 0.5, (1, 1, 1, GROWS), (1, 1, 1, 1.9)),
    (WU, PENALTY, 0.9, (1, 1, 55, GROWS), (1, 1, 2.7, GROWS)),
    (WU, MATCHED, 0.5, (1, 1, 1, 1), (1, 1, 1, 1)),
    (WU, MATCHED, 0.9, (1, 1, 1, 1), (1, 1, 1, 1)),
]

# Growth rates of a block of 1 x .5 at a rigid wall, its lower nodes slide: E = rho = 1, plane strain, penalty beta_s 1.
# By nu and mu, for so many cells along the wall, in as many digits as the program gave.
CELLS = (4, 8, 16, 24)
RATES = {
    (0.0, 0.1): ("0", ".019", ".026", ".034"),
    (0.0, 0.3): ("0", ".067", ".11", ".19"),
    (0.0, 1.0): (".28", ".56", "1.2", "1.8"),
    (0.3, 0.1): (".012", ".040", ".19", ".34"),
    (0.3, 0.3): (".080", ".21", ".59", ".97"),
    (0.3, 1.0): (".52", ".91", "1.9", "2.8"),
    (0.45, 0.1): (".046", ".10", ".29", ".53"),
    (0.45, 0.3): (".25", ".35", "1.0", "2.0"),
    (0.45, 1.0): (".83", "2.1", "5.1", "8.0"),
}

# Errors in per cent: of the tip of a strip of 20 by 4 cells that bends, of the tip of a square of 8 by 8 cells of
# Poisson's ratio .4999, and of the frequency of a wave of ten cells. Last the time of a cell and step, of rubber, over
# that of full integration; it is measured (tests/benchmarks/elements.py).
OF_ELEMENTS = {
    "quad4": (-11.2, -49.2, -1.6, 1.0),
    "quad4-mean": (-9.5, -2.4, -1.6, 2.0),
    "quad4-one-point": (4.0, -0.3, -1.6, 0.5),
    "tri3": (-33.2, -43.8, -1.9, 0.25),
    "hex8": (-11.2, -49.2, -1.6, 1.0),
    "hex8-mean": (-9.5, -2.4, -1.6, 1.3),
    "hex8-one-point": (5.0, -0.2, -1.6, 0.36),
    "tet4": (-32.5, -43.6, -2.1, 0.1),
}
# The radius of the foot of Taylor's bar after the impact, of 4 by 20 cells.
FEET = {"quad4-axisymmetric": 4.59, "quad4-axisymmetric-mean": 7.11}

Rows = tuple[tuple[str, ...], Iterator[tuple[str, ...]]]


def patch_tests() -> Rows:
    """Return head and lines of the table of patch tests."""

    def line(name: str) -> tuple[str, ...]:
        if name == MORTAR:
            return NAMES[name], "exact", "exact", "uniform", "0"
        at_rest = " to ".join(f"{100 * error:.3g}" for error in AT_REST[name])
        low, high, across = IN_AN_IMPACT[name]
        in_space, pressures = f"{100 * IN_SPACE[name]:.3g} %", f"{low:.2f} to {high:.2f}"
        return NAMES[name], f"{at_rest} %", in_space, pressures, f"{100 * across:.2g} %"

    head = ("pairing", "error of the stress at rest", "of boxes", "pressure in an impact", "speed across")
    return head, map(line, NAMES)


def responses() -> Rows:
    """Return head and lines of the table of the largest eigenvalues of S W."""
    lines = (
        (f"`{cells}`, {' against '.join(map(str, across)) if len(across) > 1 else 'at a wall'}", *map(_plain, values))
        for (cells, across), values in RESPONSES.items()
    )
    return ("cells across", *NAMES.values()), lines


def steps() -> Rows:
    """Return head and lines of the table of critical steps."""
    ratios = (0.0, 0.3, 0.45)
    lines = (
        (f"`{cells}`{plane and f', {plane}'}", *(f"{one:.3g}, {many:.3g}" for one, many in map(values.get, ratios)))
        for (cells, plane), values in STEPS.items()
    )
    return ("cells", *(f"ν = {ratio:g}" for ratio in ratios)), lines


def energies() -> Rows:
    """Return head and lines of the table of the largest energies."""
    lines = (
        (
            f"`{integrator}`, `{law['name']}`{law.get('ratio', '') and ' `' + law['ratio'] + '`'}, C = {courant:g}",
            *(f"{_growth(one)}, {_growth(other)}" for one, other in zip(nodes, points, strict=True)),
        )
        for integrator, law, courant, nodes, points in ENERGIES
    )
    return ("methods", *(f"β_s = {value:g}" for value in BETA_S)), lines


def rates() -> Rows:
    """Return head and lines of the table of growth rates."""
    lines = ((f"ν = {poisson:g}, μ = {mu:g}", *values) for (poisson, mu), values in RATES.items())
    return ("block", *(f"{cells} cells" for cells in CELLS)), lines


def elements() -> Rows:
    """Return head and lines of the table of elements."""
    lines = [
        (f"`{name}`", *(f"{error:+.1f} %" for error in errors), "", f"{cost:.2g}")
        for name, (*errors, cost) in OF_ELEMENTS.items()
    ]
    lines += [(f"`{name}`", "", "", "", f"{radius:.2f} mm", "") for name, radius in FEET.items()]
    head = (
        "element",
        "a strip that bends",
        "almost incompressible",
        "a wave of ten cells",
        "foot of Taylor's bar",
        "cost",
    )
    return head, iter(lines)


def _growth(value: float | None) -> str:
    if value is None:
        return "grows"
    return f"{value:g}" if value < 1e3 else f"{value:.0e}".replace("+", "")


def _plain(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
