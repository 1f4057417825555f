"""The charts of a study, described once: the page, files for print and notebooks draw the same descriptions.

The file ``charts.yaml`` beside this one describes the charts in Vega-Lite, with marks such as ``$y_label`` in the
places of what a reader chooses. This module makes what stands there: rows, axes, and the looks of the pairs of methods.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from percuss.case.quantities import of_column, ranking
from percuss.case.yaml_text import flow
from percuss.files import PACKAGE
from percuss.jsonable import Entries, plain
from percuss.methods.interfaces import Floats
from percuss.reporting import study_data
from percuss.reporting.figures import COLOURS, DASHES, MORE_COLOURS, MORE_DASHES
from percuss.reporting.study_data import ABOUT, ColumnRoles

if TYPE_CHECKING:
    import pandas as pd

    from percuss.studies.study_table import Study

METHODS = ("case", "integrator", "contact")
MOST_RANKED = 16  # pairs of methods in a panel of the best
MOST_FORCES = 8  # runs in the chart of the forces
MOST_TICKS = 8  # Up to this many distinct values each have their own tick.
# When the colours repeat, the mark and the dashes of a repeated colour differ from those before.
MARKS = ("circle", "square", "triangle-up", "diamond", "cross", "triangle-down", "triangle-right", "triangle-left")
EVERY_COLOUR, EVERY_DASH = (*COLOURS, *MORE_COLOURS), (*DASHES, *MORE_DASHES)


def snapshot(study: Study) -> Study:
    """Return a study with everything read once that a report asks for: a study reads its file at each access."""
    names = ("title", "spec", "units", "provenance", "columns", "histories", "path", "with_histories")
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


# ---------------------------------------------------------------------------------------------------------------- axes


@dataclass(frozen=True)
class Axis:
    """A column of the table as an axis of charts, with what Vega-Lite takes.

    Attributes
    ----------
    label
        Words beside the axis.
    field, drawn, place
        Fields of the rows: the value itself, the value as it is drawn, and the place of its bin.
    type
        ``quantitative``, or ``nominal`` for an axis of words.
    kind
        ``log`` or ``linear``: that of a measure is logarithmic wherever it can be, that of a varied value where its
        numbers suit it, see `percuss.reporting.study_data.is_log`.
    scale, axis
        Its scale and its ticks.
    sort
        The words of an axis of words, in order; None for one of numbers.
    joined, aside
        The mark of the chosen runs at each place, and how pairs stand beside each other: no line joins words.
    panel
        The field by which the panels of a chart over it differ.
    ranked, unit
        Whether a smaller number is better, as Vega writes it, and the sign of the unit behind a number.
    """

    label: str
    field: str
    drawn: str
    place: str
    type: str
    kind: str
    scale: Entries
    axis: Entries
    sort: list[str] | None
    joined: str = "line"
    aside: Entries | None = None
    panel: str = "case"
    ranked: str = "false"
    unit: str = ""


def axis(column: pd.Series, label: str, field: str = "", *, is_measure: bool) -> Axis:
    """Return some values as an axis.

    Parameters
    ----------
    column
        The values; nan where there is none.
    label
        Words beside the axis.
    field
        Its field in the rows of the charts.
    is_measure
        Whether they were measured: a measure has a logarithmic axis wherever it can, and ticks of Vega's choice.
    """
    label = re.sub(r'[\x00-\x1f"\\]+', " ", label)  # it stands in expressions of Vega too
    values = study_data.numbers(column)
    if values is None:
        words, panel = study_data.in_order(study_data.texts(column)), "all" if field == "case" else "case"
        beside: Entries = {"aside": {"field": "pair", "type": "nominal"}, "joined": "tick", "panel": panel}
        return Axis(label, field, field, field, "nominal", "", {}, {"labelAngle": -25}, words, **beside)
    # Each refinement halves the elements, so that the mesh is a logarithmic axis however few of its values there are.
    suits = is_measure or column.name == "refine" or study_data.is_log(values)
    kind = "log" if suits and study_data.may_be_log(values) else "linear"
    scale: Entries = {"type": kind, "nice": False, "padding": 12} | ({} if kind == "log" else {"zero": False})
    distinct = np.unique(values[np.isfinite(values)])
    few = not is_measure and distinct.size <= MOST_TICKS
    ticks: Entries = {"values": distinct.tolist()} if few else {"tickCount": 5}
    ticks |= {"labelExpr": description()["number"], "labelOverlap": "greedy"}
    return Axis(label, field, field, field, "quantitative", kind, scale, ticks, sort=None)


@dataclass(frozen=True)
class Charts:
    """The charts of a study: their rows, and what they offer.

    Attributes
    ----------
    rows
        The rows of all charts, as a list for each of their fields.
    fields
        The field of each column of the table.
    axes
        The axis of each column that some chart offers.
    pairs, cases
        Names of the pairs of methods and of the cases.
    measures, costs, varied, mapped
        The columns that charts offer: the measures, those that rank runs first; the costs; what a measure is drawn
        over; the sides of the map.
    ranked
        The measures that rank runs, better when smaller: true errors come first.
    """

    rows: Entries
    fields: dict[str, str]
    axes: dict[str, Axis]
    pairs: list[str]
    cases: list[str]
    measures: list[str]
    costs: list[str]
    varied: list[str]
    mapped: list[str]
    ranked: list[str]


def study_charts(table: pd.DataFrame, roles: ColumnRoles) -> Charts:
    """Return the charts of some rows of a study.

    Parameters
    ----------
    table
        The rows.
    roles
        The roles of its columns.
    """
    ranked, done = ranking(roles.measures), table["status"] == "done"
    several = [name for name in (*roles.varied, *METHODS) if name in table and table[name].nunique() > 1]
    fields = {name: name if name in ABOUT else f"c{k}" for k, name in enumerate(map(str, table.columns))}
    rows: Entries = {"row": list(range(len(table))), "pair": study_data.methods(table)}
    axes: dict[str, Axis] = {}
    for name, field in fields.items():
        column = table[name]
        values = study_data.numbers(column)
        if name in roles.measures:
            share = of_column(name).is_fraction
            if share:  # in per cent; the fractions have a field of their own, with every digit
                rows[f"{field}r"], values = _listed(values), 100.0 * values
            of_done = column.astype(float).where(done) * (100.0 if share else 1.0)
            one = axis(of_done, roles.measures[name], field, is_measure=True)
            drawn = of_done.to_numpy()
            if one.kind == "log":  # what is smaller is round-off, and drawn at the lower edge
                drawn = np.maximum(drawn, study_data.lowest(drawn))
            if not np.array_equal(drawn, values, equal_nan=True):
                one = replace(one, drawn=f"{field}d", place=f"{field}d")
                rows[one.drawn] = _listed(drawn)
            axes[name] = replace(one, ranked=str(name in ranked).lower(), unit=" %" if share else "")
        elif name in several:
            axes[name] = axis(column, name, field, is_measure=False)
            if values is not None and column.nunique() > study_data.DISTINCT:
                places, bin_of = study_data.binned(values)
                axes[name] = replace(axes[name], place=f"{field}b")
                rows[f"{field}b"] = _listed(np.append(places, np.nan)[bin_of])
        rows[field] = study_data.texts(column) if values is None else _listed(values)
    stayed = table["status"].map({"done": 100.0, "unstable": 0.0}).astype(float)
    rows["stayed"] = _listed(stayed)
    axes["stayed"] = axis(stayed, "share of runs that stayed stable [%]", "stayed", is_measure=True)
    # Numbers come first, because they make lines.
    varied = sorted((name for name in several if name in roles.varied), key=lambda name: axes[name].type == "nominal")
    others = [name for name in roles.measures if name not in {*roles.costs, *ranked, "seconds"}]
    return Charts(
        rows,
        fields,
        axes,
        pairs=list(dict.fromkeys(rows["pair"])),
        cases=list(dict.fromkeys(rows["case"])),
        measures=[*ranked, *others],
        costs=list(roles.costs),
        varied=[*varied, *(name for name in several if name not in varied)],
        mapped=[*varied, *(["case"] if "case" in several else [])],
        ranked=ranked,
    )


def _listed(values: Any) -> list[float | None]:
    """Return numbers as JSON has them: None for one that is not finite."""
    return cast("list[float | None]", plain(np.asarray(values).tolist()))


# -------------------------------------------------------------------------------------------------------- descriptions


@cache
def description() -> Entries:
    """Return what the file of the charts says, with lists of transforms in a list of transforms put in line."""
    import yaml

    def in_line(value: Any) -> Any:
        if isinstance(value, list):
            return [part for item in value for part in (item if isinstance(item, list) else [in_line(item)])]
        return {key: in_line(item) for key, item in value.items()} if isinstance(value, dict) else value

    said = yaml.safe_load((PACKAGE / "reporting" / "charts.yaml").read_text(encoding="utf-8"))
    return {**said, "charts": in_line(said["charts"])}


def filled(chart: Entries, marks: Entries) -> Entries:
    """Return a chart with values in the places of its marks: a text that is a mark alone takes a value of any type."""

    def value(found: re.Match[str]) -> str:
        return json.dumps(marks[found[1]]) if found[1] else str(marks[found[2]])

    return cast("Entries", json.loads(re.sub(r'"\$(\w+)"|\$(\w+)', value, json.dumps(chart))))


def side_marks(side: str, axis: Axis) -> Entries:
    """Return the marks of an axis at one side of a chart, as ``$x_label``."""
    return {f"{side}_{name}": value for name, value in vars(axis).items()}


def line_style(k: int) -> tuple[str, str, list[float]]:
    """Return colour, mark and dashes of the k-th line of a chart, counted from 0; dashes as lengths in pixels."""
    turn = (k + k // len(MARKS)) % len(MARKS)
    dashes = [1, 0] if EVERY_DASH[turn] == "-" else [2.0 * length for length in EVERY_DASH[turn][1]]
    return EVERY_COLOUR[k % len(MARKS)], MARKS[turn], dashes


def looks(charts: Charts) -> dict[str, Entries]:
    """Return for a light and for a dark page the marks that no choice changes, and the configuration of Vega-Lite."""
    said = description()
    colours, shapes, dashes = zip(*map(line_style, range(max(1, len(charts.pairs)))), strict=True)
    ranks = min(MOST_RANKED, len(charts.pairs))
    shared = {"pairs": charts.pairs, "cases": charts.cases, "number": said["number"], "cell": said["cell"]}
    shared |= {"ranks": ranks + 0.5, "ranks_height": 36 * ranks, "shapes": shapes, "dashes": dashes}
    out = {}
    for name, look in said["looks"].items():
        palette = dict(zip(EVERY_COLOUR, look.get("palette", EVERY_COLOUR), strict=True))
        marks = shared | look | {"colours": [palette[colour] for colour in colours]}
        out[name] = {"marks": marks, "config": filled(said["config"], marks)}
    return out


def profile_data(table: pd.DataFrame, roles: ColumnRoles, name: str, problems: pd.DataFrame, statistic: str) -> Entries:
    """Return the performance profiles by the best or the median of one measure, over all rows.

    Returns
    -------
    dict
        ``lines``, rows with ``pair``, ``factor`` and ``share`` where a step begins; ``label`` of the factors; ``note``
        in words, which says what was left out.
    """
    profile = study_data.profile(table, name, problems, statistic)
    left = [
        (profile.left_out, "that were not run with every pair"),
        (profile.unknown, "in which no run is done, or a run is still to be made or lacks the number"),
    ]
    parts = [f"{count_of(count, 'problem')} {why}" for count, why in left if count]
    note = [
        f"{count_of(profile.counted, 'problem')}. A problem is a case with one value of each varied path that is no "
        f"option of a method; of the runs of a pair on a problem the {statistic} counts. Filters change nothing here.",
        *([f"Left out: {', and '.join(parts)}."] if parts else []),
    ]
    if (table["contact"] == study_data.TIED).any():
        note.append("The tied twins are references, which need the exact solution, and do not compete.")
    finite = [ratios[np.isfinite(ratios)] for ratios in profile.ratios.values()]
    end = max(1.5, float(np.concatenate([*finite, np.ones(1)]).max()) ** 1.05)
    lines = [
        {"pair": pair, "factor": factor, "share": share}
        for pair, ratios in profile.ratios.items()
        if profile.counted
        for factor, share in zip(*profile_steps(ratios, end), strict=True)
    ]
    label = f"{roles.measures[name].removesuffix(' [%]')} over that of the best pair"
    return {"lines": lines, "label": label, "note": " ".join(note)}


def profile_steps(ratios: Floats, end: float) -> tuple[list[float], list[float]]:
    """Return the factors and the shares of problems of one pair's profile, from factor 1 to the end of the axis."""
    factors, counts = np.unique(np.maximum(ratios[np.isfinite(ratios)], 1.0), return_counts=True)
    shares = np.cumsum(counts) / ratios.size
    if not factors.size or factors[0] > 1:
        factors, shares = np.array([1.0, *factors]), np.array([0.0, *shares])
    return [*factors.tolist(), end], [*shares.tolist(), float(shares[-1])]


def count_of(count: int, noun: str, tail: str = "") -> str:
    """Return a number of things in words, with the noun in the plural where there is not just one of them."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}{tail}"
