"""Figures of several runs of one case: their contact forces, overlaid or in small panels; errors over refinement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from percuss.case.quantities import QUANTITIES, TRUE_ERRORS
from percuss.jsonable import Data, Entries
from percuss.reporting import figures
from percuss.reporting.figures import ALARM, COLOURS, DASHES, INK, MOST_PANELS, SOFT, one_line
from percuss.reporting.run_figure import contacts_left_out, draw_references
from percuss.reporting.study_charts import MARKS, line_style
from percuss.studies.perform import label_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.methods.interfaces import Floats
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
    lost = [f"not shown: {row['label']}: {row.get('reason') or 'no result'}" for row in others]
    names = runs[0][1].coordinates["contact"] if runs else []
    apart = len(runs) > figures.OVERLAY
    down = -(-len(runs) // 3) if apart else min(max(len(names), 1), MOST_PANELS)
    notes = [f"{figures.FORCE[0]} of {f'{len(runs)} of ' if others else ''}{len(rows)} runs", *contacts_left_out(names)]
    notes += [line for words in lost for line in figures.wrapped(words, 150, 1)]
    height, title = max(4.6, 1.9 + 2.4 * down) + 0.2 * len(lost), runs[0][1].title if runs else ""
    with figures.new_figure(12.8, height, title, notes) as figure:
        panels = list(figure.subplots(down, 3 if apart else 1, sharex=True, sharey=apart, squeeze=False).flat)
        if not runs:
            figures.write_reason(panels[0], "None of the runs has a result.")
            return figure
        entries: Entries = {}
        if apart:
            for axes, (label, result) in zip(panels, runs, strict=False):
                entries |= _small_panel(axes, runs, label, result)
            for axes in panels[len(runs) :]:
                axes.set_axis_off()
            figures.legend_below(figure, entries)
        else:
            for axes, name in zip(panels, names or [""], strict=False):
                entries |= _overlay_runs(axes, runs, name, alone=len(names) < 2)
            if entries:
                figures.legend(panels[0], entries, room=170)
        for axes in panels[::3] if apart else ():
            figures.set_labels(axes, runs[0][1].units, ylabel=figures.FORCE)
        for axes in (panels[max(0, len(runs) - 3) : len(runs)] if apart else panels[-1:]) if names else ():
            figures.set_labels(axes, runs[0][1].units, xlabel=figures.TIME)
            axes.tick_params(labelbottom=True)
        panels[0].set_xlim(0, max(max(result.end, float(result.summary["dt"])) for _, result in runs))
    return figure


def _run_label(label: str, result: Result) -> str:
    return label if result.status == "done" else f"{label}: {result.status} at {figures.number(result.end)}"


def _overlay_runs(axes: Axes, runs: Sequence[tuple[str, Result]], name: str, *, alone: bool) -> Entries:
    """Draw the force of one contact in every run, and return the entries of the legend.

    Later runs have thinner lines, so that equal forces can be seen below each other.
    """
    entries: Entries = {}
    for k, (label, result) in enumerate(runs):
        if name not in result.coordinates["contact"]:
            continue
        force = result.arrays["contact_force"][:, result.coordinates["contact"].index(name)]
        style: Entries = {"color": COLOURS[k], "linestyle": DASHES[k], "linewidth": 2.5 - 0.25 * k}
        words = _run_label(label, result)
        words = words if words not in entries else f"{words} ({k + 1})"
        entries[words] = figures.draw_line(axes, result.arrays["time"], force, **style)
        _mark_stop(axes, result)
    if not entries:
        figures.write_reason(axes, "These runs have no contact.")
        return entries
    _limit_forces(axes, runs)
    figures.set_labels(axes, runs[0][1].units, ylabel=figures.FORCE if alone else (f"force at {name}", "force"))
    return entries | draw_references(axes, _run_with_exact(runs), [name])


def _run_with_exact(runs: Sequence[tuple[str, Result]]) -> Result:
    """Return the first run that has exact histories, or those of a finer run, or the first run if none has."""
    with_exact = [result for _, result in runs if result.exact_histories or result.finer_histories]
    return (with_exact or [runs[0][1]])[0]


def _limit_forces(axes: Axes, runs: Sequence[tuple[str, Result]]) -> None:
    """Limit the force axis to the forces of stable runs, so that an unstable run does not flatten the others."""
    stable = [result for _, result in runs if result.status != "unstable" and result.coordinates["contact"]]
    if stable and len(stable) < len(runs):
        forces = np.concatenate([result.arrays["contact_force"].ravel() for result in stable])
        room = 0.25 * (float(np.ptp(forces)) or 1.0)
        axes.set_ylim(float(forces.min()) - room, float(forces.max()) + room)


def _mark_stop(axes: Axes, result: Result) -> None:
    if result.status != "done":
        axes.axvline(result.end, color=ALARM, linewidth=1.0, linestyle=(0, (1, 2)))


def _small_panel(axes: Axes, runs: Sequence[tuple[str, Result]], label: str, result: Result) -> Entries:
    """Draw the forces of one run before those of all runs in grey, and return the entries of the legend."""
    for _, other in runs:
        for force in other.arrays["contact_force"].T[:MOST_PANELS]:
            figures.draw_line(axes, other.arrays["time"], force, color="#d9d9d9", linewidth=0.8, zorder=1)
    names, entries = result.coordinates["contact"][:MOST_PANELS], Entries()
    for name, force, colour, dash in zip(names, result.arrays["contact_force"].T, COLOURS, DASHES, strict=False):
        line = figures.draw_line(axes, result.arrays["time"], force, color=colour, linestyle=dash, linewidth=1.3)
        entries |= {name: line} if len(names) > 1 else {}
    _mark_stop(axes, result)
    _limit_forces(axes, runs)
    words = "\n".join(figures.wrapped(_run_label(label, result), 44, 2))
    axes.set_title(words, loc="left", size=10, color=INK if result.status == "done" else ALARM)
    return entries | draw_references(axes, _run_with_exact(runs), names)


# ------------------------------------------------------------------------------------- errors over refinement


def convergence_figure(fitted: list[Entries], title: str, judge: str = "the exact solution") -> Figure:
    """Return a figure of errors over mesh refinement on logarithmic axes, with a panel per error and a line per fit."""
    subject = f"errors against {judge}; the order is the slope of a line through all points"
    with figures.new_figure(12.8, 9.0, title, [subject]) as figure:
        refinements = sorted({refine for fit in fitted for refine in fit["refine"]})
        styles = [_marked_line(k) for k in range(len(fitted))]
        panels = figure.subplots(2, 2, sharex=True)
        for axes, name in zip(panels.flat, TRUE_ERRORS, strict=True):
            _error_panel(axes, fitted, styles, name)
            axes.set_xscale("log")
            axes.set_xticks(refinements, [figures.tick_text(refine) for refine in refinements])
            axes.set_xticks([], minor=True)
        for axes in panels[-1]:
            axes.set_xlabel("refine: elements over those of the case")
        figures.legend_below(figure, dict(zip(map(_fit_label, fitted), panels[0, 0].lines, strict=False)))
    return figure


def _error_panel(axes: Axes, fitted: Sequence[Data], styles: Sequence[Data], name: str) -> None:
    """Draw one error of all fits, with the observed orders and the slope of the best line, rounded to a half."""
    axes.set_ylabel(QUANTITIES[name].label)
    best: tuple[float, Floats, float] = (np.inf, np.zeros((2, 0)), 0.0)
    for fit, style in zip(fitted, styles, strict=True):
        refine, error = np.array(fit["refine"], dtype=float), np.array(fit[name], dtype=float)
        points, order = np.stack([refine, error])[:, error > 0.0], fit[f"{name}_order"]
        axes.plot(*points, markersize=4, label="–" if order is None else f"{order:.2f}", **style)
        if points.size and points[1, -1] < best[0]:
            best = float(points[1, -1]), points, round(2.0 * (order or 0.0)) / 2.0
    last, (x, _), slope = best
    if not np.isfinite(last):
        figures.write_reason(axes, "No run has this error.")
        return
    if slope > 0.0:
        ends = x[0] * (x[-1] / x[0]) ** np.array([0.05, 0.4])
        style = {"color": SOFT, "linewidth": 1.5, "linestyle": ":", "label": f"slope {slope:g}"}
        axes.plot(ends, 0.8 * last * (ends[-1] / ends) ** slope, **style)
    drawn = np.concatenate([line.get_ydata() for line in axes.lines])
    figures.percent_axis(axes, drawn.min(), drawn.max())
    axes.legend(title="order", title_fontsize=9, fontsize=9, loc="best", ncols=1 + (len(fitted) - 1) // 8)


def _fit_label(fit: Data) -> str:
    """Return the label of a line: the pair of methods, and other varied values."""
    return label_of(fit["integrator"], fit["contact"], {path: value for path, value in fit.items() if "." in path})


def _marked_line(k: int) -> Entries:
    """Return matplotlib's options for the k-th line, with marks."""
    style = line_style(k)
    mark = dict(zip(MARKS, "os^DPv><", strict=True))[style.mark]
    return {"color": style.colour, "linestyle": (0, style.dash) if style.dash else "-", "marker": mark}
