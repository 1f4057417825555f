"""Figures of a study for print: the best of each case, error over cost, error over each varied value, and profiles."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from percuss.case.quantities import STUDY_PANELS
from percuss.errors import InputError, Problem
from percuss.files import is_file
from percuss.jsonable import Entries
from percuss.reporting import study_charts, study_data
from percuss.reporting.figures import (
    SOFT,
    legend_below,
    log_axis,
    new_figure,
    one_line,
    tick_text,
    write,
    write_reason,
)
from percuss.reporting.study_charts import Axis, Charts, LineStyle, ProfileChart
from percuss.reporting.study_data import Cell
from percuss.reporting.verdict import value_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.studies.study_table import Study

    Drawing: TypeAlias = Callable[[Axes], Entries]  # It draws a panel and returns the legend's entries by pair.

MARKERS = {"circle": "o", "square": "s", "triangle": "^", "diamond": "D"}
KINDS = (".svg", ".pdf")
# If a pair of methods has more runs than this in one panel, a seeded sample of so many points is drawn.
MOST_MARKS = 3000
MOST_RANKED = 16  # pairs of methods in a panel of the best


def study_figures(study: Study, folder: str | os.PathLike[str], statistic: str = "best") -> list[Path]:
    """Write the figures of a study as svg and pdf files.

    Parameters
    ----------
    study
        The study.
    folder
        Folder of the files; it is made if it does not exist.
    statistic
        What the lines over a varied value and the profile show of several runs of a pair: ``best`` or ``median``.

    Returns
    -------
    list of Path
        The files: ``best-and-median``; one ``work-precision`` for each cost; one ``against-...`` for each varied path
        with more than one value; for several cases also ``performance-profile``. Each case has a panel of its own.
    """
    target = Path(folder)
    if is_file(target):
        problem = Problem(str(target), "", "expected a folder, found a file", "Name another folder.")
        raise InputError([problem])
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = error.strerror or "cannot be made"
        raise InputError([Problem(str(target), "", f"expected a folder that can be written to: {why}")]) from error
    out = []
    for name, figure in figures(study, statistic):
        for kind in KINDS:
            out.append(target / f"{name}{kind}")
            write(out[-1], figure)
    return out


def figures(study: Study, statistic: str = "best") -> Iterator[tuple[str, Figure]]:
    """Yield the file name without suffix and the figure, for each figure of a study."""
    study = study_charts.snapshot(study)
    roles = study_data.columns(study)
    table = study_data.in_per_cent(study.table, roles)
    charts = study_charts.study_charts(table, roles)
    done = table[table["status"] == "done"]
    error = charts.ranked[0] if charts.ranked else ""
    if error:
        yield "best-and-median", best_figure(study.title, table, charts, error)
    for n, cost in enumerate(charts.costs if error else [""]):
        name = f"work-precision-{_file_name(cost)}" if n else "work-precision"
        yield name, work_figure(study.title, done, charts, cost, error)
    for path in roles.varied:
        if done[path].nunique() > 1:
            yield f"against-{_file_name(path)}", varied_figure(study.title, table, charts, path, statistic)
    if table["case"].nunique() > 1 and error:
        problems = study_data.problems(table, roles.varied)
        profile = study_charts.profile_chart(table, roles, error, problems, statistic)
        yield "performance-profile", profile_figure(study.title, profile, charts)


def _file_name(column: str) -> str:
    return re.sub(r"[^0-9A-Za-z_]+", "-", column)


def _panels(
    title: str, notes: list[str], panels: Mapping[str, Drawing], empty: str, high: float = 3.6, most: int = 2
) -> Figure:
    """Return a figure with a panel below each heading, and one legend beside them; or the reason why it is empty."""
    across = min(max(len(panels), 1), most)
    down = -(-max(len(panels), 1) // across)
    with new_figure(12.8, 1.3 + high * down, title, notes) as figure:
        grid = list(figure.subplots(down, across, squeeze=False).flat)
        entries: Entries = {}
        for axes, (heading, draw) in zip(grid, panels.items(), strict=False):
            entries |= draw(axes)
            axes.set_title(one_line(heading), loc="left", size=11)
        if not panels:
            write_reason(grid[0], empty)
        for axes in grid[max(len(panels), 1) :]:
            axes.set_axis_off()
        legend_below(figure, entries, beside=True)
    return figure


def _by_case(rows: Any) -> Entries:
    """Return the rows of each case."""
    return {case: rows.iloc[own] for (case,), own in study_data.groups(study_data.texts(rows["case"])).items()}


def best_figure(title: str, table: Any, charts: Charts, name: str) -> Figure:
    """Return a figure with the best and the median run of each pair of methods, in each case from the best pair on."""
    cells = study_data.cells(table, name)
    panels = {case: partial(_best_panel, charts=charts, name=name, of_case=own) for case, own in cells.items()}
    most = max((min(len(own), MOST_RANKED) for own in cells.values()), default=1)
    left_out = max((len(own) - MOST_RANKED for own in cells.values()), default=0)
    notes = [study_charts.CAPTIONS["best"], *([f"the {MOST_RANKED} best pairs are drawn"] if left_out > 0 else [])]
    return _panels(title, notes, panels, "There is no run.", 0.8 + 0.26 * most, 1)


def _best_panel(axes: Axes, charts: Charts, name: str, of_case: dict[str, Cell]) -> Entries:
    """Draw the best and the median of each pair of one case, and write their values beside them."""
    ranked = sorted(of_case, key=lambda pair: (not of_case[pair].measured, of_case[pair].best))[:MOST_RANKED]
    edge = charts.axes[name].edge
    unit = 0.01 if study_data.is_share(name) else 1.0  # the table has shares in per cent
    for place, pair in enumerate(ranked):
        style, cell = charts.styles[pair], of_case[pair]
        best, median = max(cell.best, edge), max(cell.median, edge)
        axes.plot([best, median], [place, place], color=style.colour, linewidth=1.5, alpha=0.6)
        axes.plot(median, place, color=style.colour, marker="|", markersize=12, markeredgewidth=2)
        axes.plot(best, place, color=style.colour, markersize=7, **_mark(style))
        best_text, median_text = (value_text(name, unit * value) for value in (cell.best, cell.median))
        values = f"{best_text}, median {median_text}"
        words = "; ".join(filter(None, (values if cell.measured else "", cell.lost_words)))
        frame = axes.get_yaxis_transform()
        axes.text(1.01, place, words, transform=frame, size=7.5, va="center", color=SOFT)
    axes.set_yticks(range(len(ranked)), [one_line(pair) for pair in ranked], fontsize=8)
    axes.set_ylim(len(ranked) - 0.4, -0.6)
    _set_axis(axes, "x", charts.axes[name])
    return {}


def work_figure(title: str, done: Any, charts: Charts, cost: str, error: str) -> Figure:
    """Return a figure of error over cost, with one panel a case.

    A line joins the Pareto front of the runs of one pair of methods in a panel; a front of one run has its name.
    """
    of_cases = _by_case(done) if cost and error else {}
    both = [np.isfinite(study_data.numbers(done[name])) for name in (cost, error) if name]
    lacking = int((~np.all(both, axis=0)).sum()) if both else 0
    notes = [study_charts.CAPTIONS["work"], *_sampling_note(done)]
    notes += [f"{lacking} runs that are done have no cost or no error: they are not drawn"] if lacking else []
    panels = {
        case: partial(_work_panel, charts=charts, cost=cost, error=error, rows=of_cases[case]) for case in of_cases
    }
    figure = _panels(title, notes, panels, "No cost or no error was recorded.")
    for axes, rows in zip(figure.axes, of_cases.values(), strict=False):
        lines = study_charts.work_lines(rows, cost, error)[1]
        _name_points(
            axes, {pair: line[:, 0] for pair, line in lines.items() if line.shape[1] == 1}, charts, 72 / figure.dpi
        )
    return figure


def _work_panel(axes: Axes, charts: Charts, cost: str, error: str, rows: Any) -> Entries:
    """Draw the runs of one case and their Pareto fronts, and return the legend's entries."""
    x, y = study_data.numbers(rows[cost]), study_data.numbers(rows[error])
    pairs, edge = np.array(study_data.methods(rows)), charts.axes[error].edge
    best, lines = study_charts.work_lines(rows, cost, error)
    broad: Entries = {"color": "#9a9a9a", "alpha": 0.35, "linewidth": 7, "solid_capstyle": "round"}
    axes.plot(best[0], np.maximum(best[1], edge), zorder=1, **broad)
    entries: Entries = {}
    for pair, style in charts.styles.items():
        if pair not in lines:
            continue
        _draw_points(axes, x[pairs == pair], np.maximum(y[pairs == pair], edge), style)
        along, up = lines[pair]
        size = 4 if along.size > 1 else 8
        entries[pair] = axes.plot(along, np.maximum(up, edge), markersize=size, **marked_line(style))[0]
    _set_axis(axes, "x", charts.axes[cost])
    _set_axis(axes, "y", charts.axes[error])
    return entries


def _name_points(axes: Axes, points: Entries, charts: Charts, pixels: float) -> None:
    """Write names beside points, from below, each above the one before; a pixel is `pixels` points of print."""
    last = -np.inf
    middle = axes.transAxes.transform((0.5, 0.5))[0]
    at = {pair: axes.transData.transform(point) for pair, point in points.items()}
    for pair in sorted(at, key=lambda pair: float(at[pair][1])):
        last = max(float(at[pair][1]) * pixels, last + 9)
        right = bool(at[pair][0] > middle)
        axes.annotate(
            one_line(pair),
            points[pair],
            (-9 if right else 9, last - float(at[pair][1]) * pixels),
            textcoords="offset points",
            ha="right" if right else "left",
            va="center",
            size=7,
            color=charts.styles[pair].colour,
            bbox={"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 0.4},
        )


def varied_figure(title: str, table: Any, charts: Charts, path: str, statistic: str) -> Figure:
    """Return a figure over one varied value: of the first error with a panel a case, of one case with further measures.

    Lines are the best or the median runs of each pair; with medians a band holds eight of ten runs.
    """
    made = table[table["status"] != study_data.WAITING]
    lost = int((made["status"] != "done").sum())
    lines = f"{study_charts.LINES[statistic]}; {study_charts.MARKED}"
    notes = [f"{statistic} run against {path}: {lines}", *_sampling_note(made)]
    notes += [f"{lost} of {len(made)} runs failed: they are in no line"] if lost else []
    of_cases = _by_case(made)
    several = len(of_cases) > 1 and bool(charts.ranked)
    names = charts.ranked[:1] if several else [name for name in STUDY_PANELS if name in charts.results][:4]
    panels = {
        case if several else charts.axes[name].label: partial(_varied_panel, charts, rows, path, name, statistic)
        for case, rows in (of_cases if several else {"": made}).items()
        for name in names
    }
    return _panels(title, notes, panels, "Nothing was measured.")


def _varied_panel(charts: Charts, made: Any, path: str, name: str, statistic: str, axes: Axes) -> Entries:
    """Draw one measure over one varied value, which is a number or a word; return the legend's entries."""
    across, up = charts.axes[path], charts.axes[name]
    row = 1 if statistic == "best" and name in charts.ranked else 3
    bands = {pair: band for pair, _, band in study_data.bands(made, [name], path) if band[5].any()}
    seen = [pair for pair in charts.styles if pair in bands]
    pairs, places = np.array(study_data.methods(made)), _places(made[path], across)
    measured = np.maximum(study_data.numbers(made[name].where(made["status"] == "done")), up.edge)
    entries: Entries = {}
    for turn, pair in enumerate(seen):
        style, band = charts.styles[pair], bands[pair][:, bands[pair][5] > 0]
        low, high, line = (np.maximum(band[k], up.edge) for k in (2, 4, row))
        if np.isnan(band[0]).all():
            entries[pair] = axes.axhline(line[0], **{**marked_line(style), "marker": ""})
            continue
        aside = study_charts.place_aside(turn, len(seen)) if across.words else 0.0
        _draw_points(axes, places[pairs == pair] + aside, measured[pairs == pair], style)
        filled = row == 3 and len(seen) <= study_charts.MOST_BANDS and not across.words
        if filled and (high > low).any():
            axes.fill_between(band[0], low, high, color=style.colour, alpha=0.14, lw=0)
        marked = marked_line(style) | ({"linestyle": "none"} if across.words else {})
        entries[pair] = axes.plot(band[0] + aside, line, markersize=5, **marked)[0]
        partly = band[5] < band[6]
        ring: Entries = {"color": style.colour, "fillstyle": "none", "markersize": 10, "zorder": 4}
        axes.plot(band[0, partly] + aside, line[partly], "o", **ring)
    _set_axis(axes, "x", across)
    _set_axis(axes, "y", up)
    return entries


def _places(column: Any, across: Axis) -> Any:
    """Return the place of each value on an axis: the number itself, or the place of a word."""
    if not across.words:
        return study_data.numbers(column)
    return np.array([float(across.words.index(text)) for text in study_data.texts(column)])


def profile_figure(title: str, profile: ProfileChart, charts: Charts) -> Figure:
    """Return a figure of the performance profiles of the pairs of methods by one measure."""

    def draw(axes: Axes) -> Entries:
        entries = {}
        for pair, (factors, shares) in profile.lines.items():
            style = {**marked_line(charts.styles[pair]), "marker": ""}
            entries[pair] = axes.step(factors, shares, where="post", **style)[0]
        axes.set(xlim=(1, profile.end), ylim=(0, 1.03), xlabel=profile.label, ylabel="share of problems")
        log_axis(axes, "x")
        return entries

    notes = [study_charts.CAPTIONS["profile"], profile.note]
    return _panels(title, notes, {} if profile.empty else {"": draw}, profile.empty, 4.8)


def marked_line(style: LineStyle) -> Entries:
    """Return matplotlib's options for a line with marks in the style of a pair of methods."""
    return {
        "color": style.colour,
        "linestyle": (0, style.dash) if style.dash else "-",
        "linewidth": 1.8,
        **_mark(style),
    }


def _mark(style: LineStyle) -> Entries:
    """Return matplotlib's options for the mark of a pair of methods."""
    shape = MARKERS[style.mark.removeprefix("open ")]
    return {"marker": shape, "markerfacecolor": "white" if style.mark.startswith("open") else style.colour}


def _draw_points(axes: Axes, x: Any, y: Any, style: LineStyle) -> None:
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if rows.size > MOST_MARKS:
        rows = np.sort(np.random.default_rng(study_data.SEED).choice(rows, MOST_MARKS, replace=False))
    many = rows.size > 300
    # An open mark among many would be a white speck.
    hollow = style.mark.startswith("open") and not many
    axes.scatter(
        x[rows],
        y[rows],
        s=6 if many else 16,
        alpha=0.15 if many else 0.5,
        marker=MARKERS[style.mark.removeprefix("open ")],
        facecolors="none" if hollow else style.colour,
        edgecolors=style.colour,
        linewidths=0.8 if hollow else 0,
        rasterized=many,
    )


def _set_axis(axes: Axes, which: str, axis: Axis) -> None:
    """Name an axis, make it logarithmic where it is, and put ticks at its words or at its values where they are few."""
    axes.set(**{f"{which}label": one_line(axis.label)})
    side = axes.xaxis if which == "x" else axes.yaxis
    if axis.log:
        log_axis(axes, which)
    if axis.ticks:
        side.set_ticks(axis.ticks, [tick_text(tick) for tick in axis.ticks])
    if axis.words:
        none = f"no {axis.label.rpartition('.')[2]}"
        words = [study_data.as_label(one_line(word)) or none for word in axis.words]
        side.set_ticks(range(len(words)), words)


def _sampling_note(rows: Any) -> list[str]:
    """Return a note for the figure if a pair of methods has more runs than are drawn as points, else nothing."""
    most = max(Counter(study_data.methods(rows)).values(), default=0)
    return [f"of each pair of methods {MOST_MARKS} points at most are drawn, at random"] if most > MOST_MARKS else []
