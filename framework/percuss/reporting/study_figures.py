"""Figures of a study for print: error over cost, measures over each varied value, medians by case, and profiles."""

from __future__ import annotations

import itertools
import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import STUDY_PANELS
from percuss.errors import InputError, Problem
from percuss.files import is_file
from percuss.reporting import study_charts, study_data
from percuss.reporting.figures import (
    drawing,
    fix_layout,
    header,
    legend_below,
    log_axis,
    one_line,
    tick_text,
    wrapped,
    write,
    write_reason,
)
from percuss.reporting.study_charts import Axis, Charts, LineStyle, ProfileChart
from percuss.reporting.study_data import StudyLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = {"circle": "o", "square": "s", "triangle": "^", "diamond": "D"}
KINDS = (".svg", ".pdf")
# If a pair of methods has more runs than this in one panel, a seeded sample of so many points is drawn.
MOST_MARKS = 3000


def study_figures(study: StudyLike, folder: str | os.PathLike[str]) -> list[Path]:
    """Write the figures of a study as svg and pdf files.

    Parameters
    ----------
    study
        The study.
    folder
        Folder of the files; it is made if it does not exist.

    Returns
    -------
    list of Path
        The files: ``work-precision``, which for several cases has one panel per case and one figure per cost; one
        ``against-...`` for each varied path with more than one value; for several cases also ``pairs-and-cases`` and
        ``performance-profile``.
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
    for name, figure in figures(study_charts.snapshot(study)):
        for kind in KINDS:
            out.append(target / f"{name}{kind}")
            _save(figure, out[-1])
    return out


def _save(figure: Figure, path: Path) -> None:
    write(path, lambda: figure)


def figures(study: StudyLike) -> Iterator[tuple[str, Figure]]:
    """Yield the file name without suffix and the figure, for each figure of a study."""
    table, roles = study.table, study_data.columns(study)
    charts = study_charts.study_charts(table, roles)
    made = table[table["status"] != study_data.WAITING]
    done = made[made["status"] == "done"]
    error = next((name for name in STUDY_PANELS if name in charts.ranked), "")
    cases = list(dict.fromkeys(study_data.texts(done["case"])))
    costs = list(charts.work.across)
    if len(cases) < 2 or not error or not costs:
        yield "work-precision", work_figure(study.title, done, charts, error, [(cost, "") for cost in costs])
    for n, cost in enumerate(costs if len(cases) > 1 and error else []):
        name = "work-precision" if n == 0 else f"work-precision-{_file_name(cost)}"
        yield name, work_figure(study.title, done, charts, error, [(cost, case) for case in cases])
    for path in roles.varied:
        if done[path].nunique() > 1:
            yield f"against-{_file_name(path)}", varied_figure(study.title, table, charts, path)
    if made["case"].nunique() > 1 and error:
        yield "pairs-and-cases", cases_figure(study.title, table, charts, error)
        profile = study_charts.profile_chart(table, roles, error, study_data.problems(table, roles.varied))
        yield "performance-profile", profile_figure(study.title, profile, charts)


def _file_name(column: str) -> str:
    return re.sub(r"[^0-9A-Za-z_]+", "-", column)


def work_figure(title: str, done: Any, charts: Charts, error: str, wanted: list[tuple[str, str]]) -> Figure:
    """Return a figure of error over cost with one panel for each wanted (cost, case); an empty case means all runs.

    A line joins the Pareto front of the runs of one pair of methods in a panel.
    """
    with drawing():
        from matplotlib.figure import Figure

        across = min(max(len(wanted), 1), 3)
        down = -(-max(len(wanted), 1) // across)
        figure = Figure(figsize=(12.8, 1.6 + 4.0 * down), facecolor="white")
        several = any(case for _, case in wanted)
        panels = list(figure.subplots(down, across, squeeze=False, sharey=not several).flat)
        if not wanted or not error:
            write_reason(panels[0], "No cost or no error was recorded.")
            wanted = []
        entries: dict[str, Any] = {}
        left_out = 0
        for axes, (cost, case) in zip(panels, wanted, strict=False):
            rows = done[np.array(study_data.texts(done["case"])) == case] if case else done
            entries |= _work_panel(axes, rows, charts, cost, error)
            both = np.isfinite(study_data.numbers(rows[cost])) & np.isfinite(study_data.numbers(rows[error]))
            left_out = max(left_out, int((~both).sum()))
            axes.set_title(one_line(case), loc="left", size=11, parse_math=False)
        for axes in panels[:: across if several else len(panels)] if wanted else []:
            axes.set_ylabel(charts.axes[error].label)
        for axes in panels[max(len(wanted), 1) :]:
            axes.set_axis_off()
        lacking = [f"runs that are done without a cost or an error, neither drawn nor ranked: {left_out}"]
        notes = [study_charts.CAPTIONS["work"], *(lacking if left_out else []), *_sampling_note(done)]
        header(figure, title, notes, [])
        legend_below(figure, entries)
        fix_layout(figure)
    return figure


def _work_panel(axes: Axes, rows: Any, charts: Charts, cost: str, error: str) -> dict[str, Any]:
    """Draw the runs of one panel and their Pareto fronts, and return the legend entries by pair of methods."""
    x, y = study_data.numbers(rows[cost]), study_data.numbers(rows[error])
    pairs = np.array(study_data.methods(rows))
    log = (charts.work.across[cost], charts.work.up[error])
    edge = charts.axes[error].edge if log[1] else -np.inf
    best, lines = study_charts.work_lines(rows, cost, error)
    broad: dict[str, Any] = {"color": "#9a9a9a", "alpha": 0.35, "linewidth": 7, "solid_capstyle": "round"}
    axes.plot(best[0], np.maximum(best[1], edge), zorder=1, **broad)
    entries: dict[str, Any] = {}
    for pair, style in charts.styles.items():
        if pair not in lines:
            continue
        _draw_points(axes, x[pairs == pair], np.maximum(y[pairs == pair], edge), style)
        along, up = lines[pair]
        entries[pair] = axes.plot(along, np.maximum(up, edge), markersize=4, **marked_line(style))[0]
    _set_axes(axes, log, charts.axes[cost])
    return entries


def varied_figure(title: str, table: Any, charts: Charts, path: str) -> Figure:
    """Return a figure of measures over one varied value: medians as lines, and bands that hold eight of ten runs."""
    names = [name for name in STUDY_PANELS if name in charts.varied.up][:4]
    made = table[table["status"] != study_data.WAITING]
    done = made[made["status"] == "done"]
    cases, lost = made["case"].nunique(), len(made) - len(done)
    notes = [f"against {path}: points are runs that are done; {study_charts.CAPTIONS['vary']}"]
    notes += [f"medians are over the runs of {cases} cases together"] if cases > 1 else []
    log = [name for name in names if charts.varied.up[name]]
    if any(charts.axes[name].edge > np.nanmin(study_data.numbers(done[name])) for name in log):
        notes.append("on a logarithmic axis values below 1e-10 of the largest are drawn at its lower edge")
    notes += [f"{lost} of {len(made)} runs were lost: they are in no median"] if lost else []
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12.8, 8.2 if len(names) > 2 else 5.2), facecolor="white")
        header(figure, title, [*notes, *_sampling_note(done)], [])
        panels = figure.subplots(-(-max(len(names), 1) // 2), min(max(len(names), 1), 2), squeeze=False)
        bands: dict[str, dict[str, Any]] = {name: {} for name in names}
        for pair, name, band in study_data.bands(table, names, path):
            bands[name][pair] = band
        entries: dict[str, Any] = {}
        for axes, name in zip(panels.flat, names, strict=False):
            entries |= _draw_measure(axes, made, charts, path, name, bands[name])
            axes.set_ylabel(charts.axes[name].label)
        for axes in panels.flat[len(names) :]:
            axes.set_axis_off()
        legend_below(figure, entries)
        fix_layout(figure)
    return figure


def _draw_measure(axes: Axes, made: Any, charts: Charts, path: str, name: str, bands: dict[str, Any]) -> dict[str, Any]:
    """Draw one measure over one varied value, which is a number or a word; return the legend entries."""
    across, log = charts.axes[path], (charts.varied.across[path], charts.varied.up[name])
    edge = charts.axes[name].edge if log[1] else -np.inf
    pairs, places = np.array(study_data.methods(made)), _places(made[path], across)
    measured = np.maximum(study_data.numbers(made[name].where(made["status"] == "done")), edge)
    seen = [pair for pair in charts.styles if pair in bands and bands[pair][4].any()]
    level = [pair for pair in seen if np.isnan(bands[pair][0]).all()]
    filled = len(seen) <= study_charts.MOST_BANDS
    entries: dict[str, Any] = {}
    for turn, pair in enumerate(seen):
        style, (place, *quantiles, measured_runs, made) = charts.styles[pair], bands[pair]
        band = np.array([place, *np.maximum(quantiles, edge), measured_runs, made])
        if pair in level:
            share = (level.index(pair) + 1) / (len(level) + 1)
            entries[pair] = _draw_level_line(axes, band[:, 0], style, path, share)
            continue
        aside = study_charts.place_aside(turn, len(seen)) if across.words else 0.0
        own = pairs == pair
        _draw_points(axes, places[own] + aside, measured[own], style)
        bands_of_pair = band[:, band[4] > 0]
        entries[pair] = _draw_median_band(axes, bands_of_pair, aside, style, joined=not across.words, filled=filled)
    _set_axes(axes, log, across)
    if across.words:
        words = [study_data.as_label(one_line(word)) or f"no {_last_part(path)}" for word in across.words]
        axes.set_xticks(range(len(words)), words)
        for label in axes.get_xticklabels():
            label.set_parse_math(False)
    return entries


def _places(column: Any, across: Axis) -> Any:
    """Return the place of each value on an axis: the number itself, or the place of a word."""
    if not across.words:
        return study_data.numbers(column)
    return np.array([float(across.words.index(text)) for text in study_data.texts(column)])


def _last_part(path: str) -> str:
    return one_line(path).split(".")[-1]


def _draw_level_line(axes: Axes, band: Any, style: LineStyle, path: str, share: float) -> Any:
    """Draw and return a labelled horizontal line at the median of a pair of methods that lacks the varied value."""
    height, measured, made = band[2], int(band[4]), int(band[5])
    lost = f", median of {measured} of {made}" if measured < made else ""
    text_style: dict[str, Any] = {
        "xycoords": axes.get_yaxis_transform(),
        "textcoords": "offset points",
        "ha": "center",
        "size": 9,
    }
    text = axes.annotate(f"no {_last_part(path)}{lost}", (share, height), (0, 3), **text_style)
    text.set_parse_math(False)
    return axes.axhline(height, **{**marked_line(style), "marker": ""})


def _draw_median_band(axes: Axes, band: Any, aside: float, style: LineStyle, *, joined: bool, filled: bool) -> Any:
    """Draw medians, and a ring where some runs have no number; return the line of medians.

    The quantiles are a band beside the line, if it is `filled`. No line joins words: there a bar holds them.
    """
    place, low, middle, high, measured, made = band
    at = place + aside
    if joined and filled:
        axes.fill_between(at, low, high, color=style.colour, alpha=0.14, lw=0)
    elif not joined:
        axes.vlines(at, low, high, color=style.colour, alpha=0.5, lw=3)
    marked = marked_line(style) | ({} if joined else {"linestyle": "none"})
    line = axes.plot(at, middle, markersize=4, **marked)
    ring: dict[str, Any] = {"color": style.colour, "fillstyle": "none", "markersize": 10, "zorder": 4}
    axes.plot(at[measured < made], middle[measured < made], "o", **ring)
    return line[0]


def cases_figure(title: str, table: Any, charts: Charts, name: str) -> Figure:
    """Return a coloured table of pairs of methods and cases, with the median of one measure and its number of runs."""
    shown = study_charts.pairs_table(table, name)
    cases, rows = shown.cases, shown.rows
    with drawing():
        from matplotlib.figure import Figure
        from matplotlib.patches import Rectangle

        figure = Figure(figsize=(max(12.8, 3.5 + 1.7 * len(cases)), 1.8 + 0.55 * len(rows)), facecolor="white")
        header(figure, title, [f"{charts.axes[name].label}: {study_charts.CAPTIONS['pairs']}. {shown.note}"], [])
        axes = figure.subplots()
        centred: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False}
        for (j, row), (i, _) in itertools.product(enumerate(rows.values()), enumerate(cases)):
            cell = row[i]
            axes.add_patch(Rectangle((i, j), 1, 1, facecolor=cell.colour or "#ffffff", edgecolor="#d5d5d5"))
            weight = "bold" if cell.best else "normal"
            axes.text(i + 0.5, j + 0.33, cell.text, size=11, weight=weight, **centred)
            small = "\n".join(wrapped(cell.small, 26, 2))
            axes.text(i + 0.5, j + (0.73 if cell.text else 0.5), small, size=7, **centred)
        axes.set(xlim=(0, len(cases)), ylim=(len(rows), 0))
        axes.set_xticks(np.arange(len(cases)) + 0.5, [one_line(case) for case in cases])
        axes.set_yticks(np.arange(len(rows)) + 0.5, [one_line(pair) for pair in rows])
        axes.tick_params(length=0, labeltop=True, labelbottom=False)
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
            label.set_parse_math(False)
        fix_layout(figure)
    return figure


def profile_figure(title: str, profile: ProfileChart, charts: Charts) -> Figure:
    """Return a figure of the performance profiles of the pairs of methods by one measure."""
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12.8, 6.2), facecolor="white")
        header(figure, title, [study_charts.CAPTIONS["profile"], profile.note], [])
        axes = figure.subplots()
        entries: dict[str, Any] = {}
        if profile.empty:
            write_reason(axes, profile.empty)
        for pair, (factors, shares) in profile.lines.items():
            style = {**marked_line(charts.styles[pair]), "marker": ""}
            entries[pair] = axes.step(factors, shares, where="post", **style)[0]
        if not profile.empty:
            axes.set(xlim=(1, profile.end), ylim=(0, 1.03), ylabel="share of problems")
            log_axis(axes, "x")
            axes.set_xlabel(profile.label)
        legend_below(figure, entries)
        fix_layout(figure)
    return figure


def marked_line(style: LineStyle) -> dict[str, Any]:
    """Return matplotlib's options for a line with marks in the style of a pair of methods."""
    return {
        "color": style.colour,
        "linestyle": (0, style.dash) if style.dash else "-",
        "linewidth": 1.8,
        **_mark(style),
    }


def _mark(style: LineStyle) -> dict[str, Any]:
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


def _set_axes(axes: Axes, log: tuple[bool, bool], across: Axis) -> None:
    """Name the axis across, make axes logarithmic, and put ticks at the values where there are few."""
    axes.set_xlabel(one_line(across.label), parse_math=False)
    for which, wanted in zip("xy", log, strict=True):
        if wanted:
            log_axis(axes, which)
    if across.ticks:
        axes.set_xticks(across.ticks, [tick_text(tick) for tick in across.ticks])


def _sampling_note(done: Any) -> list[str]:
    """Return a note for the figure if a pair of methods has more runs than are drawn as points, else nothing."""
    most = max(Counter(study_data.methods(done)).values(), default=0)
    return [f"of each pair of methods {MOST_MARKS} points at most are drawn, at random"] if most > MOST_MARKS else []
