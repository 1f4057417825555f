"""The answer of a study in two to four sentences, made from its rows."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from percuss.case.quantities import percent
from percuss.reporting.figures import number
from percuss.reporting.study_data.case_cells import Cell, cells
from percuss.reporting.study_data.roles import ColumnRoles, is_share, ranking, references
from percuss.reporting.study_data.values import WAITING, as_label, methods, numbers, texts

NO_BREAK = "\u00a0"  # A line of a page does not end at this space.
MOST_CASES = 2  # Of more cases only the wins are counted; the first chart has each of them.
SAME = 1e-6  # Relative difference below which two errors are the same.


def answer(table: Any, roles: ColumnRoles) -> list[str]:
    """Return which pair of methods is best in each case, how many runs failed, and what the result depends on.

    Parameters
    ----------
    table
        All rows of the study, shares in per cent.
    roles
        The roles of its columns.
    """
    ranked = ranking(roles)
    best = _best_sentences(table, roles, ranked[0]) if ranked else ["The study measured no error to rank its runs by."]
    return [*best, _failed_sentence(table), *(_dependence_sentence(table, roles, ranked[0]) if ranked else [])]


def value_words(value: float, name: str) -> str:
    """Return a value of a measure in words, a share in per cent."""
    return percent(0.01 * value).replace(" ", NO_BREAK) if is_share(name) else number(value, 3)


def winners(of_case: dict[str, Cell], excluded: set[str]) -> list[str]:
    """Return the pairs with the smallest error of a case, all of them where several have the same."""
    known = {pair: cell.best for pair, cell in of_case.items() if cell.measured and pair not in excluded}
    least = min(known.values(), default=np.nan)
    return [pair for pair, value in known.items() if value - least <= SAME * abs(least)]


def _best_sentences(table: Any, roles: ColumnRoles, name: str) -> list[str]:
    excluded, what = set(references(table)), roles.measures[name].removesuffix(" [%]")
    of_cases = {case: own for case, own in cells(table, name).items() if winners(own, excluded)}
    if not of_cases:
        return [f"No run has a value of the {what}."]
    if len(of_cases) > MOST_CASES:
        wins = Counter(pair for own in of_cases.values() for pair in winners(own, excluded))
        (first, most), *rest = wins.most_common(3)
        others = "".join(f", {pair} in {count}" for pair, count in rest)
        medians = [_median(table, name, case, excluded) for case in of_cases]
        least = [own[winners(own, excluded)[0]].best for own in of_cases.values()]
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = number(float(np.nanmedian(np.divide(medians, least))), 2)
        return [
            f"{first} has the smallest {what} in {most} of {len(of_cases)} cases{others}.",
            f"The smallest error of a case is {factor} times smaller than the median of all its runs (median over the "
            "cases).",
        ]
    return [_best_of_case(table, roles, name, case, of_cases[case], excluded) for case in of_cases]


def _best_of_case(
    table: Any, roles: ColumnRoles, name: str, case: str, of_case: dict[str, Cell], excluded: set[str]
) -> str:
    """Return the sentence on the best pairs of one case, with the varied values of the best run of the first."""
    best = winners(of_case, excluded)
    row = of_case[best[0]].row
    values = {path: as_label(texts(table[path].iloc[[row]])[0]) for path in roles.varied}
    where = ", ".join(f"{path.rpartition('.')[2]} {value}" for path, value in values.items() if value)
    named = f"{', '.join(best[:-1])} and {best[-1]} have" if best[1:] else f"{best[0]} has"
    median = value_words(_median(table, name, case, excluded), name)
    return (
        f"In {case}, {named} the smallest {roles.measures[name].removesuffix(' [%]')}: "
        f"{value_words(of_case[best[0]].best, name)}{f' ({where})' if where else ''}; "
        f"the median of all runs is {median}."
    )


def _median(table: Any, name: str, case: str, excluded: set[str]) -> float:
    own = (table["status"] == "done") & (table["case"] == case) & ~np.isin(methods(table), list(excluded))
    return float(np.nanmedian(numbers(table.loc[own, name])))


def _failed_sentence(table: Any) -> str:
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


def _dependence_sentence(table: Any, roles: ColumnRoles, name: str) -> list[str]:
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


def _factor(done: Any, roles: ColumnRoles, path: str, name: str) -> float:
    """Return the median ratio of largest to smallest error over one varied value with all others held; else nan."""
    groups: dict[Any, dict[str, float]] = {}
    held = [texts(done[other]) for other in (*roles.varied, "case") if other != path]
    for value, error, *key in zip(texts(done[path]), numbers(done[name]), methods(done), *held, strict=True):
        if value and error > 0:
            groups.setdefault(tuple(key), {})[value] = error
    ratios = [max(own.values()) / min(own.values()) for own in groups.values() if len(own) > 1]
    return float(np.median(ratios)) if ratios else np.nan
