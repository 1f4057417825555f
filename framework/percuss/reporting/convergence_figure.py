"""Figure of the errors over mesh refinement for each pair of methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from percuss.case.quantities import QUANTITIES, TRUE_ERRORS
from percuss.jsonable import Data, Entries
from percuss.reporting.figures import SOFT, legend_below, new_figure, percent_axis, tick_text, write_reason
from percuss.reporting.study_charts import line_style
from percuss.reporting.study_figures import marked_line
from percuss.studies.perform import label_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def convergence_figure(fitted: list[Entries], title: str) -> Figure:
    """Return a figure of errors over mesh refinement on logarithmic axes, with a panel per error and a line per fit."""
    subject = "errors against the exact solution; the order is the slope of a line through all points"
    with new_figure(12.8, 9.0, title, [subject]) as figure:
        refinements = sorted({refine for fit in fitted for refine in fit["refine"]})
        styles = [marked_line(line_style(k)) for k in range(len(fitted))]
        panels = figure.subplots(2, 2, sharex=True)
        for axes, name in zip(panels.flat, TRUE_ERRORS, strict=True):
            _panel(axes, fitted, styles, name)
            axes.set_xscale("log")
            axes.set_xticks(refinements, [tick_text(refine) for refine in refinements])
            axes.minorticks_off()
        for axes in panels[-1]:
            axes.set_xlabel("refine: elements over those of the case")
        legend_below(figure, dict(zip(map(_label, fitted), panels[0, 0].lines, strict=False)))
    return figure


def _panel(axes: Axes, fitted: Sequence[Data], styles: Sequence[Data], name: str) -> None:
    """Draw one error of all fits, with the observed orders and a triangle of a slope near that of the best line."""
    axes.set_ylabel(QUANTITIES[name].label)
    drawn: list[float] = []
    best: tuple[list[tuple[float, float]], float | None] = ([], None)
    for fit, style in zip(fitted, styles, strict=True):
        errors = zip(fit["refine"], fit[name], strict=True)
        points = [(refine, error) for refine, error in errors if error is not None and error > 0]
        order = fit[f"{name}_order"]
        x, y = zip(*points, strict=True) if points else ((), ())
        axes.plot(x, y, markersize=4, label="–" if order is None else f"{order:.2f}", **style)
        drawn += y
        if points and (not best[0] or points[-1][1] < best[0][-1][1]):
            best = points, order
    if not drawn:
        write_reason(axes, "No run has this error.")
        return
    percent_axis(axes, min(drawn), max(drawn))
    axes.legend(title="order", title_fontsize=9, fontsize=9, loc="upper right", ncols=1 + (len(fitted) - 1) // 8)
    if best[1] is not None:
        _triangle(axes, best[0], best[1])


def _triangle(axes: Axes, points: Sequence[tuple[float, float]], order: float) -> None:
    """Draw a triangle below the best line, whose slope is its order rounded to a half."""
    slope = round(2 * order) / 2
    (first, _), (last, bottom) = points[0], points[-1]
    if slope <= 0 or last <= first:
        return
    left, right = (first * (last / first) ** share for share in (0.06, 0.32))
    top = bottom * (right / left) ** slope
    axes.fill([left, left, right], [top, bottom, bottom], facecolor="#eeeeee", edgecolor=SOFT, linewidth=1.0)
    for place, text, off, across, up in (
        ((left, (top * bottom) ** 0.5), f"{slope:g}", (-3, 0), "right", "center"),
        (((left * right) ** 0.5, bottom), "1", (0, -3), "center", "top"),
    ):
        axes.annotate(text, place, off, textcoords="offset points", ha=across, va=up, size=9, color=SOFT)


def _label(fit: Data) -> str:
    """Return the label of a line: the pair of methods, and other varied values."""
    return label_of(fit["integrator"], fit["contact"], {path: value for path, value in fit.items() if "." in path})
