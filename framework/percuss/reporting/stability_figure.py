"""Figures of stability: critical Courant numbers as curves or maps, and waves at an interface."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import QUANTITIES
from percuss.certificate.maps import STEP
from percuss.jsonable import Entries
from percuss.reporting.figures import (
    COLOURS,
    DASHES,
    INK,
    SOFT,
    log_axis,
    new_figure,
    number,
    write_reason,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.certificate.waves import Waves

Axis = Mapping[str, Sequence[Any]]
MOST_MAPS = 4
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
    with new_figure(9.6, 6.4, title, [methods, subject, *_notes_on_omissions(rows, vary, curves)]) as figure:
        if not any(row["courant_critical"] is not None for row in rows):
            write_reason(figure.subplots(), f"nothing to draw: {rows[0]['reason']}")
        elif len(vary) == 2:
            _draw_maps(figure, rows, vary, curves)
        else:
            _draw_curves(figure, rows, vary, curves)
    return figure


def _notes_on_omissions(rows: list[Entries], vary: Axis, curves: Axis) -> list[str]:
    """Return notes on parts that are not drawn: points without a number, curves without a map, and further criteria."""
    quantity = _quantity(rows, vary)
    without_number = [row for row in rows if row.get(quantity) is None]
    words = []
    if without_number:
        reason, count = Counter(row["reason"] or "no reason given" for row in without_number).most_common(1)[0]
        often = f" ({count} of them)" if count < len(without_number) else ""
        words.append(f"{len(without_number)} of {len(rows)} points have no number and are left blank: {reason}{often}")
    labels, criteria = list(_by_curve(rows, curves)), list(dict.fromkeys(row["by"] for row in rows))
    if len(vary) == 2 and len(labels) > MOST_MAPS:
        words.append(f"the first {MOST_MAPS} of {len(labels)} curves have a map")
    if len(vary) == 2 and len(criteria) > 1:
        words.append(f"the maps are those of the {criteria[0]}; not drawn: {', '.join(criteria[1:])}")
    return words


def _draw_curves(figure: Figure, rows: list[Entries], vary: Axis, curves: Axis) -> None:
    axes = figure.subplots()
    path = next(iter(vary))
    criteria = list(dict.fromkeys(row["by"] for row in rows))
    quantity = _quantity(rows, vary)
    for k, (curve, of_curve) in enumerate(_by_curve(rows, curves).items()):
        colour = COLOURS[k % len(COLOURS)]
        for j, criterion in enumerate(criteria):
            points = [point for point in of_curve if point["by"] == criterion and point.get(quantity) is not None]
            x, y = [_coordinate(point[path]) for point in points], [point[quantity] for point in points]
            label = "  ".join(part for part in (curve, criterion if len(criteria) > 1 else "") if part)
            if j == 0:
                axes.plot(
                    x, y, color=colour, linestyle=DASHES[k % len(DASHES)], linewidth=1.8, label=label or criterion
                )
                continue
            thin = slice(None, None, max(1, len(x) // 15))
            axes.plot(
                x[thin], y[thin], MARKS[(j - 1) % len(MARKS)], color=colour, fillstyle="none", markersize=7, label=label
            )
    _set_scale(axes, vary, path, "x")
    axes.set(xlabel=path, ylabel=WORDS[quantity])
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=9, loc="best", ncols=len(criteria))


def _draw_maps(figure: Figure, rows: list[Entries], vary: Axis, curves: Axis) -> None:
    first, second = vary
    drawn = dict(list(_by_curve(rows, curves).items())[:MOST_MAPS])
    quantity = _quantity(rows, vary)
    panels = figure.subplots(1, len(drawn), sharey=True, squeeze=False)[0]
    x, y = ([_coordinate(value) for value in vary[path]] for path in (first, second))
    grids = []
    for of_curve in drawn.values():
        value_at = {(row[first], row[second]): row.get(quantity) for row in of_curve if row["by"] == rows[0]["by"]}
        grids.append(
            np.array([[value_at.get((across, up)) for across in vary[first]] for up in vary[second]], dtype=float)
        )
    boundary = quantity != "courant_critical"
    finite = np.concatenate([grid[np.isfinite(grid)] for grid in grids])
    low, high = (0.0, 2.0) if boundary else (0.0, float(finite.max()))
    for axes, grid, curve in zip(panels, grids, drawn, strict=True):
        # Where no step is stable the ratio of the step to the critical one is infinite, which is drawn as a colour.
        shown = np.ma.masked_invalid(np.where(grid == np.inf, 10 * high, grid))
        mesh = axes.pcolormesh(
            x,
            y,
            shown,
            cmap="RdBu_r" if boundary else "viridis",
            vmin=low,
            vmax=high,
            shading="nearest",
            rasterized=True,
        )
        levels = [1.0] if boundary else [level for level in np.linspace(0.1, 1.0, 10) if low < level < high]
        if min(grid.shape) > 1 and shown.count():
            lines = axes.contour(x, y, shown, levels=levels, colors=INK, linewidths=1.6 if boundary else 0.7)
            axes.clabel(lines, fmt="%.3g", fontsize=9)
        _set_scale(axes, vary, first, "x")
        axes.set_title(curve, loc="left", size=11)
        axes.set_xlabel(first)
        axes.grid(visible=False)
    _set_scale(panels[0], vary, second, "y")
    panels[0].set_ylabel(second)
    figure.colorbar(mesh, ax=list(panels), extend="max" if boundary else "neither", label=WORDS[quantity])


def _quantity(rows: list[Entries], vary: Axis) -> str:
    """Return the key of the drawn quantity: the critical Courant number; theta or margin where the step is varied."""
    if not set(STEP) & set(vary):
        return "courant_critical"
    return "theta" if any(row.get("theta") is not None for row in rows) else "margin"


def _by_curve(rows: list[Entries], curves: Axis) -> dict[str, list[Entries]]:
    """Return the rows of each curve, by its label."""
    out: dict[str, list[Entries]] = {}
    for row in rows:
        label = ", ".join(f"{path.rsplit('.', 1)[-1]} = {number(row[path])}" for path in curves)
        out.setdefault(label, []).append(row)
    return out


def _coordinate(value: Any) -> Any:
    return float(value) if isinstance(value, (int, float)) else str(value)


def _set_scale(axes: Axes, vary: Axis, path: str, which: str) -> None:
    """Make an axis logarithmic where its values are in geometric progression or spread over a factor above 50."""
    values = [value for value in vary[path] if isinstance(value, (int, float))]
    if len(values) > 2 and min(values) > 0 and len(values) == len(vary[path]):
        steps = np.diff(np.log(values))
        if np.ptp(steps) < 1e-6 * abs(steps).max() or max(values) > 50 * min(values):
            log_axis(axes, which)


def waves_figure(waves: Waves, title: str, methods: str) -> Figure:
    """Return a figure of the reflection and transmission of waves by a closed contact over their frequency."""
    subject = f"contact '{waves.contact}' held closed; measured from the step itself"
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
