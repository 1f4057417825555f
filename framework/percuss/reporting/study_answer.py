"""The answer of a study in a few sentences, made from its rows."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from percuss.case.quantities import TRUE_ERRORS, by_two, ranking
from percuss.reporting.figures import number
from percuss.reporting.study_data import WAITING, ColumnRoles, groups, methods, numbers, references, texts
from percuss.reporting.verdict import best_words, equal_mesh_words, is_same, tie_words

if TYPE_CHECKING:
    import pandas as pd

LARGEST_FACTOR = 1e6  # Errors with a larger ratio are round-off.
MOST_CASES = 2  # Of more cases only the wins are counted; the first chart has each of them.


def answer(table: pd.DataFrame, roles: ColumnRoles) -> list[str]:
    """Return which pairs tie, which is best at equal mesh and in each case, how many runs failed, and what matters.

    Parameters
    ----------
    table
        All rows of the study.
    roles
        The roles of its columns.
    """
    ranked = ranking(roles.measures)
    best = _best_sentences(table, roles, ranked[0]) if ranked else ["The study measured no error to rank its runs by."]
    keys = list(dict.fromkeys(["case", "integrator", "contact", *roles.varied, "status", *roles.measures]))
    rows = table[keys].astype(object).where(table[keys].notna(), None).to_dict("records")
    best = [*tie_words(rows, roles.measures), *(equal_mesh_words(rows, ranked[0]) if ranked else ()), *best]
    return [*best, _failed_sentence(table), *(_dependence_sentence(table, roles, ranked[0]) if ranked else [])]


def _best_sentences(table: pd.DataFrame, roles: ColumnRoles, name: str) -> list[str]:
    values, pairs = numbers(table[name]), np.array(methods(table))
    compared = (table["status"] == "done").to_numpy() & np.isfinite(values) & ~np.isin(pairs, references(table))
    rows_compared = np.flatnonzero(compared)
    of_cases = {case: rows_compared[own] for (case,), own in groups(texts(table["case"][compared])).items()}
    what = roles.measures[name].removesuffix(" [%]")
    if not of_cases:
        return [f"No run has a value of the {what}."]
    if len(of_cases) <= MOST_CASES:
        told = ["energy_kept", *(by_two(name) if name in TRUE_ERRORS else ())]
        beside = [other for other in told if other in roles.measures]
        keys = ["case", "integrator", "contact", *roles.varied, "status", name, *beside]
        plain = table[keys].astype(object).where(table[keys].notna(), None)
        return [best_words(case, plain.iloc[rows].to_dict("records"), name) for case, rows in of_cases.items()]
    apart = by_two(name)[2] if name in TRUE_ERRORS else ""
    equal = numbers(table[apart]) if apart in roles.measures else np.zeros(len(table))
    best = {
        case: rows[is_same(name, values[rows], values[rows].min()) | (values[rows] - values[rows].min() < equal[rows])]
        for case, rows in of_cases.items()
    }
    wins = Counter(pair for rows in best.values() for pair in dict.fromkeys(pairs[rows].tolist()))
    (first, most), *rest = wins.most_common(3)
    others = "".join(f", {pair} in {count}" for pair, count in rest)
    sentence = f"{first} has the smallest {what} in {most} of {len(of_cases)} cases{others}."
    with np.errstate(divide="ignore", invalid="ignore"):
        medians = [np.median(values[rows]) for rows in of_cases.values()]
        factor = float(np.median(np.divide(medians, [values[rows[0]] for rows in best.values()])))
    if not factor < LARGEST_FACTOR:
        return [sentence]
    than = f"{number(factor, 2)} times smaller than the median of all its runs (median over the cases)"
    return [sentence, f"The smallest error of a case is {than}."]


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
