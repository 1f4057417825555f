"""Pictures of a study for print: error against cost, and measures against each varied value."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss import study_data
from percuss.errors import InputError, Problem
from percuss.figures import (
    COLOURS,
    DASHES,
    MORE_COLOURS,
    MORE_DASHES,
    RAISED,
    drawing,
    header,
    one_line,
    say,
    settle,
    write,
)
from percuss.study_data import COSTS, Columns, StudyLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = ("force_error_l1", "impulse_error", "noise", "penetration", "peak_force", "energy_max")
MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")
EVERY_COLOUR, EVERY_DASH = (*COLOURS, *MORE_COLOURS), (*DASHES, *MORE_DASHES)
KINDS = (".svg", ".pdf")
MOST_MARKS = 3000  # of a method in one panel; a seeded sample of them beyond


def study_figures(study: StudyLike, folder: str | os.PathLike[str]) -> list[Path]:
    """Write the pictures of a study as svg and pdf.

    Parameters
    ----------
    study
        What to draw.
    folder
        Where to; made if there is none.

    Returns
    -------
    list of Path
        ``work-precision`` and one ``against-...`` for each varied value that has more than one.
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
    """Yield the name and the figure of every picture of a study."""
    known = study_data.columns(study)
    done = study.table[study.table["status"] == "done"]
    yield "work-precision", work_figure(study.title, done, known)
    for path in known.varied:
        if done[path].nunique() > 1:
            yield f"against-{re.sub(r'[^0-9A-Za-z_]+', '-', path)}", varied_figure(study.title, done, known, path)


def work_figure(title: str, done: Any, known: Columns) -> Figure:
    """Return error against cost, a panel a cost; lines join the runs that no other of the method beats."""
    errors = [name for name in SHOWN if name in known.measures]
    costs = [name for name in COSTS if name in known.measures]
    note = "every point is a run that is done; the lines join those that no other of the method beats at its cost"
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12.8, 5.6), facecolor="white")
        header(figure, title, [note], [])
        panels = figure.subplots(1, max(len(costs), 1), sharey=True, squeeze=False)[0]
        if not costs or not errors:
            say(panels[0], "No cost or no error was recorded.")
        entries: dict[str, Any] = {}
        for axes, cost in zip(panels, costs if errors else [], strict=False):
            for method, rows, look in _methods(done):
                x, y = (
                    (study_data.numbers(rows[name]) for name in (cost, errors[0]))
                    if errors
                    else (np.zeros(0), np.zeros(0))
                )
                _dots(axes, x, y, look, log=(True, True))
                line = axes.plot(*study_data.front(x, y), color=look["color"], linestyle=look["linestyle"], lw=1.8)
                entries[method] = line[0]
                line[0].set(marker=look["marker"], markersize=4)
            axes.set_xlabel(known.measures[cost])
            _scales(axes, (True, True))
        if errors and costs:
            panels[0].set_ylabel(known.measures[errors[0]])
        _legend(figure, entries)
        settle(figure)
    return figure


def varied_figure(title: str, done: Any, known: Columns, path: str) -> Figure:
    """Return measures against one varied value: medians as lines, bands that hold eight of ten runs."""
    names = [name for name in SHOWN if name in known.measures][:4]
    note = "points are runs that are done; lines join medians, bands hold 8 of 10; level: a method without this value"
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12.8, 8.2 if len(names) > 2 else 5.2), facecolor="white")
        header(figure, title, [f"against {path}; {note}"], [])
        panels = figure.subplots(-(-max(len(names), 1) // 2), min(max(len(names), 1), 2), squeeze=False)
        entries: dict[str, Any] = {}
        for axes, name in zip(panels.flat, names, strict=False):
            entries |= _against(axes, done, path, name)
            axes.set_ylabel(known.measures[name])
            axes.set_xlabel(one_line(path), parse_math=False)
        for axes in panels.flat[len(names) :]:
            axes.set_axis_off()
        _legend(figure, entries)
        settle(figure)
    return figure


def _against(axes: Axes, done: Any, path: str, name: str) -> dict[str, Any]:
    """Draw one measure against one varied value, numbers or words."""
    values, measured = study_data.numbers(done[path]), study_data.numbers(done[name])
    words = study_data.in_order(study_data.texts(done[path])) if values is None else []
    log = (values is not None and study_data.is_log(values), study_data.is_log(measured))
    entries: dict[str, Any] = {}
    turns = list(_methods(done))
    for turn, (method, rows, look) in enumerate(turns):
        y = study_data.numbers(rows[name])
        if values is None:
            # methods stand beside each other where the axis holds words
            aside = 0.6 * (turn - (len(turns) - 1) / 2) / len(turns)
            x = np.array([words.index(text) for text in study_data.texts(rows[path])]) + aside
        else:
            x = study_data.numbers(rows[path])
        if not np.isfinite(y).any():
            continue
        if not (np.isfinite(x) & np.isfinite(y)).any():
            style = {"color": look["color"], "linestyle": look["linestyle"]}
            entries[method] = axes.axhline(np.nanmedian(y), lw=1.8, **style)
            continue
        _dots(axes, x, y, look, log=log)
        entries[method] = _band(axes, x, y, look, joined=values is not None)
    _scales(axes, log)
    if log[1]:
        above = measured[measured > study_data.ROUND_OFF * np.nanmax(measured)]
        axes.set_ylim(bottom=max(axes.get_ylim()[0], 0.6 * above.min()))
    if values is None:
        axes.set_xticks(range(len(words)), [one_line(word) or "none" for word in words])
        for label in axes.get_xticklabels():
            label.set_parse_math(False)
    return entries


def _band(axes: Axes, x: Any, y: Any, look: dict[str, Any], *, joined: bool) -> Any:
    places, where = study_data.binned(x)
    found = [(place, y[(where == k) & np.isfinite(y)]) for k, place in enumerate(places)]
    known = [(place, *np.quantile(values, study_data.QUANTILES)) for place, values in found if values.size]
    at, low, middle, high = np.array(known).T
    axes.fill_between(at, low, high, color=look["color"], alpha=0.14 if joined else 0, lw=0)
    style = look["linestyle"] if joined else "none"
    line = axes.plot(at, middle, color=look["color"], linestyle=style, marker=look["marker"], markersize=4, lw=1.8)
    return line[0]


def _dots(axes: Axes, x: Any, y: Any, look: dict[str, Any], *, log: tuple[bool, bool]) -> None:
    good = np.isfinite(x) & np.isfinite(y) & ((x > 0) | (not log[0])) & ((y > 0) | (not log[1]))
    rows = np.flatnonzero(good)
    if rows.size > MOST_MARKS:
        rows = np.sort(np.random.default_rng(study_data.SEED).choice(rows, MOST_MARKS, replace=False))
    many = rows.size > 300
    style = {"marker": look["marker"], "color": look["color"], "linewidths": 0, "rasterized": many}
    axes.scatter(x[rows], y[rows], s=6 if many else 16, alpha=0.15 if many else 0.5, **style)


def _methods(done: Any) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Yield each method, its rows, and its colour, mark and dash."""
    every = np.array(study_data.methods(done))
    for k, method in enumerate(dict.fromkeys(every.tolist())):
        turn = (k + k // len(MARKS)) % len(MARKS)  # a colour that comes round has another mark and dash
        look = {"color": EVERY_COLOUR[k % len(MARKS)], "marker": MARKS[turn], "linestyle": EVERY_DASH[turn]}
        yield method, done[every == method], look


def _scales(axes: Axes, log: tuple[bool, bool]) -> None:
    """Set logarithmic axes, with the numbers 1, 2, 5 where there are few decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis, wanted, scale in zip((axes.xaxis, axes.yaxis), log, (axes.set_xscale, axes.set_yscale), strict=True):
        if not wanted:
            continue
        scale("log")
        low, high = axis.get_view_interval()
        if high < 80 * low:
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(_power))
        axis.set_minor_formatter(NullFormatter())


def _power(value: float, _: object = None) -> str:
    """Return a tick's number in plain letters: no mathematics, which is drawn ten times as slowly."""
    if 1e-3 <= value < 1e5:
        return f"{value:g}"
    head, power = f"{value:.0e}".split("e")
    raised = str(int(power)).translate(RAISED)
    return f"10{raised}" if head == "1" else f"{head}×10{raised}"


def _legend(figure: Figure, entries: dict[str, Any]) -> None:
    """Put one legend below all panels; the names are the user's text, never mathematics."""
    if not entries:
        return
    longest = max(map(len, entries))
    columns = max(1, min(len(entries), int(12 * figure.get_figwidth()) // (longest + 8)))
    names = [f" {one_line(name)}" for name in entries]  # matplotlib drops a label that begins with _
    made = figure.legend(list(entries.values()), names, loc="outside lower center", ncols=columns)
    for text in made.get_texts():
        text.set_parse_math(False)
