"""Figures of a study for print: the best of each case, error over cost, error over each varied value, and profiles."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from percuss.case.quantities import STUDY_PANELS, of_column
from percuss.errors import InputError, Problem
from percuss.files import is_file
from percuss.jsonable import Entries
from percuss.methods.interfaces import Floats
from percuss.reporting import page_rows, study_charts, study_data
from percuss.reporting.figures import SOFT, legend_below, log_axis, new_figure, one_line, tick_text, write, write_reason
from percuss.reporting.study_charts import Axis, Charts, LineStyle, ProfileChart
from percuss.reporting.study_data import Cell

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.studies.study_table import Study

    Fronts: TypeAlias = tuple[Floats, dict[str, Floats]]  # that of all runs, and those of the pairs of methods
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
    drawn = _Drawn(study.title, table, charts, statistic)
    if error:
        yield "best-and-median", drawn.best(error)
    for n, cost in enumerate(charts.costs if error else [""]):
        name = f"work-precision-{_file_name(cost)}" if n else "work-precision"
        yield name, drawn.work(done, cost, error)
    for path in roles.varied:
        if done[path].nunique() > 1:
            yield f"against-{_file_name(path)}", drawn.varied(path)
    if table["case"].nunique() > 1 and error:
        problems = study_data.problems(table, roles.varied)
        yield "performance-profile", drawn.profile(study_charts.profile_chart(table, roles, error, problems, statistic))


def work_and_precision(study: Study) -> Figure:
    """Return the figure of the error of all runs over their cost."""
    return next(figure for name, figure in figures(study) if name == "work-precision")


def _file_name(column: str) -> str:
    return re.sub(r"[^0-9A-Za-z_]+", "-", column)


def _by_case(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the rows of each case."""
    return {case: rows.iloc[own] for (case,), own in study_data.groups(study_data.texts(rows["case"])).items()}


class _Drawn(NamedTuple):
    """A study as its figures show it: the table with shares in per cent, the charts, and what lines show of runs."""

    title: str
    table: pd.DataFrame
    charts: Charts
    statistic: str

    def _panels(
        self, notes: list[str], panels: Mapping[str, Drawing], empty: str, high: float = 3.6, most: int = 2
    ) -> Figure:
        """Return a figure with a panel below each heading, one legend beside them; or the reason why it is empty."""
        count = max(len(panels), 1)
        across = min(count, most)
        down = -(-count // across)
        with new_figure(12.8, 1.3 + high * down, self.title, notes) as figure:
            grid = list(figure.subplots(down, across, squeeze=False).flat)
            entries: Entries = {}
            for axes, (heading, draw) in zip(grid, panels.items(), strict=False):
                entries |= draw(axes)
                axes.set_title(one_line(heading), loc="left", size=11)
            if not panels:
                write_reason(grid[0], empty)
            for axes in grid[count:]:
                axes.set_axis_off()
            legend_below(figure, entries, beside=True)
        return figure

    def best(self, name: str) -> Figure:
        """Return a figure with the best and the median run of each pair, in each case from the best pair on."""
        cells = study_data.cells(self.table, name)
        most = max(map(len, cells.values()), default=1)
        notes = [f"the {MOST_RANKED} best pairs are drawn"] if most > MOST_RANKED else []
        panels = {case: partial(self._draw_best, name, of_case) for case, of_case in cells.items()}
        high = 0.8 + 0.26 * min(most, MOST_RANKED)
        return self._panels([study_charts.CAPTIONS["best"], *notes], panels, "There is no run.", high, 1)

    def _draw_best(self, name: str, of_case: dict[str, Cell], axes: Axes) -> Entries:
        """Draw the best and the median of each pair of one case, and write their values beside them."""
        ranked = sorted(of_case, key=lambda pair: (not of_case[pair].measured, of_case[pair].best))[:MOST_RANKED]
        edge = self.charts.axes[name].edge
        quantity = of_column(name)
        unit = 0.01 if quantity.is_fraction else 1.0  # the table has shares in per cent
        for place, pair in enumerate(ranked):
            style, cell = self.charts.styles[pair], of_case[pair]
            best, median = max(cell.best, edge), max(cell.median, edge)
            axes.plot([best, median], [place, place], color=style.colour, linewidth=1.5, alpha=0.6)
            axes.plot(median, place, color=style.colour, marker="|", markersize=12, markeredgewidth=2)
            axes.plot(best, place, color=style.colour, markersize=7, **_mark(style))
            best_text, median_text = (quantity.text(unit * value) for value in (cell.best, cell.median))
            values = f"{best_text}, median {median_text}" if cell.measured else ""
            words = "; ".join(filter(None, (values, cell.lost_words)))
            axes.text(1.01, place, words, transform=axes.get_yaxis_transform(), size=7.5, va="center", color=SOFT)
        axes.set_yticks(range(len(ranked)), [one_line(pair) for pair in ranked], fontsize=8)
        axes.set_ylim(len(ranked) - 0.4, -0.6)
        _set_axis(axes, "x", self.charts.axes[name])
        return {}

    def work(self, done: pd.DataFrame, cost: str, error: str) -> Figure:
        """Return a figure of error over cost, with one panel a case.

        A line joins the Pareto front of the runs of one pair of methods in a panel; a front of one run has its name.
        """
        of_cases = _by_case(done) if cost and error else {}
        both = [np.isfinite(study_data.numbers(done[name])) for name in (cost, error) if name]
        lacking = int((~np.all(both, axis=0)).sum()) if both else 0
        notes = [study_charts.CAPTIONS["work"], *_sampling_note(done)]
        notes += [f"{lacking} runs that are done have no cost or no error: they are not drawn"] if lacking else []
        fronts = {case: study_charts.work_lines(rows, cost, error) for case, rows in of_cases.items()}
        panels = {case: partial(self._draw_work, rows, cost, error, fronts[case]) for case, rows in of_cases.items()}
        figure = self._panels(notes, panels, "No cost or no error was recorded.")
        for axes, (_, lines) in zip(figure.axes, fronts.values(), strict=False):
            points = {pair: line[:, 0] for pair, line in lines.items() if line.shape[1] == 1}
            self._name_points(axes, points, 72 / figure.dpi)
        return figure

    def _draw_work(self, rows: pd.DataFrame, cost: str, error: str, fronts: Fronts, axes: Axes) -> Entries:
        """Draw the runs of one case and their Pareto fronts, and return the legend's entries."""
        x, y, edge = study_data.numbers(rows[cost]), study_data.numbers(rows[error]), self.charts.axes[error].edge
        pairs, (best, lines) = np.array(study_data.methods(rows)), fronts
        broad: Entries = {"color": "#9a9a9a", "alpha": 0.35, "linewidth": 7, "solid_capstyle": "round"}
        axes.plot(best[0], np.maximum(best[1], edge), zorder=1, **broad)
        entries: Entries = {}
        for pair, style in self.charts.styles.items():
            if pair in lines:
                _draw_points(axes, x[pairs == pair], np.maximum(y[pairs == pair], edge), style)
                along, up = lines[pair]
                size = 4 if along.size > 1 else 8
                (entries[pair],) = axes.plot(along, np.maximum(up, edge), markersize=size, **marked_line(style))
        _set_axis(axes, "x", self.charts.axes[cost])
        _set_axis(axes, "y", self.charts.axes[error])
        return entries

    def _name_points(self, axes: Axes, points: dict[str, Floats], pixels: float) -> None:
        """Write names beside points, from below, each above the one before; a pixel is `pixels` points of print."""
        last = -np.inf
        middle = axes.transAxes.transform((0.5, 0.5))[0]
        at = {pair: axes.transData.transform(point) for pair, point in points.items()}
        box = {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 0.4}
        for pair in sorted(at, key=lambda pair: float(at[pair][1])):
            height = float(at[pair][1]) * pixels
            last = max(height, last + 9)
            across, side = (-9, "right") if at[pair][0] > middle else (9, "left")
            style: Entries = {"ha": side, "va": "center", "size": 7, "color": self.charts.styles[pair].colour}
            offset = (across, last - height)
            axes.annotate(one_line(pair), tuple(points[pair]), offset, textcoords="offset points", bbox=box, **style)

    def varied(self, path: str) -> Figure:
        """Return a figure over a varied value: of the first error with a panel a case, of one case with more measures.

        Lines are the best or the median runs of each pair; with medians a band holds eight of ten runs.
        """
        charts, made = self.charts, self.table[self.table["status"] != study_data.WAITING]
        lost = int((made["status"] != "done").sum())
        lines = f"{study_charts.LINES[self.statistic]}; {study_charts.MARKED}"
        notes = [f"{self.statistic} run against {path}: {lines}", *_sampling_note(made)]
        notes += [f"{lost} of {len(made)} runs failed: they are in no line"] if lost else []
        of_cases = _by_case(made)
        if len(of_cases) > 1 and charts.ranked:
            panels = {case: partial(self._draw_varied, rows, path, charts.ranked[0]) for case, rows in of_cases.items()}
        else:
            names = [name for name in STUDY_PANELS if name in charts.results][:4]
            panels = {charts.axes[name].label: partial(self._draw_varied, made, path, name) for name in names}
        return self._panels(notes, panels, "Nothing was measured.")

    def _draw_varied(self, made: pd.DataFrame, path: str, name: str, axes: Axes) -> Entries:
        """Draw one measure over one varied value, which is a number or a word; return the legend's entries."""
        across, up = self.charts.axes[path], self.charts.axes[name]
        row = 1 if self.statistic == "best" and name in self.charts.ranked else 3
        bands = study_data.bands(made, name, path)
        seen = [pair for pair in self.charts.styles if pair in bands]
        pairs, places = np.array(study_data.methods(made)), _places(made[path], across)
        measured = np.maximum(study_data.numbers(made[name].where(made["status"] == "done")), up.edge)
        filled = row == 3 and len(seen) <= study_charts.MOST_BANDS and not across.words
        entries: Entries = {}
        for turn, pair in enumerate(seen):
            style, band = self.charts.styles[pair], bands[pair][:, bands[pair][5] > 0]
            aside = study_charts.place_aside(turn, len(seen)) if across.words else 0.0
            ring: Entries = {"color": style.colour, "fillstyle": "none", "markersize": 10, "zorder": 4}
            # Where all runs failed there is no height: the ring stands on the lower edge.
            gone, edge = bands[pair][0, bands[pair][5] == 0] + aside, axes.get_xaxis_transform()
            axes.plot(gone, np.zeros_like(gone), "o", transform=edge, clip_on=False, in_layout=False, **ring)
            if not band.size:
                (entries[pair],) = axes.plot([], [], markersize=5, **marked_line(style))
                continue
            low, high, line = (np.maximum(band[k], up.edge) for k in (2, 4, row))
            if np.isnan(band[0]).all():
                entries[pair] = axes.axhline(line[0], **{**marked_line(style), "marker": ""})
                continue
            _draw_points(axes, places[pairs == pair] + aside, measured[pairs == pair], style)
            if filled and (high > low).any():
                axes.fill_between(band[0], low, high, color=style.colour, alpha=0.14, lw=0)
            marked = marked_line(style) | ({"linestyle": "none"} if across.words else {})
            (entries[pair],) = axes.plot(band[0] + aside, line, markersize=5, **marked)
            partly = band[5] < band[6]
            axes.plot(band[0, partly] + aside, line[partly], "o", **ring)
        _set_axis(axes, "x", across)
        _set_axis(axes, "y", up)
        return entries

    def profile(self, profile: ProfileChart) -> Figure:
        """Return a figure of the performance profiles of the pairs of methods by one measure."""

        def draw(axes: Axes) -> Entries:
            entries: Entries = {}
            for pair, (factors, shares) in profile.lines.items():
                style = {**marked_line(self.charts.styles[pair]), "marker": ""}
                (entries[pair],) = axes.step(factors, shares, where="post", **style)
            axes.set(xlim=(1, profile.end), ylim=(0, 1.03), xlabel=profile.label, ylabel="share of problems")
            log_axis(axes, "x")
            return entries

        notes = [study_charts.CAPTIONS["profile"], profile.note]
        return self._panels(notes, {} if profile.empty else {"": draw}, profile.empty, 4.8)


def _places(column: pd.Series, across: Axis) -> Floats:
    """Return the place of each value on an axis: the number itself, or the place of a word."""
    if not across.words:
        return np.asarray(study_data.numbers(column))
    return np.array([float(across.words.index(text)) for text in study_data.texts(column)])


def marked_line(style: LineStyle) -> Entries:
    """Return matplotlib's options for a line with marks in the style of a pair of methods."""
    dashes = (0, style.dash) if style.dash else "-"
    return {"color": style.colour, "linestyle": dashes, "linewidth": 1.8, **_mark(style)}


def _mark(style: LineStyle) -> Entries:
    """Return matplotlib's options for the mark of a pair of methods."""
    shape = MARKERS[style.mark.removeprefix("open ")]
    return {"marker": shape, "markerfacecolor": "white" if style.mark.startswith("open") else style.colour}


def _draw_points(axes: Axes, x: Floats, y: Floats, style: LineStyle) -> None:
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if rows.size > MOST_MARKS:
        rows = np.sort(np.random.default_rng(page_rows.SEED).choice(rows, MOST_MARKS, replace=False))
    many = rows.size > 300
    # An open mark among many would be a white speck.
    hollow = style.mark.startswith("open") and not many
    look: Entries = {"facecolors": "none" if hollow else style.colour, "linewidths": 0.8 if hollow else 0}
    look |= {"s": 6, "alpha": 0.15} if many else {"s": 16, "alpha": 0.5}
    mark = MARKERS[style.mark.removeprefix("open ")]
    axes.scatter(x[rows], y[rows], marker=mark, edgecolors=style.colour, rasterized=many, **look)


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


def _sampling_note(rows: pd.DataFrame) -> list[str]:
    """Return a note for the figure if a pair of methods has more runs than are drawn as points, else nothing."""
    most = max(Counter(study_data.methods(rows)).values(), default=0)
    return [f"of each pair of methods {MOST_MARKS} points at most are drawn, at random"] if most > MOST_MARKS else []
