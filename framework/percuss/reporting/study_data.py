"""What a study's table holds: which column is what, and what of it a page or a picture can carry."""

from __future__ import annotations

import base64
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from percuss.reporting.figures import thinned
from percuss.studies.tasks import TIED

MEASURES = {
    "force_error_l1": "force error, L1",
    "force_error_l2": "force error, L2",
    "impulse_error": "error of the cumulative impulse",
    "displacement_error": "displacement error, L2",
    "noise": "noise of the force",
    "overshoot": "overshoot of the peak",
    "penetration": "largest penetration",
    "peak_force": "peak force",
    "impulse": "impulse",
    "energy_kept": "energy kept at the end",
    "energy_max": "largest energy",
    "energy_growth": "growth of energy",
    "ledger_error": "closure of the energy ledger",
    "courant_critical": "critical Courant number",
    "node_steps": "steps times nodes",
    "seconds.march": "seconds of the march alone",
    "steps": "steps",
    "seconds": "seconds of the whole row, with loading, compiling, certificate and exact solution",
}
# What a run costs, the cost that no machine can blur first; `seconds` where the study says that it is the march's.
COSTS = ("node_steps", "seconds", "seconds.march", "steps")
SECONDS_OF_MARCH = "seconds of the march alone"
LESS_IS_BETTER = ("penetration", "ledger_error", "energy_growth")  # beside all measures with "error" in their names
TRUE_ERRORS = ("force_error_l1", "force_error_l2", "impulse_error", "displacement_error")
ABOUT = ("case", "integrator", "contact", "status", "reason", "said_by", "fragile", "key")
MOST_ROWS = 5000  # of which a browser draws and sorts every one without a pause; the best runs come on top of them
MOST_HISTORIES = 120
MOST_LETTERS = 2_000_000  # of base64 that all histories of a page may take
MOST_ASKED = 1000  # runs that are asked for their history
MOST_CONTACTS = 4
MOST_FACTOR = 100.0  # over the least of a case: from here on cells have one colour
SHADES = ((0xFF, 0xFB, 0xE6), (0xE8, 0x8A, 0x3C))  # of cells, both light enough for dark letters
POINTS = 400  # of a history, its extremes kept
DISTINCT = 40  # more values than that are put in bins
BINS = 24
MAP_DISTINCT, MAP_BINS = 16, 12  # along each side of a map
MOST_MAPPED = 4  # varied values, each pair of which has a map of all rows
QUANTILES = (0.1, 0.5, 0.9)
SEED = 0
# varied paths that choose the pair itself, and so belong to no problem
CHOICES = ("method.integrator", "method.integrator.name", "method.contact", "method.contact.name")
WAITING = "waiting"  # a run that is still to be made
PENDING = (WAITING, "lost")  # runs of which nothing is known, as they are still to be made or to be made again
FAR_FEW, FAR_MANY = 8, 30  # times the smallest: spread so far, distinct numbers are on a logarithmic axis
ROUND_OFF = 1e-10  # of the largest: a logarithmic axis does not reach lower


class StudyLike(Protocol):
    """What a report needs of a study."""

    @property
    def title(self) -> str:
        """One line that says what it is."""

    @property
    def spec(self) -> dict[str, Any]:
        """The study file as plain data."""

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, machine, plug-ins and the command."""

    @property
    def table(self) -> Any:
        """A pandas DataFrame, a row a run."""

    def histories(self, key: Any) -> dict[str, Any] | None:
        """Return ``time``, ``contact_force``, ``contact_force_exact``, ``contact`` (names); None if not kept."""


@dataclass(frozen=True)
class Columns:
    """The columns of a study's table by what they are.

    Attributes
    ----------
    varied
        Paths of the varied values.
    measures
        What was measured, with the words for it; columns without any number are left out.
    costs
        Those of the measures that are costs.
    """

    varied: tuple[str, ...]
    measures: dict[str, str]
    costs: tuple[str, ...]


def columns(study: StudyLike) -> Columns:
    """Return which columns of a study's table were varied and which measured."""
    others = [str(name) for name in study.table.columns if name not in ABOUT]
    told = words(study)
    if told:
        varied = [name for name in others if name not in told and name != "seconds"]
    else:
        named = {path for part in ("vary", "sample", "paired") for path in _paths(study.spec.get(part))}
        varied = [n for n in others if n in named or (n not in MEASURES and ("." in n or n == "refine"))]
    known = [name for name in MEASURES if name in others and name not in varied]
    more = [name for name in others if name not in varied and name not in MEASURES]
    numeric = [name for name in (*known, *more) if numbers(study.table[name]) is not None]
    measured = [name for name in numeric if np.isfinite(_as_floats(study.table[name])).any()]
    labels = {name: MEASURES.get(name, name.replace("_", " ")) for name in measured}
    costs = [name for name in COSTS if name in labels and (name != "seconds" or "seconds" in told)]
    if "seconds" in costs:
        labels["seconds"] = SECONDS_OF_MARCH + (", the least of its repeats" if "seconds.march" in labels else "")
    return Columns(tuple(varied), labels, tuple(costs))


def words(study: StudyLike) -> dict[str, str]:
    """Return what each measured column is, in the study's own words; empty for a study that says nothing of it."""
    return dict(getattr(study, "columns", None) or {})


def _paths(part: Any) -> list[str]:
    """Return the paths that one part of a study file names: a mapping, a list of mappings, or a sample `of` one."""
    if isinstance(part, dict):
        return [str(path) for path in part.get("of", part)]
    return [path for item in part for path in _paths(item)] if isinstance(part, list) else []


def numbers(column: Any) -> Any:
    """Return a column as float64 with nan for what is missing, or None if it holds anything but numbers."""
    if column.dtype.kind in "iuf":
        return _as_floats(column)
    present = column[column.notna()]
    if not all(isinstance(v, (int, float, np.number)) and not isinstance(v, (bool, np.bool_)) for v in present):
        return None
    return _as_floats(column)


def _as_floats(column: Any) -> Any:
    return column.to_numpy(dtype=float, na_value=np.nan)


def as_text(value: Any) -> str:
    """Return a value of the table as text that reads back as the same value; nothing for what is missing."""
    if value is None or (isinstance(value, (float, np.floating)) and np.isnan(value)):
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    # the shortest digits that give the same double, without the .0 of a whole number
    return repr(float(value)).removesuffix(".0") if isinstance(value, (float, np.floating)) else str(value)


def as_label(text: str) -> str:
    """Return a text of `as_text` as it is shown to a reader: a number with six digits."""
    try:
        return f"{float(text):.6g}" if text.strip() == text and text[:1] in "-.0123456789" else text
    except ValueError:
        return text


def texts(column: Any) -> list[str]:
    """Return a column as text."""
    missing = column.isna().tolist()
    return ["" if gone else as_text(value) for value, gone in zip(column.tolist(), missing, strict=True)]


def methods(table: Any) -> list[str]:
    """Return the method of each row, as integrator and contact law."""
    pairs = zip(texts(table["integrator"]), texts(table["contact"]), strict=True)
    return [f"{integrator} + {contact}" for integrator, contact in pairs]


def in_order(values: Sequence[str]) -> list[str]:
    """Return the distinct values: numbers before words, each in order; nothing last."""

    def rank(value: str) -> tuple[int, float, str]:
        try:
            return (0, float(value), value)
        except ValueError:
            return (2 if value == "" else 1, 0.0, value)

    return sorted(set(values), key=rank)


def ranking(known: Columns) -> list[str]:
    """Return the measures by which runs can be ranked: those of which less is better, true errors first."""
    ranked = [name for name in known.measures if "error" in name or name in LESS_IS_BETTER]
    return sorted(ranked, key=lambda name: name not in TRUE_ERRORS)


@dataclass(frozen=True)
class Carried:
    """The rows of a study that a page carries.

    Attributes
    ----------
    table
        The rows, in the order of the study.
    drawn
        Which of them are a random sample of all rows; the others are there because no run beats them.
    best
        Number of runs that no other beats, drawn or not.
    """

    table: Any
    drawn: Any
    best: int


def carried(table: Any, known: Columns) -> Carried:
    """Return all rows; where a page cannot carry as many, a seeded random sample and all `best_runs`."""
    if len(table) <= MOST_ROWS:
        return Carried(table.reset_index(drop=True), np.ones(len(table), dtype=bool), 0)
    drawn = np.zeros(len(table), dtype=bool)
    drawn[np.random.default_rng(SEED).choice(len(table), MOST_ROWS, replace=False)] = True
    best = best_runs(table, known)
    kept = drawn | best
    return Carried(table[kept].reset_index(drop=True), drawn[kept], int(best.sum()))


def best_runs(table: Any, known: Columns) -> Any:
    """Return which runs no other run of the same case and the same pair of methods beats.

    Those are, for each measure of `ranking`, the run of its least value and the runs of its front against each cost.
    A run without a number for a measure takes no part in the ranking by it.
    """
    done = (table["status"] == "done").to_numpy()
    costs = [numbers(table[name]) for name in known.costs]
    errors = [numbers(table[name]) for name in ranking(known)]
    best = np.zeros(len(table), dtype=bool)
    for rows in _by_case_and_method(table, done):
        for error in errors:
            finite = rows[np.isfinite(error[rows])]
            if finite.size:
                best[finite[np.argmin(error[finite])]] = True
            for cost in costs:
                best[rows[front_of(cost[rows], error[rows])]] = True
    return best


def _by_case_and_method(table: Any, wanted: Any) -> Iterator[Any]:
    """Yield the places of the wanted rows of each case and pair of methods."""
    rows = np.flatnonzero(wanted)
    every = [f"{case}\0{method}" for case, method in zip(texts(table["case"]), methods(table), strict=True)]
    groups = np.unique(np.array(every, dtype=object)[rows].astype(str), return_inverse=True)[1] if rows.size else rows
    order = np.argsort(groups, kind="stable")
    for part in np.split(rows[order], np.flatnonzero(np.diff(groups[order])) + 1):
        if part.size:
            yield part


def packed(values: Any, kind: str = "<f4") -> str:
    """Return numbers as base64 of their bytes; what is too large becomes infinite, what is missing nan."""
    with np.errstate(over="ignore"):
        return base64.b64encode(np.asarray(values, dtype=float).astype(kind).tobytes()).decode("ascii")


def may_be_log(values: Any) -> bool:
    """Whether every number has a place on a logarithmic axis: there are some, and all are above zero."""
    finite = values[np.isfinite(values)]
    return bool(finite.size) and bool((finite > 0).all())


def lowest(values: Any) -> float:
    """Return the lower edge of a logarithmic axis: what is smaller is zero but for round-off, and drawn at the edge."""
    finite = values[np.isfinite(values)]
    return float(max(finite.min(), ROUND_OFF * finite.max()))


def is_log(values: Any) -> bool:
    """Whether numbers belong on a logarithmic axis: all above zero, and spread far or each a multiple of the last."""
    if not may_be_log(values):
        return False
    finite = values[np.isfinite(values)]
    above = finite[finite >= lowest(values)]
    distinct = np.unique(above)
    steps = distinct[1:] / distinct[:-1]
    boundary = distinct.size <= DISTINCT
    multiples = boundary and distinct.size > 2 and bool(np.allclose(steps, steps[0], rtol=1e-6))
    return multiples or bool(distinct[-1] / (FAR_FEW if boundary else FAR_MANY) >= distinct[0])


def binned(values: Any, most: int = DISTINCT, bins: int = BINS) -> tuple[Any, Any]:
    """Return the place on the axis of each bin and the bin of each value, -1 where it has none.

    Up to `most` distinct values are their own bins.
    """
    good = np.isfinite(values)
    distinct, own = np.unique(values[good], return_inverse=True)
    where = np.full(values.size, -1)
    if distinct.size <= most:
        where[good] = own
        return distinct, where
    log = is_log(values)
    good &= (values > 0) | (not log)
    scaled = np.log10(values[good]) if log else values[good]
    edges = np.linspace(scaled.min(), scaled.max(), bins + 1)
    where[good] = np.clip(np.searchsorted(edges, scaled, side="right") - 1, 0, bins - 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    return (10**middles if log else middles), where


def lacking(table: Any, path: str) -> set[str]:
    """Return the pairs of methods none of whose runs has the varied value: they have no such option, or leave it out.

    Their runs are the same at every value of it.
    """
    present = table[path].notna().to_numpy()
    every = methods(table)
    return set(every) - {method for method, there in zip(every, present, strict=True) if there}


def bands(table: Any, names: Sequence[str], path: str) -> Iterator[tuple[str, str, Any]]:
    """Yield the median and the band of each measure along one varied value, for each pair of methods.

    Yields
    ------
    tuple
        Pair of methods, measure, and an array (6, bins): the place, the three of `QUANTILES` over the runs that have
        the measure, how many these are, and how many runs were made there. A pair that lacks the value has one bin,
        whose place is nan.
    """
    made = table[table["status"] != WAITING]
    values = numbers(made[path])
    if values is None or not np.isfinite(values).any():
        return
    places, where = binned(values)
    every, done = np.array(methods(made)), (made["status"] == "done").to_numpy()
    without = lacking(made, path)
    measured = made[list(names)].astype(float).to_numpy()
    for method in dict.fromkeys(every.tolist()):
        own = every == method
        bins = [(np.nan, own)] if method in without else [(p, own & (where == k)) for k, p in enumerate(places)]
        runs = [(place, np.flatnonzero(there & done), int(there.sum())) for place, there in bins]
        for n, name in enumerate(names):
            yield method, name, _band(runs, measured[:, n])


def _band(runs: Sequence[tuple[float, Any, int]], values: Any) -> Any:
    """Return place, quantiles, number of values and number of runs of each bin that has a run: (6, bins)."""
    out = []
    for place, rows, count in runs:
        own = values[rows]
        own = own[np.isfinite(own)]
        quantiles = np.quantile(own, QUANTILES) if own.size else np.full(len(QUANTILES), np.nan)
        if count:
            out.append((place, *quantiles, own.size, count))
    return np.array(out).reshape(-1, 6).T


def maps(table: Any, names: Sequence[str], paths: Sequence[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield a map over each pair of varied numbers: what became of the runs in each cell, and medians of done ones.

    Yields
    ------
    tuple
        The paths across and up, and ``across`` and ``up`` (the places of the cells) and ``methods``: for each pair of
        methods ``done``, ``unstable`` and ``other`` (counts) and each measure, cells in rows from below. A pair that
        lacks a varied value has one cell along it. Where fewer runs than are done have a measure, how many have it
        stands under the measure's name with ``|known`` behind.
    """
    made = table[table["status"] != WAITING]
    every, status = np.array(methods(made)), made["status"].to_numpy()
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
        for method in dict.fromkeys(every.tolist()):
            (wide, i), (high, j) = (
                (1, np.zeros(len(made), dtype=int)) if method in without[path] else (places.size, where)
                for path, (places, where) in ((x, placed[x]), (y, placed[y]))
            )
            own = (every == method) & (i >= 0) & (j >= 0)
            cell, size = np.where(own, j * wide + i, -1), wide * high
            counts = {kind: np.bincount(cell[own & mask], minlength=size) for kind, mask in kinds.items()}
            known = made.loc[own & kinds["done"], list(names)].astype(float).groupby(cell[own & kinds["done"]])
            medians, valued = (found.reindex(range(size)) for found in (known.median(), known.count()))
            for name in names if counts["done"].any() else ():
                counts[name] = medians[name].to_numpy()
                if (valued[name].fillna(0).to_numpy() < counts["done"]).any():
                    counts[f"{name}|known"] = valued[name].fillna(0).to_numpy()
            of_methods[method] = counts
        yield x, y, {"across": placed[x][0], "up": placed[y][0], "methods": of_methods}


def front_of(cost: Any, error: Any) -> Any:
    """Return the places of the runs that no other beats at their cost, cheap to dear; runs lacking either are out."""
    rows = np.flatnonzero(np.isfinite(cost) & np.isfinite(error))
    rows = rows[np.lexsort((error[rows], cost[rows]))]
    best = np.minimum.accumulate(error[rows]) if rows.size else error[rows]
    kept = np.ones(rows.size, dtype=bool)
    kept[1:] = error[rows][1:] < best[:-1]
    return rows[kept]


def front(cost: Any, error: Any) -> Any:
    """Return cost and error of the runs that no other beats at their cost, cheap to dear: (2, n)."""
    rows = front_of(cost, error)
    return np.vstack([cost[rows], error[rows]])


def references(table: Any) -> list[str]:
    """Return the pairs whose interface is tied: they need the exact solution, and compete with no method."""
    pairs = zip(methods(table), texts(table["contact"]), strict=True)
    return list(dict.fromkeys(method for method, contact in pairs if contact == TIED))


@dataclass(frozen=True)
class Cell:
    """The runs of one pair of methods in one case, by one measure.

    Attributes
    ----------
    median, least
        Over the runs that have the measure; nan where none has.
    known, made
        How many have it, and how many runs were made.
    lost
        How many of the others have which status; ``no number`` for a run that is done without the measure.
    """

    median: float
    least: float
    known: int
    made: int
    lost: dict[str, int]


def overview(table: Any, name: str) -> dict[str, dict[str, Cell]]:
    """Return the cell of each pair of methods and each case, by one measure."""
    every, cases = np.array(methods(table)), np.array(texts(table["case"]))
    status, values = np.array(texts(table["status"])), numbers(table[name])
    out: dict[str, dict[str, Cell]] = {}
    for method in dict.fromkeys(every.tolist()):
        for case in dict.fromkeys(cases.tolist()):
            own = (every == method) & (cases == case) & (status != WAITING)
            if not own.any():
                continue
            known = own & (status == "done") & np.isfinite(values)
            found = values[known]
            ends = ["no number" if one == "done" else one for one in status[own & ~known].tolist()]
            median, least = (float(np.median(found)), float(found.min())) if found.size else (np.nan, np.nan)
            out.setdefault(method, {})[case] = Cell(median, least, int(found.size), int(own.sum()), dict(Counter(ends)))
    return out


def counted(cell: Cell) -> str:
    """Return over how many of its runs a cell's median is taken, and what became of the others."""
    lost = ", ".join(f"{count} {status}" for status, count in cell.lost.items())
    if cell.made == 1:
        return next(iter(cell.lost), "")
    head = f"median of {cell.known}" if cell.known else "0"
    return f"{head} of {cell.made} runs: {lost}" if lost else f"median of {cell.made} runs"


def least_medians(cells: dict[str, dict[str, Cell]], apart: set[str]) -> dict[str, float]:
    """Return the least median of each case among the pairs that compete and lost no run there."""
    best: dict[str, float] = {}
    for method, row in cells.items():
        for case, cell in row.items() if method not in apart else ():
            if cell.known and cell.known == cell.made:
                best[case] = min(best.get(case, np.inf), cell.median)
    return best


def largest_factor(cells: dict[str, dict[str, Cell]], best: dict[str, float]) -> float:
    """Return the largest median over the least one of its case, from 2 to `MOST_FACTOR`."""
    every = [cell.median / best[case] for row in cells.values() for case, cell in row.items() if best.get(case, 0) > 0]
    return float(min(max([2.0, *(factor for factor in every if np.isfinite(factor))]), MOST_FACTOR))


def shade(cell: Cell, best: float | None, largest: float) -> str:
    """Return the colour of a cell: pale up to the least median of the case, darker with the factor over it."""
    if best is None or not best > 0:
        return "#ffffff"
    share = float(np.clip(np.log(max(cell.median / best, 1.0)) / np.log(largest), 0, 1))
    parts = (round(pale + share * (dark - pale)) for pale, dark in zip(*SHADES, strict=True))
    return "#" + "".join(f"{part:02x}" for part in parts)


@dataclass(frozen=True)
class Problems:
    """The problems of a study that every pair of methods was set: a case with one value of everything varied.

    Attributes
    ----------
    solvers
        The pairs of methods; the tied references are not among them.
    rows
        The run of each pair on each problem: (problems, solvers).
    left_out
        Number of problems that some pair was not set, or was set more than once.
    """

    solvers: list[str]
    rows: Any
    left_out: int


def problems(table: Any, varied: Sequence[str]) -> Problems:
    """Return the problems of a study; a pair that lacks a varied value stands with its one run at each value of it."""
    every, apart = methods(table), set(references(table))
    solvers = [method for method in dict.fromkeys(every) if method not in apart]
    paths = [path for path in varied if path not in CHOICES]
    without = {path: lacking(table, path) & set(solvers) for path in paths}
    # a pair that lacks a value which others have sets no problems of its own
    partial = {method for boundary in without.values() if len(boundary) < len(solvers) for method in boundary}
    runs: dict[Any, list[int]] = {}
    points: dict[Any, None] = {}
    words = [texts(table[path]) for path in paths]
    for row, (method, *point) in enumerate(zip(every, texts(table["case"]), *words, strict=True)):
        runs.setdefault((method, *point), []).append(row)
        if method not in partial and method not in apart:
            points[tuple(point)] = None
    kept = []
    for case, *values in points:
        asked = {
            method: ["" if method in without[path] else value for path, value in zip(paths, values, strict=True)]
            for method in solvers
        }
        own = [runs.get((method, case, *asked[method]), []) for method in solvers]
        if all(len(rows) == 1 for rows in own):
            kept.append([rows[0] for rows in own])
    rows = np.array(kept, dtype=int).reshape(len(kept), len(solvers))
    return Problems(solvers, rows, len(points) - len(kept))


@dataclass(frozen=True)
class Profile:
    """A performance profile: how often each pair of methods comes within a factor of the best pair.

    Attributes
    ----------
    counted
        Number of problems.
    unknown
        Number of problems left out because a run of them is still to be made, is done without the measure, or has one
        below zero, or because no run is done.
    ratios
        For each pair its measure over that of the best pair, in order: at least 1, infinite where its run is not done.
    """

    counted: int
    unknown: int
    ratios: dict[str, Any]


def profile(table: Any, name: str, asked: Problems) -> Profile:
    """Return the performance profile of the pairs of methods by one measure, of which less is better.

    The profile of a pair at a factor tau is the fraction of problems whose ratio is at most tau (Dolan, More:
    Benchmarking optimization software with performance profiles, Math. Program. 91 (2002), doi 10.1007/s101070100263).
    """
    status = table["status"].to_numpy()[asked.rows]
    values = numbers(table[name])[asked.rows]
    cost = np.where(np.isin(status, PENDING), np.nan, np.where(status == "done", values, np.inf))
    with np.errstate(invalid="ignore"):
        good = ~np.isnan(cost).any(axis=1) & np.isfinite(cost).any(axis=1) & (cost >= 0).all(axis=1)
    cost = cost[good]
    least = cost.min(axis=1, keepdims=True, initial=np.inf)
    # equal measures are the same also where both are zero
    ratio = np.divide(cost, least, out=np.where(cost == least, 1.0, np.inf), where=least > 0)
    ratios = {method: np.sort(ratio[:, k]) for k, method in enumerate(asked.solvers)}
    return Profile(int(good.sum()), int((~good).sum()), ratios)


def lost(table: Any) -> list[dict[str, Any]]:
    """Return why runs are not done: a line for each kind of reason, the numbers in it aside, most frequent first."""
    rows = table[~table["status"].isin(["done", WAITING])]
    who = methods(rows)
    said, why, status = (texts(rows[name]) for name in ("said_by", "reason", "status"))
    groups: dict[Any, dict[str, Any]] = {}
    for one in zip(status, who, said, why, strict=True):
        kind = (*one[:3], re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", one[3]))
        group = groups.setdefault(kind, dict(zip(("status", "method", "said_by", "reason"), one, strict=True)))
        group["count"] = group.get("count", 0) + 1
    return sorted(groups.values(), key=lambda group: -int(group["count"]))


def kept_histories(study: StudyLike, table: Any) -> dict[int, dict[str, Any]]:
    """Return thinned histories of some rows, drawn evenly over each method in turn."""
    turns: dict[str, list[int]] = {}
    for row, (method, status) in enumerate(zip(methods(table), texts(table["status"]), strict=True)):
        if status in {"done", "unstable", "interrupted"}:
            turns.setdefault(method, []).append(row)
    queues = [iter(dict.fromkeys([*_best(table, rows), *_spread(rows, MOST_ASKED)])) for rows in turns.values()]
    # more are asked for than are wanted: a study may have kept the histories of some runs only
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


def _best(table: Any, rows: list[int]) -> list[int]:
    """Return the done run of least force error among some, or none."""
    if "force_error_l1" not in table:
        return []
    own = table.iloc[rows]
    errors = numbers(own["force_error_l1"].where(own["status"] == "done"))
    return [rows[int(np.nanargmin(errors))]] if errors is not None and np.isfinite(errors).any() else []


def _spread(rows: list[int], most: int) -> list[int]:
    """Return rows far apart first: any beginning of the list is spread over all of them."""
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
        return [[packed(part) for part in thinned(time, one, POINTS)] for one in force.T[:MOST_CONTACTS]]

    names = [str(name) for name in history.get("contact", [])][:MOST_CONTACTS]
    return {"contacts": names, "force": lines("contact_force"), "exact": lines("contact_force_exact")}
