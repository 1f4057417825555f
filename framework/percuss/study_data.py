"""What a study's table holds: which column is what, and what of it a page or a picture can carry."""

from __future__ import annotations

import base64
import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from percuss.figures import thinned

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
    "steps": "steps",
    "seconds.march": "seconds of the march",
    "seconds": "seconds of the run",
}
COSTS = ("seconds.march", "seconds", "steps")
ABOUT = ("case", "integrator", "contact", "status", "reason", "said_by", "fragile", "key")
MOST_ROWS = 5000  # of which a browser draws and sorts every one without a pause
MOST_HISTORIES = 120
MOST_LETTERS = 2_000_000  # of base64 that all histories of a page may take
MOST_ASKED = 1000  # runs that are asked for their history
MOST_CONTACTS = 4
POINTS = 400  # of a history, its extremes kept
DISTINCT = 40  # more values than that are put in bins
BINS = 24
MAP_DISTINCT, MAP_BINS = 16, 12  # along each side of a map
MOST_MAPPED = 4  # varied values, each pair of which has a map of all rows
QUANTILES = (0.1, 0.5, 0.9)
SEED = 0
WAITING = "waiting"  # a run that is still to be made
FAR_FEW, FAR_MANY = 8, 30  # times the smallest: spread so far, distinct numbers are on a logarithmic axis
ROUND_OFF = 1e-10  # of the largest: what is below has no place on a logarithmic axis


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
    """

    varied: tuple[str, ...]
    measures: dict[str, str]


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
    return Columns(tuple(varied), {name: MEASURES.get(name, name.replace("_", " ")) for name in measured})


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
    """Return a value of the table as it is read; nothing for what is missing."""
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, (float, np.floating)) else str(value)


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


def shown(table: Any) -> Any:
    """Return the table, or a seeded sample of its rows where there are more than a page can carry."""
    if len(table) <= MOST_ROWS:
        return table.reset_index(drop=True)
    kept = np.sort(np.random.default_rng(SEED).choice(len(table), MOST_ROWS, replace=False))
    return table.iloc[kept].reset_index(drop=True)


def packed(values: Any, kind: str = "<f4") -> str:
    """Return numbers as base64 of their bytes; what is too large becomes infinite, what is missing nan."""
    with np.errstate(over="ignore"):
        return base64.b64encode(np.asarray(values, dtype=float).astype(kind).tobytes()).decode("ascii")


def is_log(values: Any) -> bool:
    """Whether numbers belong on a logarithmic axis: none below zero, and spread far or each a multiple of the last."""
    found = values[np.isfinite(values)]
    above = found[found > ROUND_OFF * found.max(initial=0)]
    if not above.size or (found < 0).any():
        return False
    distinct = np.unique(above)
    steps = distinct[1:] / distinct[:-1]
    few = distinct.size <= DISTINCT
    multiples = few and distinct.size > 2 and bool(np.allclose(steps, steps[0], rtol=1e-6))
    return multiples or bool(distinct[-1] >= (FAR_FEW if few else FAR_MANY) * distinct[0])


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


def bands(table: Any, names: Sequence[str], path: str) -> Iterator[tuple[str, str, Any]]:
    """Yield the median and the band of each measure along one varied value, for each method, over all done runs.

    Yields
    ------
    tuple
        Method, measure, and an array (4, bins) of place, and the three of `QUANTILES`.
    """
    done = table[table["status"] == "done"]
    values = numbers(done[path])
    if values is None or not np.isfinite(values).any():
        return
    places, where = binned(values)
    grouped = done[list(names)].astype(float).groupby([np.array(methods(done)), where])
    found = grouped.quantile(list(QUANTILES)).unstack()
    for method in dict.fromkeys(methods(done)):
        of_method = found.loc[method]
        of_method = of_method[of_method.index >= 0]
        for name in names:
            yield method, name, np.vstack([places[of_method.index], of_method[name].to_numpy().T])


def maps(table: Any, names: Sequence[str], paths: Sequence[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield a map over each pair of varied numbers: what became of the runs in each cell, and medians of done ones.

    Yields
    ------
    tuple
        The paths across and up, and ``across`` and ``up`` (the places of the cells) and ``methods``: for each method
        ``done``, ``unstable`` and ``other`` (counts) and each measure, cells in rows from below.
    """
    every, status = np.array(methods(table)), table["status"].to_numpy()
    kinds = {"done": status == "done", "unstable": status == "unstable"}
    kinds["other"] = ~(kinds["done"] | kinds["unstable"])
    numeric = {path: numbers(table[path]) for path in paths}
    placed = {
        path: binned(values, MAP_DISTINCT, MAP_BINS)
        for path, values in numeric.items()
        if values is not None and np.unique(values[np.isfinite(values)]).size > 1
    }
    for x, y in itertools.combinations(list(placed)[:MOST_MAPPED], 2):
        (across, i), (up, j) = placed[x], placed[y]
        size, cell = across.size * up.size, np.where((i < 0) | (j < 0), -1, j * across.size + i)
        done = kinds["done"] & (cell >= 0)
        medians = table.loc[done, list(names)].astype(float).groupby([every[done], cell[done]]).median()
        of_methods = {}
        for method in dict.fromkeys(every.tolist()):
            own = (every == method) & (cell >= 0)
            told = {kind: np.bincount(cell[own & mask], minlength=size) for kind, mask in kinds.items()}
            known = medians.loc[method].reindex(range(size)) if told["done"].any() else None
            told |= {name: known[name].to_numpy() for name in names} if known is not None else {}
            of_methods[method] = told
        yield x, y, {"across": across, "up": up, "methods": of_methods}


def front(cost: Any, error: Any) -> Any:
    """Return the runs that no other beats at their cost, cheap to dear: (2, n)."""
    good = np.isfinite(cost) & np.isfinite(error) & (cost > 0) & (error > 0)
    cost, error = cost[good], error[good]
    order = np.lexsort((error, cost))
    cost, error = cost[order], error[order]
    best = np.minimum.accumulate(error) if error.size else error
    kept = np.ones(error.size, dtype=bool)
    kept[1:] = error[1:] < best[:-1]
    return np.vstack([cost[kept], error[kept]])


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
