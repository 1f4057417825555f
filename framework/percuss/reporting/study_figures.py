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
from percuss.reporting import study_data
from percuss.reporting.figures import (
    COLOURS,
    DASHES,
    MORE_COLOURS,
    MORE_DASHES,
    RAISED,
    drawing,
    fix_layout,
    header,
    number,
    one_line,
    wrapped,
    write,
    write_reason,
)
from percuss.reporting.study_data import ColumnRoles, StudyLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")
EVERY_COLOUR, EVERY_DASH = (*COLOURS, *MORE_COLOURS), (*DASHES, *MORE_DASHES)
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
    if target.exists() and not target.is_dir():
        problem = Problem(str(target), "", "expected a folder, found a file", "Name another folder.")
        raise InputError([problem])
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = error.strerror or "cannot be made"
        raise InputError([Problem(str(target), "", f"expected a folder that can be written to: {why}")]) from error
    out = []
    for name, figure in figures(study):
        for kind in KINDS:
            out.append(target / f"{name}{kind}")
            _save(figure, out[-1])
    return out


def _save(figure: Figure, path: Path) -> None:
    write(path, lambda: figure)


def figures(study: StudyLike) -> Iterator[tuple[str, Figure]]:
    """Yield the file name without suffix and the figure, for each figure of a study."""
    roles = study_data.columns(study)
    table = study.table[study.table["status"] != study_data.WAITING]
    done = table[table["status"] == "done"]
    error = next((name for name in STUDY_PANELS if name in study_data.ranking(roles)), "")
    cases = list(dict.fromkeys(study_data.texts(done["case"])))
    if len(cases) < 2 or not error or not roles.costs:
        yield "work-precision", work_figure(study.title, done, roles, error, [(cost, "") for cost in roles.costs])
    for n, cost in enumerate(roles.costs if len(cases) > 1 and error else []):
        name = "work-precision" if n == 0 else f"work-precision-{_file_name(cost)}"
        yield name, work_figure(study.title, done, roles, error, [(cost, case) for case in cases])
    for path in roles.varied:
        if done[path].nunique() > 1:
            yield f"against-{_file_name(path)}", varied_figure(study.title, table, roles, path)
    if table["case"].nunique() > 1 and error:
        yield "pairs-and-cases", cases_figure(study.title, table, roles, error)
        yield "performance-profile", profile_figure(study.title, study.table, roles, error)


def _file_name(column: str) -> str:
    return re.sub(r"[^0-9A-Za-z_]+", "-", column)


def work_figure(title: str, done: Any, roles: ColumnRoles, error: str, wanted: list[tuple[str, str]]) -> Figure:
    """Return a figure of error over cost with one panel for each wanted (cost, case); an empty case means all runs.

    A line joins the Pareto front of the runs of one pair of methods in a panel.
    """
    note = (
        "every point is a run that is done; a line joins the runs of one pair of methods in one case that no other of "
        "them beats at its cost, the broad grey line those that no run of any pair beats"
    )
    with drawing():
        from matplotlib.figure import Figure

        across = min(max(len(wanted), 1), 3)
        down = -(-max(len(wanted), 1) // across)
        figure = Figure(figsize=(12.8, 1.6 + 4.0 * down), facecolor="white")
        panels = list(figure.subplots(down, across, squeeze=False, sharey=not any(case for _, case in wanted)).flat)
        if not wanted or not error:
            write_reason(panels[0], "No cost or no error was recorded.")
        entries: dict[str, Any] = {}
        left_out = 0
        for axes, (cost, case) in zip(panels, wanted if error else [], strict=False):
            rows = done[np.array(study_data.texts(done["case"])) == case] if case else done
            entries |= _work_panel(axes, rows, _styles(done), cost, error)
            left_out = max(left_out, int((~_has_both(rows, cost, error)).sum()))
            axes.set_xlabel(roles.measures[cost])
            axes.set_title(one_line(case), loc="left", size=11, parse_math=False)
        for axes in panels[:: across if any(case for _, case in wanted) else len(panels)] if error and wanted else []:
            axes.set_ylabel(roles.measures[error])
        for axes in panels[max(len(wanted), 1) :]:
            axes.set_axis_off()
        lacking = [f"runs that are done without a cost or an error, neither drawn nor ranked: {left_out}"]
        header(figure, title, [note, *(lacking if left_out else []), *_sampling_note(done)], [])
        _add_legend(figure, entries)
        fix_layout(figure)
    return figure


def _has_both(rows: Any, cost: str, error: str) -> Any:
    """Return a mask (rows,) of the runs that have both a cost and an error."""
    return np.isfinite(study_data.numbers(rows[cost])) & np.isfinite(study_data.numbers(rows[error]))


def _work_panel(axes: Axes, rows: Any, styles: dict[str, Any], cost: str, error: str) -> dict[str, Any]:
    """Draw the runs of one panel and their Pareto fronts, and return the legend entries by pair of methods."""
    x, y = study_data.numbers(rows[cost]), study_data.numbers(rows[error])
    method_of_row, references = np.array(study_data.methods(rows)), study_data.references(rows)
    has_both = _has_both(rows, cost, error)
    log = (study_data.may_be_log(x[has_both]), study_data.may_be_log(y[has_both]))
    low = study_data.lowest(y[has_both]) if log[1] else -np.inf
    compete = ~np.isin(method_of_row, references)
    best = study_data.front(x[compete], y[compete])
    axes.plot(
        best[0], np.maximum(best[1], low), color="#9a9a9a", alpha=0.35, linewidth=7, solid_capstyle="round", zorder=1
    )
    entries: dict[str, Any] = {}
    for method, style in styles.items():
        own = (method_of_row == method) & has_both
        if not own.any():
            continue
        _draw_points(axes, x[own], np.maximum(y[own], low), style)
        along, up = study_data.front(x[own], y[own])
        line_style = {"color": style["color"], "linestyle": style["linestyle"], "marker": style["marker"]}
        entries[method] = axes.plot(along, np.maximum(up, low), lw=1.8, markersize=4, **line_style)[0]
    _set_log_scales(axes, log)
    return entries


def varied_figure(title: str, table: Any, roles: ColumnRoles, path: str) -> Figure:
    """Return a figure of measures over one varied value: medians as lines, and bands that hold eight of ten runs."""
    names = [name for name in STUDY_PANELS if name in roles.measures][:4]
    cases = table["case"].nunique()
    notes = [
        f"against {path}; points are runs that are done; lines join medians, bands hold 8 of 10; level: the median of "
        "a method that has no such value; a ring: fewer runs have the number than were made"
    ]
    notes += [f"medians are over the runs of {cases} cases together"] if cases > 1 else []
    lost = int((table["status"] != "done").sum())
    measured = [study_data.numbers(table[name].where(table["status"] == "done")) for name in names]
    if any(study_data.is_log(values) and study_data.lowest(values) > np.nanmin(values) for values in measured):
        notes.append("on a logarithmic axis values below 1e-10 of the largest are drawn at its lower edge")
    notes += [f"{lost} of {len(table)} runs were lost: they are in no median"] if lost else []
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12.8, 8.2 if len(names) > 2 else 5.2), facecolor="white")
        header(figure, title, [*notes, *_sampling_note(table[table["status"] == "done"])], [])
        panels = figure.subplots(-(-max(len(names), 1) // 2), min(max(len(names), 1), 2), squeeze=False)
        entries: dict[str, Any] = {}
        for axes, name in zip(panels.flat, names, strict=False):
            entries |= _draw_measure(axes, table, path, name)
            axes.set_ylabel(roles.measures[name])
            axes.set_xlabel(one_line(path), parse_math=False)
        for axes in panels.flat[len(names) :]:
            axes.set_axis_off()
        _add_legend(figure, entries)
        fix_layout(figure)
    return figure


def _draw_measure(axes: Axes, table: Any, path: str, name: str) -> dict[str, Any]:
    """Draw one measure over one varied value, which is a number or a word; return the legend entries."""
    done = table[table["status"] == "done"]
    values, measured = study_data.numbers(table[path]), study_data.numbers(done[name])
    words = study_data.in_order(study_data.texts(table[path])) if values is None else []
    without = study_data.lacking(table, path)
    log = (values is not None and study_data.is_log(values), study_data.is_log(measured))
    styles, method_of_row = _styles(done), np.array(study_data.methods(table))
    low = study_data.lowest(measured) if log[1] else -np.inf
    level = [method for method in styles if values is not None and method in without]
    bins = study_data.binned(values if values is not None else _positions(table[path], words))
    entries: dict[str, Any] = {}
    for turn, (method, style) in enumerate(styles.items()):
        rows = table[method_of_row == method]
        y = np.maximum(study_data.numbers(rows[name].where(rows["status"] == "done")), low)
        if not np.isfinite(y).any():
            continue
        if method in level:
            entries[method] = _draw_level_line(axes, y, style, path, (level.index(method) + 1) / (len(level) + 1))
            continue
        # Points of different methods at one word would hide each other, so each method is shifted a little.
        aside = 0.6 * (turn - (len(styles) - 1) / 2) / len(styles) if values is None else 0.0
        x = (study_data.numbers(rows[path]) if values is not None else _positions(rows[path], words)) + aside
        _draw_points(axes, x, y, style)
        entries[method] = _draw_median_band(
            axes, (bins[0] + aside, bins[1][method_of_row == method]), y, style, joined=values is not None
        )
    _set_log_scales(axes, log)
    if values is None:
        axes.set_xticks(
            range(len(words)), [study_data.as_label(one_line(word)) or f"no {_last_part(path)}" for word in words]
        )
        for label in axes.get_xticklabels():
            label.set_parse_math(False)
    return entries


def _positions(column: Any, words: list[str]) -> Any:
    """Return the position of each value on an axis of words."""
    return np.array([float(words.index(text)) for text in study_data.texts(column)])


def _last_part(path: str) -> str:
    return one_line(path).split(".")[-1]


def _draw_level_line(axes: Axes, y: Any, style: dict[str, Any], path: str, place: float) -> Any:
    """Draw and return a labelled horizontal line at the median of a pair of methods that lacks the varied value."""
    height, runs, with_number = np.nanmedian(y), y.size, int(np.isfinite(y).sum())
    lost = f", median of {with_number} of {runs}" if with_number < runs else ""
    text_style: dict[str, Any] = {
        "xycoords": axes.get_yaxis_transform(),
        "textcoords": "offset points",
        "ha": "center",
        "size": 9,
    }
    text = axes.annotate(f"no {_last_part(path)}{lost}", (place, height), (0, 3), **text_style)
    text.set_parse_math(False)
    return axes.axhline(height, lw=1.8, color=style["color"], linestyle=style["linestyle"])


def _draw_median_band(axes: Axes, bins: tuple[Any, Any], y: Any, style: dict[str, Any], *, joined: bool) -> Any:
    """Draw medians with their quantile band, and a ring where some runs have no number; return the line of medians."""
    places, where = bins
    own = [(place, y[where == k]) for k, place in enumerate(places)]
    finite = [(place, values[np.isfinite(values)], values.size) for place, values in own]
    statistics = [
        (place, *np.quantile(values, study_data.QUANTILES), values.size < made)
        for place, values, made in finite
        if values.size
    ]
    at, low, middle, high, lost = np.array(statistics).T if statistics else np.zeros((5, 0))
    axes.fill_between(at, low, high, color=style["color"], alpha=0.14 if joined else 0, lw=0)
    dash = style["linestyle"] if joined else "none"
    line = axes.plot(at, middle, color=style["color"], linestyle=dash, marker=style["marker"], markersize=4, lw=1.8)
    rings = lost.astype(bool)
    axes.plot(at[rings], middle[rings], "o", color=style["color"], fillstyle="none", markersize=10, zorder=4)
    return line[0]


def cases_figure(title: str, table: Any, roles: ColumnRoles, name: str) -> Figure:
    """Return a coloured table of pairs of methods and cases, with the median of one measure and its number of runs."""
    cells = study_data.overview(table, name)
    cases = list(dict.fromkeys(case for row in cells.values() for case in row))
    best = study_data.least_medians(cells, set(study_data.references(table)))
    largest = study_data.largest_factor(cells, best)
    note = (
        f"median {roles.measures[name]}, over the runs that have one; colour: from the least median of the case, in "
        f"bold, to {largest:.3g} times that or more"
    )
    with drawing():
        from matplotlib.figure import Figure
        from matplotlib.patches import Rectangle

        figure = Figure(figsize=(max(12.8, 3.5 + 1.7 * len(cases)), 1.8 + 0.55 * len(cells)), facecolor="white")
        header(figure, title, [note], [])
        axes = figure.subplots()
        for (j, (_, row)), (i, case) in itertools.product(enumerate(cells.items()), enumerate(cases)):
            cell = row.get(case)
            colour = (
                study_data.shade(cell, best.get(case), largest) if cell is not None and cell.measured else "#ffffff"
            )
            axes.add_patch(Rectangle((i, j), 1, 1, facecolor=colour, edgecolor="#d5d5d5"))
            small = "no run" if cell is None else study_data.counted(cell)
            small = "\n".join(wrapped(small, 26, 2))
            if cell is None or not cell.measured:
                axes.text(i + 0.5, j + 0.5, small, ha="center", va="center", size=7.5, parse_math=False)
                continue
            first = cell.median == best.get(case) and cell.measured == cell.made
            axes.text(
                i + 0.5,
                j + 0.33,
                number(cell.median, 3),
                ha="center",
                va="center",
                size=11,
                weight="bold" if first else "normal",
            )
            axes.text(i + 0.5, j + 0.73, small, ha="center", va="center", size=7, parse_math=False)
        axes.set(xlim=(0, len(cases)), ylim=(len(cells), 0))
        axes.set_xticks(np.arange(len(cases)) + 0.5, [one_line(case) for case in cases])
        axes.set_yticks(np.arange(len(cells)) + 0.5, [one_line(method) for method in cells])
        axes.tick_params(length=0, labeltop=True, labelbottom=False)
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
            label.set_parse_math(False)
        fix_layout(figure)
    return figure


def profile_figure(title: str, table: Any, roles: ColumnRoles, name: str) -> Figure:
    """Return a figure of the performance profiles of the pairs of methods by one measure."""
    problem_set = study_data.problems(table, roles.varied)
    profile = study_data.profile(table, name, problem_set)
    left = [(problem_set.left_out, "that not every pair was set once"), (profile.unknown, "that could not be judged")]
    parts = [f"{count} problems {why}" for count, why in left if count]
    notes = [
        f"{profile.counted} problems: a case with one value of all that is varied; the share of them on which a pair "
        "comes within a factor of the pair that is best there; a run that is not done is within none "
        "(Dolan, Moré 2002)",
        *([f"left out: {', '.join(parts)}"] if parts else []),
        *(["the tied twins take no part: they need the exact solution"] if study_data.references(table) else []),
    ]
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12.8, 6.2), facecolor="white")
        header(figure, title, notes, [])
        axes = figure.subplots()
        entries: dict[str, Any] = {}
        if not profile.counted:
            write_reason(axes, "There is no problem that every pair was set and that could be judged.")
        finite = np.concatenate(
            [ratios_of_pair[np.isfinite(ratios_of_pair)] for ratios_of_pair in profile.ratios.values()] or [np.ones(1)]
        )
        end = max(1.5, 1.05 * float(finite.max(initial=1.0)))
        for method, style in _styles(table).items() if profile.counted else ():
            ratios = profile.ratios.get(method)
            if ratios is None:
                continue
            x, y = _profile_steps(ratios, end)
            line_style = {"color": style["color"], "linestyle": style["linestyle"]}
            entries[method] = axes.step(x, y, where="post", lw=1.8, **line_style)[0]
        if profile.counted:
            _set_log_scales(axes, (True, False))
            axes.set(xlim=(1, end), ylim=(0, 1.03), ylabel="share of problems")
            axes.set_xlabel(f"{roles.measures[name]} over that of the best pair")
        _add_legend(figure, entries)
        fix_layout(figure)
    return figure


def _profile_steps(ratios: Any, end: float) -> tuple[Any, Any]:
    """Return the factors and the shares of problems of one pair's profile, from factor 1 to the end of the axis."""
    finite = ratios[np.isfinite(ratios)]
    share = np.arange(1, finite.size + 1) / ratios.size
    at_once = np.count_nonzero(finite <= 1) / ratios.size
    return np.array([1.0, *finite, end]), np.array([at_once, *share, share[-1] if share.size else at_once])


def _draw_points(axes: Axes, x: Any, y: Any, style: dict[str, Any]) -> None:
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if rows.size > MOST_MARKS:
        rows = np.sort(np.random.default_rng(study_data.SEED).choice(rows, MOST_MARKS, replace=False))
    many = rows.size > 300
    marks = {"marker": style["marker"], "color": style["color"], "linewidths": 0, "rasterized": many}
    axes.scatter(x[rows], y[rows], s=6 if many else 16, alpha=0.15 if many else 0.5, **marks)


def _sampling_note(done: Any) -> list[str]:
    """Return a note for the figure if a pair of methods has more runs than are drawn as points, else nothing."""
    most = max(Counter(study_data.methods(done)).values(), default=0)
    return [f"of each pair of methods {MOST_MARKS} points at most are drawn, at random"] if most > MOST_MARKS else []


def _styles(table: Any) -> dict[str, dict[str, Any]]:
    """Return the colour, marker and line style of each pair of methods."""
    styles = {}
    for k, method in enumerate(dict.fromkeys(study_data.methods(table))):
        # When the colours repeat, the marker and the line style of a repeated colour differ from those before.
        turn = (k + k // len(MARKS)) % len(MARKS)
        styles[method] = {"color": EVERY_COLOUR[k % len(MARKS)], "marker": MARKS[turn], "linestyle": EVERY_DASH[turn]}
    return styles


def _set_log_scales(axes: Axes, log: tuple[bool, bool]) -> None:
    """Make axes logarithmic, with ticks at 1, 2 and 5 of each decade where there are few decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis, wanted, scale in zip((axes.xaxis, axes.yaxis), log, (axes.set_xscale, axes.set_yscale), strict=True):
        if not wanted:
            continue
        scale("log")
        low, high = axis.get_view_interval()
        if high < 80 * low:
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(_tick_label))
        axis.set_minor_formatter(NullFormatter())


def _tick_label(value: float, _: object = None) -> str:
    """Return the label of a tick as plain text, because mathematical text is drawn ten times as slowly."""
    if 1e-3 <= value < 1e5:
        return f"{value:g}"
    head, power = f"{value:.0e}".split("e")
    raised = str(int(power)).translate(RAISED)
    return f"10{raised}" if head == "1" else f"{head}×10{raised}"


def _add_legend(figure: Figure, entries: dict[str, Any]) -> None:
    """Put one legend below all panels; the names are texts of the user and never read as mathematical text."""
    if not entries:
        return
    longest = max(map(len, entries))
    columns = max(1, min(len(entries), int(12 * figure.get_figwidth()) // (longest + 8)))
    # The space keeps matplotlib from dropping a label that begins with an underscore.
    names = [f" {one_line(name)}" for name in entries]
    legend = figure.legend(list(entries.values()), names, loc="outside lower center", ncols=columns)
    for text in legend.get_texts():
        text.set_parse_math(False)
