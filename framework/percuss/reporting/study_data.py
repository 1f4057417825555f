"""The table of a study: the roles of its columns, statistics of its runs, and the rows that fit on a page."""

from __future__ import annotations

import base64
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from percuss.case.quantities import QUANTITIES, TRUE_ERRORS
from percuss.reporting.figures import thinned
from percuss.studies.tasks import TIED

# Labels of the measures, in their order on the page: the comparisons with the exact solution come first.
MEASURES = {
    **{name: quantity.label for name, quantity in QUANTITIES.items() if quantity.against_exact},
    **{name: quantity.label for name, quantity in QUANTITIES.items() if quantity.path or quantity.metric},
    "seconds.march": "seconds of the march alone",
    "seconds": "seconds of the whole row, with loading, compiling, certificate and exact solution",
}
# Measures of the cost of a run; the first does not depend on the machine. `seconds` is one of them only where the study
# describes it, because it then is the time of the march alone.
COSTS = ("node_steps", "seconds", "seconds.march", "steps")
SECONDS_OF_MARCH = "seconds of the march alone"
# Ranked in addition to all measures with "error" in their names.
LESS_IS_BETTER = {name for name, quantity in QUANTITIES.items() if quantity.is_error}
ABOUT = ("case", "integrator", "contact", "status", "reason", "said_by", "fragile", "key")
MOST_ROWS = 5000  # A browser draws and sorts this many rows without a pause; the best runs are added to them.
MOST_HISTORIES = 120
MOST_LETTERS = 2_000_000  # The histories of a page may take this many letters of base64.
MOST_ASKED = 1000  # At most this many runs are asked for their histories.
MOST_CONTACTS = 4
MOST_FACTOR = 100.0  # Cells whose median is this many times the smallest one of the case, or more, have one colour.
SHADES = ((0xFF, 0xFB, 0xE6), (0xE8, 0x8A, 0x3C))  # Both colours of cells are light enough for dark letters.
POINTS = 400  # A history is thinned to this many points, which include its extremes.
DISTINCT = 40  # More distinct values than this are put in bins.
BINS = 24
MAP_DISTINCT, MAP_BINS = 16, 12  # These are the limits for each side of a map.
MOST_MAPPED = 4  # Each pair of this many varied values has a map of all rows.
QUANTILES = (0.1, 0.5, 0.9)
SEED = 0
# These varied paths choose the pair of methods itself, so they do not define a problem.
CHOICES = ("method.integrator", "method.integrator.name", "method.contact", "method.contact.name")
WAITING = "waiting"  # The status of a run that is still to be made.
PENDING = (WAITING, "lost")  # Nothing is known of these runs, which are still to be made or to be made again.
# Numbers whose largest is this many times the smallest are on a logarithmic axis: a few or many distinct ones.
FAR_FEW, FAR_MANY = 8, 30
ROUND_OFF = 1e-10  # A logarithmic axis does not reach below this fraction of the largest number.


class StudyLike(Protocol):
    """The part of a study's interface that a report uses."""

    @property
    def title(self) -> str:
        """Title of the study in one line."""

    @property
    def spec(self) -> dict[str, Any]:
        """The study file as plain data."""

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, machine, plug-ins and the command that made the study."""

    @property
    def table(self) -> Any:
        """The runs as a pandas DataFrame, one row per run."""

    def histories(self, key: Any) -> dict[str, Any] | None:
        """Return the histories of a run, or None if they were not kept.

        The keys are ``time``, ``contact_force``, ``contact_force_exact`` and ``contact`` (names).
        """


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


def columns(study: StudyLike) -> ColumnRoles:
    """Return the roles of the columns of a study's table: varied values, measures and costs."""
    others = [str(name) for name in study.table.columns if name not in ABOUT]
    descriptions = words(study)
    if descriptions:
        varied = [name for name in others if name not in descriptions and name != "seconds"]
    else:
        named = {path for part in ("vary", "sample", "paired") for path in _paths_named(study.spec.get(part))}
        varied = [
            name for name in others if name in named or (name not in MEASURES and ("." in name or name == "refine"))
        ]
    standard = [name for name in MEASURES if name in others and name not in varied]
    further = [name for name in others if name not in varied and name not in MEASURES]
    numeric = [name for name in (*standard, *further) if numbers(study.table[name]) is not None]
    measured = [name for name in numeric if np.isfinite(_as_floats(study.table[name])).any()]
    labels = {name: MEASURES.get(name, name.replace("_", " ")) for name in measured}
    costs = [name for name in COSTS if name in labels and (name != "seconds" or "seconds" in descriptions)]
    if "seconds" in costs:
        labels["seconds"] = SECONDS_OF_MARCH + (", the least of its repeats" if "seconds.march" in labels else "")
    return ColumnRoles(tuple(varied), labels, tuple(costs))


def words(study: StudyLike) -> dict[str, str]:
    """Return the study's own description of each measured column; empty for a study without descriptions."""
    return dict(getattr(study, "columns", None) or {})


def _paths_named(part: Any) -> list[str]:
    """Return the paths named by one part of a study file: a mapping, a list of mappings, or a sample with its `of`."""
    if isinstance(part, dict):
        return [str(path) for path in part.get("of", part)]
    return [path for item in part for path in _paths_named(item)] if isinstance(part, list) else []


def numbers(column: Any) -> Any:
    """Return a column as float64 with nan for missing values, or None if it holds anything but numbers."""
    if column.dtype.kind in "iuf":
        return _as_floats(column)
    present = column[column.notna()]
    if not all(isinstance(v, (int, float, np.number)) and not isinstance(v, (bool, np.bool_)) for v in present):
        return None
    return _as_floats(column)


def _as_floats(column: Any) -> Any:
    return column.to_numpy(dtype=float, na_value=np.nan)


def as_text(value: Any) -> str:
    """Return a value of the table as text that reads back as the same value; an empty text for a missing value."""
    if value is None or (isinstance(value, (float, np.floating)) and np.isnan(value)):
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    # repr gives the fewest digits that read back as the same double; the .0 of a whole number is superfluous.
    return repr(float(value)).removesuffix(".0") if isinstance(value, (float, np.floating)) else str(value)


def as_label(text: str) -> str:
    """Return the label of a text from `as_text`: a number with six digits, any other text unchanged."""
    try:
        return f"{float(text):.6g}" if text.strip() == text and text[:1] in "-.0123456789" else text
    except ValueError:
        return text


def texts(column: Any) -> list[str]:
    """Return the values of a column as texts, empty for missing values."""
    missing = column.isna().tolist()
    return ["" if is_missing else as_text(value) for value, is_missing in zip(column.tolist(), missing, strict=True)]


def methods(table: Any) -> list[str]:
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


def ranking(roles: ColumnRoles) -> list[str]:
    """Return the measures by which runs are ranked, all of them better when smaller; true errors come first."""
    ranked = [name for name in roles.measures if "error" in name or name in LESS_IS_BETTER]
    return sorted(ranked, key=lambda name: name not in TRUE_ERRORS)


@dataclass(frozen=True)
class Carried:
    """The rows of a study that a page carries.

    Attributes
    ----------
    table
        The rows, in the order of the study.
    drawn
        Mask (rows,) of the random sample of all rows; the other rows are added because no run beats them.
    best
        Number of runs that no other run beats, drawn or not; 0 where the page carries all rows.
    """

    table: Any
    drawn: Any
    best: int


def carried(table: Any, roles: ColumnRoles) -> Carried:
    """Return all rows, or a seeded random sample and all `best_runs` where there are too many for a page."""
    if len(table) <= MOST_ROWS:
        return Carried(table.reset_index(drop=True), np.ones(len(table), dtype=bool), 0)
    drawn = np.zeros(len(table), dtype=bool)
    drawn[np.random.default_rng(SEED).choice(len(table), MOST_ROWS, replace=False)] = True
    best = best_runs(table, roles)
    kept = drawn | best
    return Carried(table[kept].reset_index(drop=True), drawn[kept], int(best.sum()))


def best_runs(table: Any, roles: ColumnRoles) -> Any:
    """Return a mask (rows,) of the runs that no other run of the same case and the same pair of methods beats.

    For each measure of `ranking` these are the run with its smallest value and the runs on its Pareto front against
    each cost. A run without a number for a measure takes no part in the ranking by it.
    """
    done = (table["status"] == "done").to_numpy()
    costs = [numbers(table[name]) for name in roles.costs]
    errors = [numbers(table[name]) for name in ranking(roles)]
    best = np.zeros(len(table), dtype=bool)
    for rows in _by_case_and_method(table, done):
        for error in errors:
            finite = rows[np.isfinite(error[rows])]
            if finite.size:
                best[finite[np.argmin(error[finite])]] = True
            for cost in costs:
                best[rows[front_of(cost[rows], error[rows])]] = True
    return best


def _by_case_and_method(table: Any, mask: Any) -> Iterator[Any]:
    """Yield the row numbers of each case and pair of methods, among the rows selected by a mask."""
    rows = np.flatnonzero(mask)
    labels = [f"{case}\0{method}" for case, method in zip(texts(table["case"]), methods(table), strict=True)]
    groups = np.unique(np.array(labels, dtype=object)[rows].astype(str), return_inverse=True)[1] if rows.size else rows
    order = np.argsort(groups, kind="stable")
    for part in np.split(rows[order], np.flatnonzero(np.diff(groups[order])) + 1):
        if part.size:
            yield part


def packed(values: Any, kind: str = "<f4") -> str:
    """Return numbers as base64 of their bytes; a number too large for `kind` becomes infinite, a missing one nan."""
    with np.errstate(over="ignore"):
        return base64.b64encode(np.asarray(values, dtype=float).astype(kind).tobytes()).decode("ascii")


def may_be_log(values: Any) -> bool:
    """Return whether a logarithmic axis can show all numbers: there is at least one, and all are above zero."""
    finite = values[np.isfinite(values)]
    return bool(finite.size) and bool((finite > 0).all())


def lowest(values: Any) -> float:
    """Return the lower edge of a logarithmic axis; smaller numbers are zero but for round-off and drawn at the edge."""
    finite = values[np.isfinite(values)]
    return float(max(finite.min(), ROUND_OFF * finite.max()))


def is_log(values: Any) -> bool:
    """Return whether numbers suit a logarithmic axis: all above zero, and spread far or in geometric progression."""
    if not may_be_log(values):
        return False
    finite = values[np.isfinite(values)]
    above = finite[finite >= lowest(values)]
    distinct = np.unique(above)
    steps = distinct[1:] / distinct[:-1]
    few = distinct.size <= DISTINCT
    multiples = few and distinct.size > 2 and bool(np.allclose(steps, steps[0], rtol=1e-6))
    return multiples or bool(distinct[-1] / (FAR_FEW if few else FAR_MANY) >= distinct[0])


def binned(values: Any, most: int = DISTINCT, bins: int = BINS) -> tuple[Any, Any]:
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


def lacking(table: Any, path: str) -> set[str]:
    """Return the pairs of methods whose runs all lack a varied value, because they have no such option or leave it out.

    Their runs are the same at every value of the path.
    """
    present = table[path].notna().to_numpy()
    method_of_row = methods(table)
    return set(method_of_row) - {method for method, has_value in zip(method_of_row, present, strict=True) if has_value}


def bands(table: Any, names: Sequence[str], path: str) -> Iterator[tuple[str, str, Any]]:
    """Yield the median and the quantile band of each measure over one varied value, for each pair of methods.

    Yields
    ------
    tuple
        Pair of methods, measure, and an array (6, bins): the place of each bin on the axis, the three `QUANTILES` over
        the runs that have the measure, the number of these runs, and the number of runs made. A pair that lacks the
        value has one bin, whose place is nan.
    """
    made = table[table["status"] != WAITING]
    values = numbers(made[path])
    if values is None or not np.isfinite(values).any():
        return
    places, bin_of = binned(values)
    method_of_row, done = np.array(methods(made)), (made["status"] == "done").to_numpy()
    without = lacking(made, path)
    measured = made[list(names)].astype(float).to_numpy()
    for method in dict.fromkeys(method_of_row.tolist()):
        own = method_of_row == method
        bins = (
            [(np.nan, own)] if method in without else [(place, own & (bin_of == k)) for k, place in enumerate(places)]
        )
        runs = [(place, np.flatnonzero(in_bin & done), int(in_bin.sum())) for place, in_bin in bins]
        for n, name in enumerate(names):
            yield method, name, _band(runs, measured[:, n])


def _band(runs: Sequence[tuple[float, Any, int]], values: Any) -> Any:
    """Return place, quantiles, number of values and number of runs of each bin that has a run: array (6, bins)."""
    out = []
    for place, rows, count in runs:
        own = values[rows]
        own = own[np.isfinite(own)]
        quantiles = np.quantile(own, QUANTILES) if own.size else np.full(len(QUANTILES), np.nan)
        if count:
            out.append((place, *quantiles, own.size, count))
    return np.array(out).reshape(-1, 6).T


def maps(table: Any, names: Sequence[str], paths: Sequence[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield a map over each two varied numbers, with counts of runs by status and medians of the done runs in cells.

    Yields
    ------
    tuple
        The path across, the path up, and a dictionary of ``across`` and ``up`` (the places of the cells) and
        ``methods``: for each pair of methods the counts ``done``, ``unstable`` and ``other`` and the median of each
        measure, cells in rows from below. A pair that lacks a varied value has one cell along it. Where some done
        runs lack a measure, the number of those that have it is given as the measure's name followed by ``|known``.
    """
    made = table[table["status"] != WAITING]
    method_of_row, status = np.array(methods(made)), made["status"].to_numpy()
    kinds = {"done": status == "done", "unstable": status == "unstable"}
    kinds["other"] = ~(kinds["done"] | kinds["unstable"])
    numeric = {path: numbers(made[path]) for path in paths}
    placed = {
        path: binned(values, MAP_DISTINCT, MAP_BINS)
        for path, values in numeric.items()
        if values is not None and np.unique(values[np.isfinite(values)]).size > 1
    }
    without = {path: lacking(made, path) for path in placed}
    for x, y in itertools.combinations(list(placed)[:MOST_MAPPED], 2):
        of_methods = {}
        for method in dict.fromkeys(method_of_row.tolist()):
            (wide, i), (high, j) = (
                (1, np.zeros(len(made), dtype=int)) if method in without[path] else (places.size, bin_of)
                for path, (places, bin_of) in ((x, placed[x]), (y, placed[y]))
            )
            own = (method_of_row == method) & (i >= 0) & (j >= 0)
            cell, size = np.where(own, j * wide + i, -1), wide * high
            counts = {kind: np.bincount(cell[own & mask], minlength=size) for kind, mask in kinds.items()}
            done_runs = made.loc[own & kinds["done"], list(names)].astype(float).groupby(cell[own & kinds["done"]])
            medians, with_number = (
                statistic.reindex(range(size)) for statistic in (done_runs.median(), done_runs.count())
            )
            for name in names if counts["done"].any() else ():
                counts[name] = medians[name].to_numpy()
                if (with_number[name].fillna(0).to_numpy() < counts["done"]).any():
                    counts[f"{name}|known"] = with_number[name].fillna(0).to_numpy()
            of_methods[method] = counts
        yield x, y, {"across": placed[x][0], "up": placed[y][0], "methods": of_methods}


def front_of(cost: Any, error: Any) -> Any:
    """Return the row numbers of the Pareto front of error against cost, by rising cost, of runs that have both."""
    rows = np.flatnonzero(np.isfinite(cost) & np.isfinite(error))
    rows = rows[np.lexsort((error[rows], cost[rows]))]
    best = np.minimum.accumulate(error[rows]) if rows.size else error[rows]
    kept = np.ones(rows.size, dtype=bool)
    kept[1:] = error[rows][1:] < best[:-1]
    return rows[kept]


def front(cost: Any, error: Any) -> Any:
    """Return the Pareto front of error against cost, by rising cost: costs and errors, (2, n)."""
    rows = front_of(cost, error)
    return np.vstack([cost[rows], error[rows]])


def references(table: Any) -> list[str]:
    """Return the pairs of methods with mesh tying in place of a contact law.

    They need the exact solution, so they are references and do not compete with the methods.
    """
    pairs = zip(methods(table), texts(table["contact"]), strict=True)
    return list(dict.fromkeys(method for method, contact in pairs if contact == TIED))


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


@dataclass(frozen=True)
class Problems:
    """The problems of a study that every pair of methods was set once: a case with one value of each varied path.

    Attributes
    ----------
    solvers
        The pairs of methods; the references with mesh tying are not among them.
    rows
        Row number of the run of each pair on each problem, (problems, solvers).
    left_out
        Number of problems that some pair was not set, or was set more than once.
    """

    solvers: list[str]
    rows: Any
    left_out: int


def problems(table: Any, varied: Sequence[str]) -> Problems:
    """Return the problems of a study; the one run of a pair that lacks a varied value counts at each value of it."""
    method_of_row, excluded = methods(table), set(references(table))
    solvers = [method for method in dict.fromkeys(method_of_row) if method not in excluded]
    paths = [path for path in varied if path not in CHOICES]
    without = {path: lacking(table, path) & set(solvers) for path in paths}
    # A pair that lacks a value which other pairs have does not define problems of its own.
    partial = {method for pairs in without.values() if len(pairs) < len(solvers) for method in pairs}
    runs: dict[Any, list[int]] = {}
    points: dict[Any, None] = {}
    columns_of_text = [texts(table[path]) for path in paths]
    for row, (method, *point) in enumerate(zip(method_of_row, texts(table["case"]), *columns_of_text, strict=True)):
        runs.setdefault((method, *point), []).append(row)
        if method not in partial and method not in excluded:
            points[tuple(point)] = None
    kept = []
    for case, *values in points:
        point_of = {
            method: ["" if method in without[path] else value for path, value in zip(paths, values, strict=True)]
            for method in solvers
        }
        own = [runs.get((method, case, *point_of[method]), []) for method in solvers]
        if all(len(rows) == 1 for rows in own):
            kept.append([rows[0] for rows in own])
    rows = np.array(kept, dtype=int).reshape(len(kept), len(solvers))
    return Problems(solvers, rows, len(points) - len(kept))


@dataclass(frozen=True)
class Profile:
    """A performance profile: the share of problems on which each pair of methods is within a factor of the best pair.

    Attributes
    ----------
    counted
        Number of problems in the profile.
    unknown
        Number of problems left out because one of their runs is still to be made, is done without the measure or has
        a measure below zero, or because none of their runs is done.
    ratios
        For each pair of methods the ratios of its measure to that of the best pair, in rising order: at least 1,
        infinite where its run is not done.
    """

    counted: int
    unknown: int
    ratios: dict[str, Any]


def profile(table: Any, name: str, problem_set: Problems) -> Profile:
    """Return the performance profile of the pairs of methods by one measure that is better when smaller.

    The profile of a pair at a factor tau is the fraction of problems whose ratio is at most tau (Dolan, More:
    Benchmarking optimization software with performance profiles, Math. Program. 91 (2002), doi 10.1007/s101070100263).
    """
    status = table["status"].to_numpy()[problem_set.rows]
    values = numbers(table[name])[problem_set.rows]
    cost = np.where(np.isin(status, PENDING), np.nan, np.where(status == "done", values, np.inf))
    with np.errstate(invalid="ignore"):
        good = ~np.isnan(cost).any(axis=1) & np.isfinite(cost).any(axis=1) & (cost >= 0).all(axis=1)
    cost = cost[good]
    least = cost.min(axis=1, keepdims=True, initial=np.inf)
    # The best pairs have the ratio 1 also where their measure is zero.
    ratio = np.divide(cost, least, out=np.where(cost == least, 1.0, np.inf), where=least > 0)
    ratios = {method: np.sort(ratio[:, k]) for k, method in enumerate(problem_set.solvers)}
    return Profile(int(good.sum()), int((~good).sum()), ratios)


def lost(table: Any) -> list[dict[str, Any]]:
    """Return the reasons why runs are not done, most frequent first; reasons that differ by numbers alone are one."""
    rows = table[~table["status"].isin(["done", WAITING])]
    pairs = methods(rows)
    sources, reasons, status = (texts(rows[name]) for name in ("said_by", "reason", "status"))
    groups: dict[Any, dict[str, Any]] = {}
    for entry in zip(status, pairs, sources, reasons, strict=True):
        kind = (*entry[:3], re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", entry[3]))
        group = groups.setdefault(kind, dict(zip(("status", "method", "said_by", "reason"), entry, strict=True)))
        group["count"] = group.get("count", 0) + 1
    return sorted(groups.values(), key=lambda group: -int(group["count"]))


def kept_histories(study: StudyLike, table: Any) -> dict[int, dict[str, Any]]:
    """Return thinned histories by row number, for some of the rows.

    The rows are taken from each pair of methods in turn, its best run first and then spread over its runs.
    """
    turns: dict[str, list[int]] = {}
    for row, (method, status) in enumerate(zip(methods(table), texts(table["status"]), strict=True)):
        if status in {"done", "unstable", "interrupted"}:
            turns.setdefault(method, []).append(row)
    queues = [
        iter(dict.fromkeys([*_best_run(table, rows), *_spread_rows(rows, MOST_ASKED)])) for rows in turns.values()
    ]
    # More rows are asked for than are wanted, because a study may have kept the histories of some runs only.
    in_turn = (row for turn in itertools.zip_longest(*queues) for row in turn if row is not None)
    out: dict[int, dict[str, Any]] = {}
    letters = 0
    for row in itertools.islice(in_turn, MOST_ASKED):
        history = study.histories(table["key"].iloc[row])
        if history is not None:
            out[row] = _packed_history(history)
            letters += sum(len(part) for name in ("force", "exact") for line in out[row][name] for part in line)
        if len(out) == MOST_HISTORIES or letters > MOST_LETTERS:
            break
    return dict(sorted(out.items()))


def _best_run(table: Any, rows: list[int]) -> list[int]:
    """Return the done run with the smallest force error among some rows, as a list of one row or none."""
    if "force_error_l1" not in table:
        return []
    own = table.iloc[rows]
    errors = numbers(own["force_error_l1"].where(own["status"] == "done"))
    return [rows[int(np.nanargmin(errors))]] if errors is not None and np.isfinite(errors).any() else []


def _spread_rows(rows: list[int], most: int) -> list[int]:
    """Return at most `most` rows in an order in which any beginning of the list is spread over all rows."""
    steps = np.arange(1, min(most, len(rows)) + 1)
    golden = np.floor(np.modf(steps * 0.6180339887498949)[0] * len(rows)).astype(int)
    return [rows[k] for k in dict.fromkeys([0, *golden.tolist(), *range(min(most, len(rows)))])]


def _packed_history(history: dict[str, Any]) -> dict[str, Any]:
    time = np.asarray(history["time"], dtype=float)

    def lines(name: str) -> list[list[str]]:
        values = history.get(name)
        if values is None:
            return []
        force = np.asarray(values, dtype=float).reshape(time.size, -1)
        return [[packed(part) for part in thinned(time, curve, POINTS)] for curve in force.T[:MOST_CONTACTS]]

    names = [str(name) for name in history.get("contact", [])][:MOST_CONTACTS]
    return {"contacts": names, "force": lines("contact_force"), "exact": lines("contact_force_exact")}
