"""Table of pairs of methods and cases: the median of one measure in each cell, and the runs behind it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from percuss.reporting.study_data.values import WAITING, methods, numbers, texts

MOST_FACTOR = 100.0  # Cells whose median is this many times the smallest one of the case, or more, have one colour.

SHADES = ((0xFF, 0xFB, 0xE6), (0xE8, 0x8A, 0x3C))  # Both colours of cells are light enough for dark letters.


@dataclass(frozen=True)
class Cell:
    """Statistics of one measure over the runs of one pair of methods in one case.

    Attributes
    ----------
    median, least
        Median and smallest value over the runs that have the measure; nan where none has.
    measured, made
        Number of runs that have the measure, and number of runs made.
    lost
        Number of the other runs by status; ``no number`` for a run that is done without the measure.
    """

    median: float
    least: float
    measured: int
    made: int
    lost: dict[str, int]


def overview(table: Any, name: str) -> dict[str, dict[str, Cell]]:
    """Return the cells of one measure: for each pair of methods a mapping from the case to its cell."""
    method_of_row, cases = np.array(methods(table)), np.array(texts(table["case"]))
    status, values = np.array(texts(table["status"])), numbers(table[name])
    out: dict[str, dict[str, Cell]] = {}
    for method in dict.fromkeys(method_of_row.tolist()):
        for case in dict.fromkeys(cases.tolist()):
            own = (method_of_row == method) & (cases == case) & (status != WAITING)
            if not own.any():
                continue
            measured = own & (status == "done") & np.isfinite(values)
            valid = values[measured]
            ends = ["no number" if end == "done" else end for end in status[own & ~measured].tolist()]
            median, least = (float(np.median(valid)), float(valid.min())) if valid.size else (np.nan, np.nan)
            out.setdefault(method, {})[case] = Cell(median, least, int(valid.size), int(own.sum()), dict(Counter(ends)))
    return out


def counted(cell: Cell) -> str:
    """Return in words the number of runs behind a cell's median, and the statuses of the other runs."""
    losses = ", ".join(f"{count} {status}" for status, count in cell.lost.items())
    if cell.made == 1:
        return next(iter(cell.lost), "")
    head = f"median of {cell.measured}" if cell.measured else "0"
    return f"{head} of {cell.made} runs: {losses}" if losses else f"median of {cell.made} runs"


def least_medians(cells: dict[str, dict[str, Cell]], excluded: set[str]) -> dict[str, float]:
    """Return the smallest median of each case among the pairs that compete and lost no run there."""
    best: dict[str, float] = {}
    for method, row in cells.items():
        for case, cell in row.items() if method not in excluded else ():
            if cell.measured and cell.measured == cell.made:
                best[case] = min(best.get(case, np.inf), cell.median)
    return best


def largest_factor(cells: dict[str, dict[str, Cell]], best: dict[str, float]) -> float:
    """Return the largest ratio of a median to the smallest median of its case, at least 2 and at most `MOST_FACTOR`."""
    factors = [
        cell.median / best[case] for row in cells.values() for case, cell in row.items() if best.get(case, 0) > 0
    ]
    return float(min(max([2.0, *(factor for factor in factors if np.isfinite(factor))]), MOST_FACTOR))


def shade(cell: Cell, best: float | None, largest: float) -> str:
    """Return the colour of a cell: pale at the smallest median of the case, darker the larger the ratio to it.

    It is white where the smallest median is unknown or not above zero.
    """
    if best is None or not best > 0:
        return "#ffffff"
    share = float(np.clip(np.log(max(cell.median / best, 1.0)) / np.log(largest), 0, 1))
    parts = (round(pale + share * (dark - pale)) for pale, dark in zip(*SHADES, strict=True))
    return "#" + "".join(f"{part:02x}" for part in parts)
