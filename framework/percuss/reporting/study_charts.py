"""The charts of a study as data: the one description from which both the page and the files are drawn.

A renderer decides nothing about the data. It takes from here which columns a chart offers, which of its axes are
logarithmic and where they end, the bins of the medians, the style of each pair of methods, the steps of a profile, and
the captions.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np

from percuss.case.quantities import ranking
from percuss.case.yaml_text import flow
from percuss.jsonable import Entries
from percuss.methods.interfaces import Floats
from percuss.reporting import study_data
from percuss.reporting.figures import COLOURS, DASHES, MORE_COLOURS, MORE_DASHES
from percuss.reporting.study_data import ColumnRoles

if TYPE_CHECKING:
    import pandas as pd

    from percuss.studies.study_table import Study

MOST_BANDS = 3  # Bands of more pairs hide each other, and the medians.
LINES = {
    "best": "a line joins the best runs of a pair",
    "median": f"a line joins the medians of a pair; a band, drawn for at most {MOST_BANDS} pairs, holds 8 of 10 runs",
}
MARKED = (
    "a ring marks a value at which runs failed, on the lower edge where all did; a level line is a pair without this "
    "option"
)
CAPTIONS = {
    "best": "each pair of methods in each case: the mark is its best run, the bar its median run; best pair first",
    "work": (
        "a line joins the runs of a pair that no other run of the pair beats; a name stands where one run beats all "
        "others of its pair; the broad grey line joins the runs that no run of any pair beats"
    ),
    "vary": f"best: {LINES['best']}; median: {LINES['median']}; {MARKED}",
    "map": "two varied values, one panel for each pair of methods in each case",
    "profile": (
        "the share of problems on which a pair comes within a factor of the best pair; a failed run is within none "
        "(Dolan, Moré 2002, doi 10.1007/s101070100263)"
    ),
}
# When the colours repeat, the mark and the dashes of a repeated colour differ from those before.
MARKS = ("circle", "square", "triangle", "diamond", "open circle", "open square", "open triangle", "open diamond")
EVERY_COLOUR, EVERY_DASH = (*COLOURS, *MORE_COLOURS), (*DASHES, *MORE_DASHES)
STAYED = "share of runs that stayed stable"
OUTCOMES = {"done": "done", "unstable": "unstable", study_data.WAITING: ""}
OTHER_OUTCOME = "refused, failed or lost"
MOST_FORCES = 8  # The page shows the contact forces of at most this many runs together.
MOST_TICKS = 8  # Up to this many distinct values each have their own tick.
# Of the room between two words on an axis, the pairs of methods, which stand beside each other, take this share.
SPREAD = 0.64


def snapshot(study: Study) -> Study:
    """Return a study with everything read once that a report asks for: a study reads its file at each access."""
    names = ("title", "spec", "units", "provenance", "columns", "histories", "files", "path", "with_histories")
    read = {name: getattr(study, name) for name in names}
    return cast("Study", SimpleNamespace(**read, table=_with_lists_as_texts(study.table)))


def _with_lists_as_texts(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table whose lists and mappings, which cannot be counted, are texts as in a study file."""
    structured = {
        name: column.map(lambda value: flow(value) if isinstance(value, list | dict) else value)
        for name, column in table.items()
        if column.dtype == object and any(isinstance(value, list | dict) for value in column)
    }
    return table.assign(**structured) if structured else table


@dataclass(frozen=True)
class LineStyle:
    """The look of a line and its marks: that of one pair of methods in all charts, or of one run among the forces.

    Attributes
    ----------
    colour
        As in HTML.
    mark
        One of `MARKS`.
    dash
        Lengths of dashes and gaps in widths of the line; empty for a solid line.
    """

    colour: str
    mark: str
    dash: tuple[float, ...]


def line_style(k: int) -> LineStyle:
    """Return the style of the k-th line of a chart, counted from 0."""
    turn = (k + k // len(MARKS)) % len(MARKS)
    dash = () if EVERY_DASH[turn] == "-" else EVERY_DASH[turn][1]
    return LineStyle(EVERY_COLOUR[k % len(MARKS)], MARKS[turn], dash)


@dataclass(frozen=True)
class Axis:
    """A column of the table as an axis of charts.

    Attributes
    ----------
    label
        Words beside the axis.
    words
        The texts on an axis of words, in order; empty for an axis of numbers.
    log
        Whether the axis is logarithmic: that of a measure wherever it can be, that of a varied value where its numbers
        suit it, see `percuss.reporting.study_data.is_log`.
    edge
        Lower end of a logarithmic axis, at which smaller numbers are drawn, as they are round-off.
    ticks
        The places of the ticks where there are few distinct values; empty for a renderer's own choice. A measure is
        spread over its axis however few its values are, and leaves the ticks to the renderer.
    """

    label: str
    words: tuple[str, ...]
    log: bool
    edge: float
    ticks: tuple[float, ...]


def axis(rows: pd.DataFrame, name: str, label: str, *, is_measure: bool) -> Axis:
    """Return one column of some rows of a study's table as an axis."""
    values = study_data.numbers(rows[name])
    if values is None:
        return Axis(label, tuple(study_data.in_order(study_data.texts(rows[name]))), log=False, edge=-np.inf, ticks=())
    distinct = np.unique(values[np.isfinite(values)])
    # Each refinement halves the elements, so that the mesh is a logarithmic axis however few of its values there are.
    suits = is_measure or name == "refine" or study_data.is_log(values)
    log = suits and study_data.may_be_log(values)
    ticks = () if is_measure or distinct.size > MOST_TICKS else tuple(distinct.tolist())
    return Axis(label, (), log, study_data.lowest(values) if log else -np.inf, ticks)


@dataclass(frozen=True)
class Charts:
    """The charts of a study.

    Attributes
    ----------
    styles
        The style of each pair of methods.
    axes
        The axis of each column that some chart offers.
    costs, results
        The measures that the chart of error over cost offers across and up.
    varied
        The columns that the chart of a measure over a varied value offers across.
    mapped
        The columns offered for either side of the map over two varied values.
    ranked
        The measures that rank runs, better when smaller: true errors come first.
    """

    styles: dict[str, LineStyle]
    axes: dict[str, Axis]
    costs: list[str]
    results: list[str]
    varied: list[str]
    mapped: list[str]
    ranked: list[str]


def study_charts(table: pd.DataFrame, roles: ColumnRoles) -> Charts:
    """Return the description of all charts of a study.

    Parameters
    ----------
    table
        All rows of the study, shares in per cent.
    roles
        The roles of its columns.
    """
    done = table[table["status"] == "done"]
    axes = {name: axis(done, name, label, is_measure=True) for name, label in roles.measures.items()}
    names = (*roles.varied, "case", "integrator", "contact")
    several = [name for name in names if name in table and table[name].nunique() > 1]
    axes |= {name: axis(table, name, name, is_measure=False) for name in several}
    # Numbers come first, because they make lines.
    varied = sorted((name for name in several if name in roles.varied), key=lambda name: bool(axes[name].words))
    return Charts(
        {pair: line_style(k) for k, pair in enumerate(dict.fromkeys(study_data.methods(table)))},
        axes,
        list(roles.costs),
        [name for name in roles.measures if name not in roles.costs and name != "seconds"],
        [*varied, *(name for name in several if name not in varied)],
        [*varied, *(["case"] if "case" in axes else [])],
        ranking(roles.measures),
    )


def outcome(status: str) -> str:
    """Return the outcome of a run by its status: done, unstable, lost in some other way, or empty for none yet."""
    return OUTCOMES.get(status, OTHER_OUTCOME)


def place_aside(turn: int, count: int) -> float:
    """Return how far a pair of methods stands beside its word on an axis, so that pairs do not hide each other."""
    return SPREAD * (turn - (count - 1) / 2) / max(count, 1)


def work_lines(rows: pd.DataFrame, cost: str, error: str) -> tuple[Floats, dict[str, Floats]]:
    """Return the Pareto fronts of error over cost of some runs, costs and errors as arrays (2, n).

    Parameters
    ----------
    rows
        Runs that are done, of one case.
    cost, error
        Names of the two columns.

    Returns
    -------
    tuple
        The front of all runs that compete, which are those without mesh tying, and the front of each pair of methods.
    """
    x, y = study_data.numbers(rows[cost]), study_data.numbers(rows[error])
    pairs = study_data.methods(rows)
    compete = ~np.isin(pairs, study_data.references(rows))
    of_pairs = {pair: study_data.front(x[own], y[own]) for (pair,), own in study_data.groups(pairs).items()}
    return study_data.front(x[compete], y[compete]), {pair: line for pair, line in of_pairs.items() if line.size}


@dataclass(frozen=True)
class ProfileChart:
    """The performance profiles of the pairs of methods by one measure.

    Attributes
    ----------
    label
        Words beside the axis of factors, which is logarithmic and begins at 1.
    end
        End of the axis of factors.
    lines
        For each pair of methods the factors and the shares of problems at which its steps begin, array (2, n).
    note
        How many problems there are, and which were left out.
    empty
        Why there is nothing to draw; empty where there is.
    """

    label: str
    end: float
    lines: Entries
    note: str
    empty: str


def profile_chart(
    table: object, roles: ColumnRoles, name: str, problem_set: study_data.Problems, statistic: str
) -> ProfileChart:
    """Return the chart of the performance profiles by the best or the median of one measure, over all rows."""
    profile = study_data.profile(table, name, problem_set, statistic)
    left = [
        (problem_set.left_out, "that were not run with every pair"),
        (profile.unknown, "in which no run is done, or a run is still to be made or lacks the number"),
    ]
    parts = [f"{count_of(count, 'problem')} {why}" for count, why in left if count]
    note = [
        f"{count_of(profile.counted, 'problem')}. A problem is a case with one value of each varied path that is no "
        f"option of a method; of the runs of a pair on a problem the {statistic} counts.",
        *([f"Left out: {', and '.join(parts)}."] if parts else []),
    ]
    if study_data.references(table):
        note.append("The tied twins are references, which need the exact solution, and do not compete.")
    finite = [ratios[np.isfinite(ratios)] for ratios in profile.ratios.values()]
    largest = float(np.concatenate([*finite, np.ones(1)]).max())
    end = max(1.5, largest**1.05)
    lines = {pair: np.array(profile_steps(ratios, end)) for pair, ratios in profile.ratios.items() if profile.counted}
    empty = "" if profile.counted else "No problem that was run with every pair could be judged."
    return ProfileChart(
        f"{roles.measures[name].removesuffix(' [%]')} over that of the best pair", end, lines, " ".join(note), empty
    )


def profile_steps(ratios: Floats, end: float) -> tuple[Floats, Floats]:
    """Return the factors and the shares of problems of one pair's profile, from factor 1 to the end of the axis."""
    factors, counts = np.unique(np.maximum(ratios[np.isfinite(ratios)], 1.0), return_counts=True)
    share = np.cumsum(counts) / ratios.size
    if not factors.size or factors[0] > 1:
        factors, share = np.array([1.0, *factors]), np.array([0.0, *share])
    return np.array([*factors, end]), np.array([*share, share[-1]])


def count_of(count: int, noun: str, tail: str = "") -> str:
    """Return a number of things in words, with the noun in the plural where there is not just one of them."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}{tail}"
