"""Pictures of stability: critical Courant numbers as curves or maps, and waves at an interface."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.certificate.maps import STEP
from percuss.reporting.figures import COLOURS, DASHES, INK, SOFT, drawing, header, number, say, settle, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.certificate.waves import Waves

Axis = Mapping[str, Sequence[Any]]
MOST_MAPS = 4
MARKS = ("o", "s", "^", "D", "v", "P")
WORDS = {
    "courant_critical": "critical Courant number",
    "theta": "θ: the share of the overlap taken back; stable up to 1",
    "margin": "step over the critical step; stable up to 1",
}


def stability_figure(rows: list[dict[str, Any]], vary: Axis, curves: Axis, title: str, methods: str) -> Figure:
    """Return critical Courant numbers over one varied value as curves, over two as maps.

    Parameters
    ----------
    rows
        From `percuss.stability`.
    vary, curves
        What was varied; `vary` has one or two paths.
    title, methods
        What stands above.
    """
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.6, 6.4), facecolor="white", layout="constrained")
        about = "stability of the closed linear step, in the worst combination of contacts"
        header(figure, title, [methods, about, *_left_out(rows, vary, curves)], [])
        if not any(row["courant_critical"] is not None for row in rows):
            say(figure.subplots(), f"nothing to draw: {rows[0]['reason']}")
        elif len(vary) == 2:
            _maps(figure, rows, vary, curves)
        else:
            _curves(figure, rows, vary, curves)
        return settle(figure)


def _left_out(rows: list[dict[str, Any]], vary: Axis, curves: Axis) -> list[str]:
    """Return what the picture does not show: points without a number, with the most frequent reason, and panels."""
    quantity = _quantity(rows, vary)
    lost = [row for row in rows if row.get(quantity) is None]
    words = []
    if lost:
        reason, count = Counter(row["reason"] or "no reason given" for row in lost).most_common(1)[0]
        often = f" ({count} of them)" if count < len(lost) else ""
        words.append(f"{len(lost)} of {len(rows)} points have no number and are left blank: {reason}{often}")
    groups, ways = (
        list(dict.fromkeys(found)) for found in ((_group(r, curves) for r in rows), (r["by"] for r in rows))
    )
    if len(vary) == 2 and len(groups) > MOST_MAPS:
        words.append(f"the first {MOST_MAPS} of {len(groups)} curves have a map")
    if len(vary) == 2 and len(ways) > 1:
        words.append(f"the maps are those of the {ways[0]}; not drawn: {', '.join(ways[1:])}")
    return words


def _curves(figure: Figure, rows: list[dict[str, Any]], vary: Axis, curves: Axis) -> None:
    axes = figure.subplots()
    path = next(iter(vary))
    ways = list(dict.fromkeys(row["by"] for row in rows))
    groups = list(dict.fromkeys(_group(row, curves) for row in rows))
    quantity = _quantity(rows, vary)
    for k, group in enumerate(groups):
        colour = COLOURS[k % len(COLOURS)]
        for w, way in enumerate(ways):
            mine = [r for r in rows if r["by"] == way and _group(r, curves) == group and r.get(quantity) is not None]
            x, y = [_place(r[path]) for r in mine], [r[quantity] for r in mine]
            label = "  ".join(one for one in (group, way if len(ways) > 1 else "") if one)
            if w == 0:
                axes.plot(x, y, color=colour, linestyle=DASHES[k % len(DASHES)], linewidth=1.8, label=label or way)
                continue
            thin = slice(None, None, max(1, len(x) // 15))
            axes.plot(
                x[thin], y[thin], MARKS[(w - 1) % len(MARKS)], color=colour, fillstyle="none", markersize=7, label=label
            )
    _scale(axes, vary, path, "x")
    axes.set(xlabel=path, ylabel=WORDS[quantity])
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=9, loc="best", ncols=len(ways))


def _maps(figure: Figure, rows: list[dict[str, Any]], vary: Axis, curves: Axis) -> None:
    first, second = vary
    groups = list(dict.fromkeys(_group(row, curves) for row in rows))[:MOST_MAPS]
    way = rows[0]["by"]
    quantity = _quantity(rows, vary)
    panels = figure.subplots(1, len(groups), sharey=True, squeeze=False)[0]
    x, y = ([_place(v) for v in vary[path]] for path in (first, second))
    grids = []
    for group in groups:
        known = {(r[first], r[second]): r.get(quantity) for r in rows if r["by"] == way and _group(r, curves) == group}
        grids.append(np.array([[known.get((a, b)) for a in vary[first]] for b in vary[second]], dtype=float))
    boundary = quantity != "courant_critical"
    finite = np.concatenate([g[np.isfinite(g)] for g in grids])
    low, high = (0.0, 2.0) if boundary else (0.0, float(finite.max()))
    for axes, grid, group in zip(panels, grids, groups, strict=True):
        # where no step is stable the step is infinitely many times the critical one: that is a colour, and no blank
        shown = np.ma.masked_invalid(np.where(grid == np.inf, 10 * high, grid))
        drawn = axes.pcolormesh(
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
        _scale(axes, vary, first, "x")
        axes.set_title(group, loc="left", size=11, parse_math=False)
        axes.set_xlabel(first)
        axes.grid(visible=False)
    _scale(panels[0], vary, second, "y")
    panels[0].set_ylabel(second)
    figure.colorbar(drawn, ax=list(panels), extend="max" if boundary else "neither", label=WORDS[quantity])


def _quantity(rows: list[dict[str, Any]], vary: Axis) -> str:
    """Return what is drawn: where the step itself is varied, whether it is stable."""
    if not set(STEP) & set(vary):
        return "courant_critical"
    return "theta" if any(row.get("theta") is not None for row in rows) else "margin"


def _group(row: Mapping[str, Any], curves: Axis) -> str:
    return ", ".join(f"{path.rsplit('.', 1)[-1]} = {number(row[path])}" for path in curves)


def _place(value: Any) -> Any:
    return float(value) if isinstance(value, (int, float)) else str(value)


def _scale(axes: Axes, vary: Axis, path: str, which: str) -> None:
    """Make an axis logarithmic where its values are spread evenly so."""
    values = [v for v in vary[path] if isinstance(v, (int, float))]
    if len(values) > 2 and min(values) > 0 and len(values) == len(vary[path]):
        steps = np.diff(np.log(values))
        if np.ptp(steps) < 1e-6 * abs(steps).max() or max(values) > 50 * min(values):
            axes.set(**{f"{which}scale": "log"})
            getattr(axes, f"{which}axis").set_major_formatter("{x:g}")


def waves_figure(found: Waves, title: str, methods: str) -> Figure:
    """Return what a closed contact does to waves, over their frequency."""
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.6, 6.4), facecolor="white", layout="constrained")
        told = f"contact '{found.contact}' held closed; measured from the step itself"
        header(figure, title, [methods, told], [])
        size, phase = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        x = found.frequency
        size.plot(x, np.abs(found.transmitted), color=COLOURS[0], linewidth=2.2, label="transmitted")
        size.plot(x, np.abs(found.reflected), color=COLOURS[3], linestyle=DASHES[1], label="reflected")
        size.plot(x, found.kept, color=COLOURS[2], linestyle=DASHES[3], label="energy that leaves again")
        phase.plot(x, np.angle(found.transmitted), color=COLOURS[0], linewidth=2.2)
        if found.formula is not None:
            thin = slice(None, None, max(1, x.size // 40))
            style: dict[str, Any] = {"color": INK, "fillstyle": "none", "linestyle": "none", "marker": "o"}
            size.plot(x[thin], np.abs(found.formula)[thin], markersize=5, label="transmitted, by formula", **style)
            phase.plot(x[thin], np.angle(found.formula)[thin], markersize=5, **style)
        else:
            size.text(1, 1.01, found.reason, transform=size.transAxes, ha="right", color=SOFT, fontsize=9)
        size.set(ylabel="over the arriving wave", xlim=(0, 2))
        size.set_ylim(bottom=0)
        size.legend(fontsize=9, loc="best")
        phase.set(xlabel="Ω = ωh/c", ylabel="phase of T")
        return settle(figure)


def plot_stability(
    rows: list[dict[str, Any]], vary: Axis, curves: Axis, title: str, methods: str, path: str | os.PathLike[str]
) -> None:
    """Write `stability_figure` as png, svg or pdf by suffix; written beside and then renamed."""
    write(path, lambda: stability_figure(rows, vary, curves, title, methods))


def plot_waves(found: Waves, title: str, methods: str, path: str | os.PathLike[str]) -> None:
    """Write `waves_figure` as png, svg or pdf by suffix; written beside and then renamed."""
    write(path, lambda: waves_figure(found, title, methods))
