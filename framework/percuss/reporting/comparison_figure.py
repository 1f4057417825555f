"""Figures of several runs of one case: their contact forces, overlaid or in small panels; errors over refinement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from percuss.case.quantities import QUANTITIES, TRUE_ERRORS
from percuss.jsonable import Data, Entries
from percuss.reporting.figures import (
    ALARM,
    COLOURS,
    DASHES,
    FORCE,
    INK,
    MOST_PANELS,
    OVERLAY,
    SOFT,
    TIME,
    legend,
    legend_below,
    new_figure,
    number,
    one_line,
    percent_axis,
    set_labels,
    thinned,
    tick_text,
    wrapped,
    write_reason,
)
from percuss.reporting.run_figure import contacts_left_out, draw_references
from percuss.reporting.study_charts import MARKS, line_style
from percuss.studies.perform import label_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.results.result import Result


def comparison_figure(rows: Sequence[Data]) -> Figure:
    """Return a figure of the contact forces of several runs of one case, overlaid or, for more than six, in panels.

    Parameters
    ----------
    rows
        Mappings with ``label``, ``result`` (a Result or None) and, where there is no result, ``reason``.
    """
    runs = [(one_line(row["label"]), row["result"]) for row in rows if row.get("result") is not None]
    others = [row for row in rows if row.get("result") is None]
    lost = [f"not shown: {one_line(row['label'])}: {one_line(row.get('reason') or 'no result')}" for row in others]
    names = runs[0][1].coordinates["contact"] if runs else []
    apart = len(runs) > OVERLAY
    down = -(-len(runs) // 3) if apart else min(max(len(names), 1), MOST_PANELS)
    notes = [f"{FORCE[0]} of {f'{len(runs)} of ' if others else ''}{len(rows)} runs"]
    notes += contacts_left_out(names)
    height = max(4.6, 1.9 + 2.4 * down) + 0.2 * len(lost)
    with new_figure(12.8, height, runs[0][1].title if runs else "", notes, foot=lost) as figure:
        panels = figure.subplots(down, 3 if apart else 1, sharex=True, sharey=apart, squeeze=False).flat
        if not runs:
            write_reason(panels[0], "None of the runs has a result.")
        elif apart:
            legend_below(figure, _small_panels(list(panels), runs))
        else:
            entries: Entries = {}
            for axes, name in zip(panels, names or [""], strict=False):
                entries |= _overlay_runs(axes, runs, name, alone=len(names) < 2)
            if entries:
                legend(panels[0], entries, room=150)
                set_labels(panels[-1], runs[0][1].units, xlabel=TIME)
                panels[-1].set_xlim(0, _end_time(runs))
    return figure


def _run_label(label: str, result: Result) -> str:
    return label if result.status == "done" else f"{label}: {result.status} at {number(result.end)}"


def _overlay_runs(axes: Axes, runs: Sequence[tuple[str, Result]], name: str, *, alone: bool) -> Entries:
    """Draw the force of one contact in every run, and return the legend entries.

    Later runs have thinner lines, so that equal forces can be seen below each other.
    """
    entries: Entries = {}
    for k, (label, result) in enumerate(runs):
        if name not in result.coordinates["contact"]:
            continue
        force = result.arrays["contact_force"][:, result.coordinates["contact"].index(name)]
        line = axes.plot(*thinned(result.arrays["time"], force), color=COLOURS[k], linestyle=DASHES[k])
        line[0].set_linewidth(2.5 - 0.25 * k)
        words = _run_label(label, result)
        entries[words if words not in entries else f"{words} ({k + 1})"] = line[0]
        _mark_stop(axes, result)
    if not entries:
        write_reason(axes, "These runs have no contact.")
        return entries
    _limit_forces(axes, [result for _, result in runs])
    set_labels(axes, runs[0][1].units, ylabel=FORCE if alone else (f"force at {name}", "force"))
    return entries | draw_references(axes, _run_with_exact(runs), [name])


def _end_time(runs: Sequence[tuple[str, Result]]) -> float:
    return max(max(result.end, float(result.summary["dt"])) for _, result in runs)


def _run_with_exact(runs: Sequence[tuple[str, Result]]) -> Result:
    """Return the first run that has exact histories, or those of a finer run, or the first run if none has."""
    with_exact = [result for _, result in runs if result.exact_histories or result.finer_histories]
    return (with_exact or [runs[0][1]])[0]


def _limit_forces(axes: Axes, results: Sequence[Result]) -> None:
    """Limit the force axis to the forces of stable runs, so that an unstable run does not flatten the others."""
    stable = [result for result in results if result.status != "unstable" and result.coordinates["contact"]]
    if stable and len(stable) < len(results):
        forces = np.concatenate([result.arrays["contact_force"].ravel() for result in stable])
        room = 0.25 * (float(np.ptp(forces)) or 1.0)
        axes.set_ylim(float(forces.min()) - room, float(forces.max()) + room)


def _mark_stop(axes: Axes, result: Result) -> None:
    if result.status != "done":
        axes.axvline(result.end, color=ALARM, linewidth=1.0, linestyle=(0, (1, 2)))


def _small_panels(panels: Sequence[Axes], runs: Sequence[tuple[str, Result]]) -> Entries:
    """Draw a small panel for each run, with the other runs behind it in grey, and return the legend entries."""
    entries: Entries = {}
    for k, (axes, (label, result)) in enumerate(zip(panels, runs, strict=False)):
        for _, other in runs:
            for force in other.arrays["contact_force"].T[:MOST_PANELS]:
                axes.plot(*thinned(other.arrays["time"], force), color="#d9d9d9", linewidth=0.8, zorder=1)
        names = result.coordinates["contact"][:MOST_PANELS]
        styles = zip(names, result.arrays["contact_force"].T, COLOURS, DASHES, strict=False)
        for name, force, colour, dash in styles:
            line = axes.plot(*thinned(result.arrays["time"], force), color=colour, linestyle=dash, linewidth=1.3)
            entries |= {name: line[0]} if len(names) > 1 else {}
        entries |= draw_references(axes, _run_with_exact(runs), names)
        _mark_stop(axes, result)
        words = "\n".join(wrapped(_run_label(label, result), 44, 2))
        shade = INK if result.status == "done" else ALARM
        axes.set_title(words, loc="left", size=10, color=shade)
        if k % 3 == 0:
            set_labels(axes, result.units, ylabel=FORCE)
        if k + 3 >= len(runs):
            set_labels(axes, result.units, xlabel=TIME)
            axes.tick_params(labelbottom=True)
    for axes in panels[len(runs) :]:
        axes.set_axis_off()
    panels[0].set_xlim(0, _end_time(runs))
    _limit_forces(panels[0], [result for _, result in runs])
    return entries


# ------------------------------------------------------------------------------------- errors over refinement


def convergence_figure(fitted: list[Entries], title: str, judge: str = "the exact solution") -> Figure:
    """Return a figure of errors over mesh refinement on logarithmic axes, with a panel per error and a line per fit."""
    subject = f"errors against {judge}; the order is the slope of a line through all points"
    with new_figure(12.8, 9.0, title, [subject]) as figure:
        refinements = sorted({refine for fit in fitted for refine in fit["refine"]})
        styles = [_marked_line(k) for k in range(len(fitted))]
        panels = figure.subplots(2, 2, sharex=True)
        for axes, name in zip(panels.flat, TRUE_ERRORS, strict=True):
            _error_panel(axes, fitted, styles, name)
            axes.set_xscale("log")
            axes.set_xticks(refinements, [tick_text(refine) for refine in refinements])
            axes.minorticks_off()
        for axes in panels[-1]:
            axes.set_xlabel("refine: elements over those of the case")
        legend_below(figure, dict(zip(map(_fit_label, fitted), panels[0, 0].lines, strict=False)))
    return figure


def _error_panel(axes: Axes, fitted: Sequence[Data], styles: Sequence[Data], name: str) -> None:
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


def _fit_label(fit: Data) -> str:
    """Return the label of a line: the pair of methods, and other varied values."""
    return label_of(fit["integrator"], fit["contact"], {path: value for path, value in fit.items() if "." in path})


def _marked_line(k: int) -> Entries:
    """Return matplotlib's options for the k-th line, with marks."""
    style = line_style(k)
    mark = dict(zip(MARKS, "os^DPv><", strict=True))[style.mark]
    return {"color": style.colour, "linestyle": (0, style.dash) if style.dash else "-", "marker": mark}
