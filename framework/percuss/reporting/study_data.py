"""Data behind the report of a study: values and roles of its columns, bins of axes, statistics of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import QUANTITIES, of_column, ranking, with_unit
from percuss.jsonable import Entries
from percuss.methods.interfaces import Floats, Integers
from percuss.studies import perform
from percuss.studies.tasks import TIED

if TYPE_CHECKING:
    import pandas as pd

    from percuss.studies.study_table import Study

WAITING = perform.WAITING
# What is shown of several runs of one pair of methods.
STATISTICS = {"best": "min", "median": "median"}


def numbers(column: Any) -> Any:
    """Return a column as float64 with nan for missing values, or None if it holds anything but numbers."""
    import pandas as pd

    kinds = ("integer", "floating", "mixed-integer-float", "empty")
    known = pd.api.types.infer_dtype(column, skipna=True) in kinds
    return column.to_numpy(dtype=float, na_value=np.nan) if known else None


def as_text(value: object) -> str:
    """Return a value of the table as text that reads back as the same value; an empty text for a missing value."""
    if value is None or (isinstance(value, (float, np.floating)) and np.isnan(value)):
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    # repr gives the fewest digits that read back as the same double; the .0 of a whole number is superfluous.
    return repr(float(value)).removesuffix(".0") if isinstance(value, (float, np.floating)) else str(value)


def texts(column: Any) -> list[str]:
    """Return the values of a column as texts, empty for missing values."""
    return [as_text(value) for value in column.tolist()]


def methods(table: pd.DataFrame) -> list[str]:
    """Return the pair of methods of each row as one text: integrator + contact law."""
    pairs = zip(texts(table["integrator"]), texts(table["contact"]), strict=True)
    return [f"{integrator} + {contact}" for integrator, contact in pairs]


def in_order(values: Sequence[str]) -> list[str]:
    """Return the distinct texts in order: numbers by value, then words, then the empty text."""

    def rank(value: str) -> tuple[int, float, str]:
        try:
            return (0, float(value), value)
        except ValueError:
            return (2 if value == "" else 1, 0.0, value)

    return sorted(set(values), key=rank)


# ------------------------------------------------------------------------------------------------------------- columns


# Labels of the measures, in their order on the page: the comparisons with the exact solution come first.
MEASURES = {
    **{name: quantity.label for name, quantity in QUANTITIES.items() if quantity.against_exact},
    **{name: quantity.label for name, quantity in QUANTITIES.items() if quantity.path or quantity.metric},
    **dict.fromkeys(("seconds.march", "seconds"), "seconds of the time steps"),
}

# Measures of the cost of a run; the first does not depend on the machine.
COSTS = ("node_steps", "seconds", "seconds.march", "steps")

ABOUT = ("case", "integrator", "contact", "status", "reason", "said_by", "fragile", "key")


@dataclass(frozen=True)
class ColumnRoles:
    """The roles of the columns of a study's table.

    Attributes
    ----------
    varied
        Paths of the varied values.
    measures
        Names of the measured columns with their labels; columns without any number are left out.
    costs
        Names of the measures that are costs of a run.
    """

    varied: tuple[str, ...]
    measures: dict[str, str]
    costs: tuple[str, ...]


def columns(study: Study) -> ColumnRoles:
    """Return the roles of the columns of a study's table: varied values, measures and costs."""
    others = [str(name) for name in study.table.columns if name not in ABOUT]
    varied = [name for name in others if name not in study.columns]
    named = dict.fromkeys([*(name for name in MEASURES if name in study.columns), *study.columns])
    values = {name: numbers(study.table[name]) for name in named if name in others}
    measured = [name for name, column in values.items() if column is not None and np.isfinite(column).any()]
    labels = {}
    for name, quantity in ((name, of_column(name)) for name in measured):
        label = MEASURES.get(name) or quantity.label.replace("_", " ")
        labels[name] = with_unit(label, quantity.unit, study.units) + " [%]" * quantity.is_fraction
    if {"seconds", "seconds.march"} <= set(labels):
        labels["seconds"] += ", the least of its repeats"
    return ColumnRoles(tuple(varied), labels, tuple(name for name in COSTS if name in labels))


def records(table: pd.DataFrame, roles: ColumnRoles) -> list[Entries]:
    """Return the rows as a verdict takes them: methods, varied values, status, measures and reasons; None for nan."""
    about = ["status", "reason", "said_by", "fragile"]
    keys = list(dict.fromkeys(["case", "integrator", "contact", *roles.varied, *about, *roles.measures]))
    rows: list[Entries] = table[keys].astype(object).where(table[keys].notna(), None).to_dict("records")
    return rows


# ---------------------------------------------------------------------------------------------------------------- axes


DISTINCT = 40  # More distinct values than this are put in bins.
BINS = 24
FAR = 8  # between the smallest and the largest of numbers on a logarithmic axis
ROUND_OFF = 1e-10  # A logarithmic axis does not reach below this fraction of the largest number.


def may_be_log(values: Floats) -> bool:
    """Return whether a logarithmic axis can show all numbers: there is at least one, and all are above zero."""
    finite = values[np.isfinite(values)]
    return bool(finite.size) and bool((finite > 0).all())


def lowest(values: Floats) -> float:
    """Return the lower edge of a logarithmic axis; smaller numbers are zero but for round-off and drawn at the edge."""
    finite = values[np.isfinite(values)]
    return float(max(finite.min(), ROUND_OFF * finite.max()))


def is_log(values: Floats) -> bool:
    """Return whether numbers suit a logarithmic axis: all above zero, and spread far."""
    return may_be_log(values) and bool(np.nanmax(values) >= FAR * np.nanmin(values))


def binned(values: Floats, most: int = DISTINCT, bins: int = BINS) -> tuple[Floats, Integers]:
    """Return the place of each bin on the axis, and the number of the bin of each value, -1 for a value without one.

    Up to `most` distinct values have one bin each. More are put in `bins` bins of equal width, in the logarithm where
    `is_log` holds.
    """
    good = np.isfinite(values)
    distinct, own = np.unique(values[good], return_inverse=True)
    bin_of = np.full(values.size, -1)
    if distinct.size <= most:
        bin_of[good] = own
        return distinct, bin_of
    log = is_log(values)
    good &= (values > 0) | (not log)
    scaled = np.log10(values[good]) if log else values[good]
    edges = np.linspace(scaled.min(), scaled.max(), bins + 1)
    bin_of[good] = np.clip(np.searchsorted(edges, scaled, side="right") - 1, 0, bins - 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    return (10**middles if log else middles), bin_of


# ---------------------------------------------------------------------------------------------------------- statistics


PENDING = (WAITING, "lost")  # Nothing is known of these runs, which are still to be made or to be made again.


def problems(table: pd.DataFrame, varied: Sequence[str]) -> pd.DataFrame:
    """Return the number of the problem and the pair of methods of each run, by the row of the run.

    A problem is a case with one value of each varied path that is not an option of a method: a pair may have several
    runs of it, one for each value of its options. The references with mesh tying do not compete.
    """
    import pandas as pd

    paths = ["case", *(path for path in varied if path.split(".")[0] != "method")]
    points = pd.Series(list(zip(*(texts(table[path]) for path in paths), strict=True)), dtype=object)
    runs = pd.DataFrame({"problem": pd.factorize(points)[0], "pair": methods(table)})
    return runs[(table["contact"] != TIED).to_numpy()]


@dataclass(frozen=True)
class Profile:
    """A performance profile: the share of problems on which each pair of methods is within a factor of the best pair.

    Attributes
    ----------
    counted
        Number of problems in the profile.
    left_out
        Number of problems that some pair was not set.
    unknown
        Number of problems left out because one of their runs is still to be made, is done without the measure or has
        a measure below zero, or because no pair has a value.
    ratios
        For each pair of methods the ratios of its measure to that of the best pair, in rising order: at least 1,
        infinite where it has no value.
    """

    counted: int
    left_out: int
    unknown: int
    ratios: Entries


def profile(table: pd.DataFrame, name: str, problem_set: pd.DataFrame, statistic: str = "best") -> Profile:
    """Return the performance profile of the pairs of methods by one measure that is better when smaller.

    A pair's value on a problem is the best or the median over its runs of it; a run that is not done counts as
    infinite. The profile of a pair at a factor tau is the fraction of problems whose ratio is at most tau (Dolan, More:
    Benchmarking optimization software with performance profiles, Math. Program. 91 (2002), doi 10.1007/s101070100263).
    """
    status, values = table["status"].to_numpy(), numbers(table[name])
    of_run = np.where(np.isin(status, PENDING), np.nan, np.where(status == "done", values, np.inf))
    runs = problem_set.assign(cost=of_run[problem_set.index]).groupby(["problem", "pair"])["cost"]
    cost = runs.agg(STATISTICS[statistic]).where(runs.count() == runs.size()).unstack("pair")  # unknown as one run is
    every = runs.size().unstack("pair").notna().all(axis=1)
    good = every & cost.notna().all(axis=1) & np.isfinite(cost).any(axis=1) & (cost >= 0).all(axis=1)
    cost = cost[good]
    least = cost.min(axis=1)
    # The best pairs have the ratio 1 also where their measure is zero.
    ratio = cost.div(least, axis=0).where(cost.ne(least, axis=0), 1.0)
    ratios = {str(pair): np.sort(ratio[pair].to_numpy(dtype=float)) for pair in ratio}
    return Profile(int(good.sum()), int((~every).sum()), int((every & ~good).sum()), ratios)


def dependence(table: pd.DataFrame, roles: ColumnRoles) -> list[str]:
    """Return the sentence on the factors by which the error changes over each varied value, all others held."""
    for error in ranking(roles.measures)[:1]:
        done = table[(table["status"] == "done") & (numbers(table[error]) > 0)].astype({error: float})
        factors: dict[str, float] = {}
        for path in roles.varied:
            held = ["case", "integrator", "contact", *(other for other in roles.varied if other != path)]
            alike = done[done[path].notna()].groupby(held, dropna=False)
            ratios = (alike[error].max() / alike[error].min())[alike[path].nunique() > 1]
            factors |= {path: float(ratios.median())} if len(ratios) else {}
        most = sorted(factors.items(), key=lambda item: -item[1])[:3]
        words = ", ".join(f"by a factor of {factor:.2g} with {path}" for path, factor in most)
        return [f"The error of a pair in a case changes {words} (medians)."] if words else []
    return []
