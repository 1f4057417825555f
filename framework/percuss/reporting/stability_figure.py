"""Figures of stability: critical Courant numbers as curves or maps, and waves at an interface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.case.quantities import QUANTITIES
from percuss.certificate.maps import STEP
from percuss.jsonable import Entries
from percuss.reporting.figures import COLOURS, DASHES, INK, SOFT, log_axis, new_figure, number, write_reason

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.certificate.waves import Waves

Axis = Mapping[str, Sequence[Any]]
MARKS = ("o", "s", "^", "D", "v", "P")
WORDS = {
    "courant_critical": QUANTITIES["courant_critical"].label,
    "theta": "θ: the share of the overlap taken back; stable up to 1",
    "margin": "step over the critical step; stable up to 1",
}


def stability_figure(rows: list[Entries], vary: Axis, curves: Axis, title: str, methods: str) -> Figure:
    """Return a figure of critical Courant numbers over one varied value as curves, or over two as maps.

    Parameters
    ----------
    rows
        Rows from `percuss.stability`.
    vary, curves
        Values of the varied paths; `vary` has one or two paths.
    title, methods
        Title of the figure, and the line of methods below it.
    """
    subject = "stability of the closed linear step, in the worst combination of contacts"
    by_label: dict[str, list[Entries]] = {}
    for row in rows:
        label = ", ".join(f"{path.rsplit('.', 1)[-1]} = {number(row[path])}" for path in curves)
        by_label.setdefault(label, []).append(row)
    quantity = "courant_critical"
    if set(STEP) & set(vary):
        quantity = "theta" if any(row.get("theta") is not None for row in rows) else "margin"
    drawn = _Drawn(quantity, vary, list(dict.fromkeys(row["by"] for row in rows)), by_label)
    with new_figure(9.6, 6.4, title, [methods, subject, *_notes(rows, drawn)]) as figure:
        if not any(row["courant_critical"] is not None for row in rows):
            write_reason(figure.subplots(), f"nothing to draw: {rows[0]['reason']}")
        elif len(vary) == 2:
            _draw_maps(figure, drawn)
        else:
            _draw_curves(figure, drawn)
    return figure


class _Drawn(NamedTuple):
    """What a figure of stability shows.

    Attributes
    ----------
    quantity
        Key of the drawn quantity: the critical Courant number; theta or margin where the step is varied.
    vary
        Values of the paths along the axes.
    criteria
        The criteria by which it was found.
    curves
        The rows of each curve or map, by its label.
    """

    quantity: str
    vary: Axis
    criteria: list[str]
    curves: dict[str, list[Entries]]


def _notes(rows: list[Entries], drawn: _Drawn) -> list[str]:
    """Return notes on what is not drawn: points without a number, and on maps the criteria after the first."""
    missing = [row["reason"] or "no reason given" for row in rows if row.get(drawn.quantity) is None]
    first, *others = drawn.criteria
    words = [f"{len(missing)} of {len(rows)} points have no number and are left blank: {missing[0]}"] if missing else []
    return words + ([f"the maps are those of the {first}"] if len(drawn.vary) == 2 and others else [])


def _draw_curves(figure: Figure, drawn: _Drawn) -> None:
    axes, (path,) = figure.subplots(), drawn.vary
    for k, (curve, of_curve) in enumerate(drawn.curves.items()):
        for j, criterion in enumerate(drawn.criteria):
            points = [row for row in of_curve if row["by"] == criterion and row.get(drawn.quantity) is not None]
            label = "  ".join(filter(None, (curve, criterion if len(drawn.criteria) > 1 else ""))) or criterion
            style: Entries = {"linestyle": DASHES[k % len(DASHES)], "linewidth": 1.8}
            if j > 0:  # marks on the line of the first criterion
                style = {"linestyle": "none", "marker": MARKS[(j - 1) % len(MARKS)], "fillstyle": "none"}
                style |= {"markersize": 7, "markevery": max(1, len(points) // 15)}
            x, y = [row[path] for row in points], [row[drawn.quantity] for row in points]
            axes.plot(x, y, color=COLOURS[k % len(COLOURS)], label=label, **style)
    _set_scale(axes, drawn.vary, path, "x")
    axes.set(xlabel=path, ylabel=WORDS[drawn.quantity])
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=9, loc="best", ncols=len(drawn.criteria))


def _draw_maps(figure: Figure, drawn: _Drawn) -> None:
    first, second = drawn.vary
    maps = list(drawn.curves.items())
    panels = figure.subplots(1, len(maps), sharey=True, squeeze=False)[0]
    grids = []
    for _, rows in maps:
        values = {(row[first], row[second]): row.get(drawn.quantity) for row in rows if row["by"] == drawn.criteria[0]}
        lines = [[values.get((across, up)) for across in drawn.vary[first]] for up in drawn.vary[second]]
        grids.append(np.array(lines, dtype=float))
    boundary = drawn.quantity != "courant_critical"
    high = 2.0 if boundary else float(np.max(grids, where=np.isfinite(grids), initial=0.0))
    levels = [1.0] if boundary else [level for level in np.linspace(0.1, 1.0, 10) if 0.0 < level < high]
    style: Entries = {"cmap": "RdBu_r" if boundary else "viridis", "vmin": 0.0, "vmax": high, "shading": "nearest"}
    x, y = list(drawn.vary[first]), list(drawn.vary[second])
    for axes, grid, (label, _) in zip(panels, grids, maps, strict=True):
        # Where no step is stable the ratio of the step to the critical one is infinite, which is drawn as a colour.
        shown = np.ma.masked_invalid(np.where(grid == np.inf, 10 * high, grid))
        mesh = axes.pcolormesh(x, y, shown, rasterized=True, **style)
        if min(grid.shape) > 1 and shown.count():
            contours = axes.contour(x, y, shown, levels=levels, colors=INK, linewidths=1.6 if boundary else 0.7)
            axes.clabel(contours, fmt="%.3g", fontsize=9)
        _set_scale(axes, drawn.vary, first, "x")
        axes.set_title(label, loc="left", size=11)
        axes.set_xlabel(first)
        axes.grid(visible=False)
    _set_scale(panels[0], drawn.vary, second, "y")
    panels[0].set_ylabel(second)
    figure.colorbar(mesh, ax=list(panels), extend="max" if boundary else "neither", label=WORDS[drawn.quantity])


def _set_scale(axes: Axes, vary: Axis, path: str, which: str) -> None:
    """Make an axis logarithmic where its values spread over a factor above 50."""
    values = vary[path]
    if all(isinstance(value, int | float) for value in values) and 0.0 < 50.0 * min(values) < max(values):
        log_axis(axes, which)


def waves_figure(waves: Waves, title: str, methods: str) -> Figure:
    """Return a figure of the reflection and transmission of waves by a closed contact over their frequency."""
    subject = f"contact '{waves.contact}' held closed; measured by the black box"
    with new_figure(9.6, 6.4, title, [methods, subject]) as figure:
        size, phase = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        x = waves.frequency
        size.plot(x, np.abs(waves.transmitted), color=COLOURS[0], linewidth=2.2, label="transmitted")
        size.plot(x, np.abs(waves.reflected), color=COLOURS[3], linestyle=DASHES[1], label="reflected")
        size.plot(x, waves.kept, color=COLOURS[2], linestyle=DASHES[3], label="energy that leaves again")
        phase.plot(x, np.angle(waves.transmitted), color=COLOURS[0], linewidth=2.2)
        if waves.formula is not None:
            thin = slice(None, None, max(1, x.size // 40))
            style: Entries = {"color": INK, "fillstyle": "none", "linestyle": "none", "marker": "o"}
            size.plot(x[thin], np.abs(waves.formula)[thin], markersize=5, label="transmitted, by formula", **style)
            phase.plot(x[thin], np.angle(waves.formula)[thin], markersize=5, **style)
        else:
            size.text(1, 1.01, waves.reason, transform=size.transAxes, ha="right", color=SOFT, fontsize=9)
        size.set(ylabel="over the arriving wave", xlim=(0, 2))
        size.set_ylim(bottom=0)
        size.legend(fontsize=9, loc="best")
        phase.set(xlabel="Ω = ωh/c", ylabel="phase of T")
    return figure
