"""Results of the pairs of methods in each case: best and median of a measure, the runs behind them, why runs failed."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.jsonable import Entries
from percuss.reporting.study_data.values import WAITING, methods, numbers, texts

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
    pairs, cases = np.array(methods(table), dtype=object), np.array(texts(table["case"]), dtype=object)
    status, values = np.array(texts(table["status"]), dtype=object), numbers(table[name])
    out: dict[str, dict[str, Cell]] = {}
    for case in dict.fromkeys(cases.tolist()):
        for pair in dict.fromkeys(pairs[cases == case].tolist()):
            own = np.flatnonzero((pairs == pair) & (cases == case) & (status != WAITING))
            if not own.size:
                continue
            measured = (status[own] == "done") & np.isfinite(values[own])
            valid, ends = values[own[measured]], status[own[~measured]].tolist()
            lost = Counter("without a number" if end == "done" else end for end in ends)
            row = int(own[measured][np.argmin(valid)]) if valid.size else -1
            best, median = (float(valid.min()), float(np.median(valid))) if valid.size else (np.nan, np.nan)
            out.setdefault(case, {})[pair] = Cell(best, median, row, valid.size, own.size, dict(lost))
    return out


def lost(table: pd.DataFrame) -> list[Entries]:
    """Return the reasons why runs are not done, most frequent first; reasons that differ by numbers alone are one."""
    rows = table[~table["status"].isin(["done", WAITING])]
    pairs = methods(rows)
    sources, reasons, status = (texts(rows[name]) for name in ("said_by", "reason", "status"))
    groups: dict[Any, Entries] = {}
    for entry in zip(status, pairs, sources, reasons, strict=True):
        kind = (*entry[:3], re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", entry[3]))
        group = groups.setdefault(kind, dict(zip(("status", "method", "said_by", "reason"), entry, strict=True)))
        group["count"] = group.get("count", 0) + 1
    return sorted(groups.values(), key=lambda group: -int(group["count"]))
