"""A corner that falls on a face, by every pairing and either order: ``python tests/support/corners.py`` runs them all.

It writes the rows, and the tables of the page that says which pairing to take and which surface to name first.
"""

import csv
import itertools
import math
import sys

import pandas as pd

import pages
import percuss
import places
from family import short

RESULTS = places.ROOT / "cases" / "studies" / "results" / "corners.csv"
GAP, SPEED, END = 0.05, 0.01, 16.0
STEEL = {"young": 1.0, "density": 1.0, "poisson": 0.3}
ORDERS = {"corner": ["block.bottom", "anvil.top"], "face": ["anvil.top", "block.bottom"]}
LAWS = {"mortar": "lagrange", "node-to-segment": "lagrange", "gauss-points": "regularised-lagrange"}
DIMENSIONS, TILTS, MESHES = (2, 3), (1, 5, 10, 30), (1, 2, 4)
HEAD = ("dimensions", "pairing", "first", "tilt", "refine", "touch", "impulse", "told")


def falling(tilt, between, pairing="mortar", *, dim=2, refine=1, **changes):
    """Return a case in which a turned block falls on a larger one, which its lowest corner meets at `GAP / SPEED`.

    In space the block is turned about y alone, so that an edge falls on the face.
    """
    turn, (length, height) = math.radians(tilt), (5.0, 2.0)
    lowest = 0.5 * (length * math.sin(turn) + height * math.cos(turn))  # below the middle of the block
    size = {2: ([10, 3], [length, height]), 3: ([10, 3, 3], [length, 1.7, height])}[dim]
    cells = {2: ([10, 3], [7, 2]), 3: ([7, 3, 3], [5, 2, 2])}[dim]
    across = [0.6] * (dim - 2)
    block = {
        "block": {"size": size[1], "elements": cells[1]}, "material": STEEL, "angle": tilt,
        "at": [2.537, *across, 3.0 + GAP + lowest - 0.5 * height], "velocity": [*[0.0] * (dim - 1), -SPEED],
    }  # fmt: skip
    anvil = {"block": {"size": size[0], "elements": cells[0]}, "at": [0.0] * dim, "material": STEEL}
    return {
        "percuss": 1,
        "bodies": {
            "anvil": {**anvil, "fixed": ["bottom"]},
            "block": block | ({"axis": [0, -1, 0]} if dim == 3 else {}),
        },
        "contacts": {"hit": {"between": between}},
        "refine": refine,
        "method": {"contact": "lagrange", "pairing": pairing},
        "time": {"courant": 0.5, "end": 1.2 * GAP / SPEED},
        **changes,
    }


def row(dim, pairing, first, tilt, refine):
    """Return a line of the file: time of touch over that of geometry, impulse, and whether something was told."""
    method = {"contact": LAWS[pairing], "pairing": pairing}
    case = falling(tilt, ORDERS[first], pairing, dim=dim, refine=refine, method=method)
    case["time"]["end"] = END
    summary = percuss.run(percuss.load(case)).summary
    hit, told = summary["contacts"]["hit"], any("of 'block' lies" in note for note in summary["notes"])
    touch = None if hit["first_closed"] is None else hit["first_closed"] * SPEED / GAP
    return [dim, pairing, first, tilt, refine, "-" if touch is None else f"{touch:.4f}", f"{hit['impulse']:.5g}",
            "yes" if told else "no"]  # fmt: skip


def rows():
    """Return the numbers of the file by what makes a row."""
    return pd.read_csv(RESULTS, na_values="-").set_index(list(HEAD[:5]))


def _table(texts):
    """Return a table in Markdown with a line for each pairing and order in each number of dimensions."""
    cells = texts.groupby(level=list(HEAD[:4]), sort=False).agg(", ".join).unstack("tilt", sort=False)
    lines = ((f"{dim}D", f"`{pairing}`", first, *line) for (dim, pairing, first), *line in cells.itertuples())
    return pages.table(("", "pairing", "named first", *(f"{tilt}°" for tilt in TILTS)), lines)


def touches():
    """Return the table of the times of touch over that of geometry, on three meshes."""
    return _table(rows()["touch"].map(lambda time: short(time, 3)))


def impulses():
    """Return the table of the impulses over that of the finest mesh of mortar, with the corner first."""
    impulse = rows()["impulse"]
    finest = impulse.xs(("mortar", "corner", MESHES[-1]), level=("pairing", "first", "refine"))
    return _table((impulse / finest).reindex(impulse.index).map("{:.2f}".format))


PARTS = {"times of touch": touches, "impulses of corners": impulses}


def main():
    """Make the rows that are asked for, or all, and write them and what they show."""
    with RESULTS.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEAD)
        for which in itertools.product(DIMENSIONS, LAWS, ORDERS, TILTS, MESHES):
            made = row(*which)
            writer.writerow(made)
            sys.stderr.write(f"{made}\n")
    for name, make in PARTS.items():
        pages.write(name, make())


if __name__ == "__main__":
    main()
