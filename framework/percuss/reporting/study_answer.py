"""The answer of a study in a few sentences, made from its rows."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from percuss.case.quantities import ranking
from percuss.reporting.figures import number
from percuss.reporting.study_data import WAITING, ColumnRoles, groups, methods, numbers, records, texts
from percuss.reporting.verdict import best_runs

if TYPE_CHECKING:
    import pandas as pd


def answer(table: pd.DataFrame, roles: ColumnRoles) -> list[str]:
    """Return which pairs tie, which is best at equal mesh and in each case, how many runs failed, and what matters.

    Parameters
    ----------
    table
        All rows of the study.
    roles
        The roles of its columns.
    """
    rows = records(table, roles)
    ranked = ranking(roles.measures)
    best = list(best_runs(rows, roles.measures)) if ranked else ["The study measured no error to rank its runs by."]
    return [*best, _failed_sentence(table), *(_dependence_sentence(table, roles, ranked[0]) if ranked else [])]


def _failed_sentence(table: pd.DataFrame) -> str:
    """Return how many runs failed, with which status and mostly of which pair."""
    made = table[table["status"] != WAITING]
    waiting = f" {len(table) - len(made):,} runs are still to be made." if len(made) < len(table) else ""
    failed = made[made["status"] != "done"]
    if failed.empty:
        return f"None of {len(made):,} runs failed.{waiting}"
    counts = ", ".join(f"{count:,} {status}" for status, count in Counter(texts(failed["status"])).most_common())
    (pair, most), *_ = Counter(methods(failed)).most_common()
    used = f"; {most:,} of them used {pair}" if 2 * most > len(failed) else ""
    return f"{len(failed):,} of {len(made):,} runs failed ({counts}){used}.{waiting}"


def _dependence_sentence(table: pd.DataFrame, roles: ColumnRoles, name: str) -> list[str]:
    """Return by what factor the error changes over each varied value, and how many runs depend on round-off."""
    done = table[table["status"] == "done"]
    factors = {path: _factor(done, roles, path, name) for path in roles.varied}
    known = sorted(((factor, path) for path, factor in factors.items() if factor >= 1), reverse=True)
    words = [f"by a factor of {number(factor, 2)} with {path}" for factor, path in known[:3]]
    out = [f"The error of a pair in a case changes {', '.join(words)} (medians)."] if words else []
    fragile = int(done["fragile"].eq(True).sum())
    if fragile:
        out.append(f"The result of {fragile:,} of {len(done):,} runs depends on round-off.")
    return [" ".join(out)] if out else []


def _factor(done: pd.DataFrame, roles: ColumnRoles, path: str, name: str) -> float:
    """Return the median ratio of largest to smallest error over one varied value with all others held; else nan."""
    held = [texts(done[other]) for other in (*roles.varied, "case") if other != path]
    values, errors = np.array(texts(done[path]), dtype=object), numbers(done[name])
    alike = (rows[(values[rows] != "") & (errors[rows] > 0)] for rows in groups(methods(done), *held).values())
    ratios = [errors[rows].max() / errors[rows].min() for rows in alike if len(set(values[rows])) > 1]
    return float(np.median(ratios)) if ratios else np.nan
