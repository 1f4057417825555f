"""Results of the pairs of methods in each case: best and median of a measure, the runs behind them, why runs failed."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from percuss.jsonable import Entries
from percuss.reporting.study_data.values import WAITING, groups, methods, numbers, texts

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Cell:
    """Statistics of one measure over the runs of one pair of methods in one case.

    Attributes
    ----------
    best, median
        Smallest value and median over the runs that have the measure; nan where none has.
    row
        Row number of the run with the smallest value; -1 where none has the measure.
    measured, made
        Number of runs that have the measure, and number of runs made.
    lost
        Number of the other runs by status; ``no number`` for a run that is done without the measure.
    """

    best: float
    median: float
    row: int
    measured: int
    made: int
    lost: dict[str, int]

    @property
    def lost_words(self) -> str:
        """The failed runs in words, as ``4 of 12 runs unstable``; empty if there are none."""
        of = f" of {self.made} run{'' if self.made == 1 else 's'}"
        return ", ".join(f"{count}{of} {status}" for status, count in self.lost.items())


def cells(table: pd.DataFrame, name: str) -> dict[str, dict[str, Cell]]:
    """Return the cells of one measure: for each case a mapping from the pair of methods to its cell."""
    status, values = np.array(texts(table["status"]), dtype=object), numbers(table[name])
    out: dict[str, dict[str, Cell]] = {}
    for (case, pair), rows in groups(texts(table["case"]), methods(table)).items():
        own = rows[status[rows] != WAITING]
        has_value = (status[own] == "done") & np.isfinite(values[own])
        measured, lost = own[has_value], Counter(status[own[~has_value]].tolist())
        lost = Counter({"without a number" if end == "done" else end: count for end, count in lost.items()})
        best, median, row = np.nan, np.nan, -1
        if measured.size:
            row = int(measured[np.argmin(values[measured])])
            best, median = float(values[row]), float(np.median(values[measured]))
        if own.size:
            out.setdefault(case, {})[pair] = Cell(best, median, row, measured.size, own.size, dict(lost))
    return out


def lost(table: pd.DataFrame) -> list[Entries]:
    """Return the reasons why runs are not done, most frequent first; reasons that differ by numbers alone are one."""
    rows = table[~table["status"].isin(["done", WAITING])]
    told = {name: texts(rows[name]) for name in ("status", "said_by", "reason")} | {"method": methods(rows)}
    kinds = [re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", reason) for reason in told["reason"]]
    alike = groups(told["status"], told["method"], told["said_by"], kinds).values()
    found = [{name: column[own[0]] for name, column in told.items()} | {"count": own.size} for own in alike]
    return sorted(found, key=lambda group: -group["count"])
