"""Figure of a run or of an exact solution: contact forces, energies of a run, and stress in space and time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import QUANTITIES, with_unit
from percuss.jsonable import Entries
from percuss.reporting.deformed import deformed
from percuss.reporting.figures import (
    COLOURS,
    FAINT,
    FORCE,
    INK,
    MOST_PANELS,
    PAPER,
    SOFT,
    TIME,
    axis_end,
    drawing,
    fix_layout,
    hatch_after_stop,
    legend,
    new_figure,
    one_line,
    set_labels,
    subtitle_lines,
    thinned,
    warning_lines,
    write_reason,
)
from percuss.reporting.space_time import space_time
from percuss.results.ledger import ledger_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.results.result import Result


def figure_of(result: Result) -> Figure:
    """Return the figure of a run or of an exact solution: contact forces, energies of a run, stress in space and time.

    Where its attribute ``exact_histories`` is not None, a mapping of a contact's name to (times, forces), these exact
    forces are drawn over those of the run; else those of a finer run, ``finer_histories``.
    """
    until = axis_end(result)
    count, notes = _panel_count(result), contacts_left_out(result.coordinates["contact"])
    with new_figure(
        12.8,
        5.0 + 1.2 * (count + result.marched),
        result.title,
        [*subtitle_lines(result), *notes],
        warning_lines(result),
    ) as figure:
        widths, heights = (1.15, 1.0 if result.field_arrays else 0.4), [1.0] * count
        heights += [1.0 if count == 1 else 1.4] * result.marched
        grid = figure.add_gridspec(len(heights), 2, width_ratios=widths, height_ratios=heights)
        panels = [figure.add_subplot(grid[0, 0])]
        panels += [figure.add_subplot(grid[k, 0], sharex=panels[0]) for k in range(1, len(heights))]
        forces(panels[:count], result)
        if result.marched:
            _energies(panels[-1], result)
        set_labels(panels[-1], result.units, xlabel=TIME)
        panels[0].set_xlim(0, until)
        for k, axes in enumerate(panels):
            axes.tick_params(labelbottom=axes is panels[-1])
            hatch_after_stop(axes, result, until, word=k == 0)
        if "cell_nodes" in result.field_arrays:
            deformed(figure, grid[:, 1], result)
        else:
            space_time(figure.add_subplot(grid[:, 1]), result, until)
    return figure


def force_figure(result: Result, until: float) -> Figure:
    """Return the figure of the contact forces up to `until`, as a notebook shows it."""
    with drawing():
        from matplotlib.figure import Figure

        count = _panel_count(result)
        figure = Figure(figsize=(7.6, 1.6 + 1.4 * count), facecolor="white", layout="constrained")
        panels = list(figure.subplots(count, 1, sharex=True, squeeze=False).flat)
        forces(panels, result)
        label = with_unit(*TIME, result.units)
        panels[-1].set_xlabel("\n".join([label, *contacts_left_out(result.coordinates["contact"])]))
        panels[-1].set_xlim(0, until)
        for k, axes in enumerate(panels):
            hatch_after_stop(axes, result, until, word=k == 0)
        return fix_layout(figure)


def _panel_count(result: Result) -> int:
    return min(max(len(result.coordinates["contact"]), 1), MOST_PANELS)


def contacts_left_out(names: Sequence[str]) -> list[str]:
    """Return a note on the contacts that have no panel, or nothing."""
    return [f"the first {MOST_PANELS} of {len(names)} contacts are shown"] if len(names) > MOST_PANELS else []


def forces(panels: Sequence[Axes], result: Result) -> None:
    """Draw the force of each contact in a panel with the values that the case expects and the exact history."""
    names, time = result.coordinates["contact"], result.arrays["time"]
    if not names:
        write_reason(panels[0], "This case has no contact.")
        return
    label = "computed" if "resolved" in result.provenance else "exact"
    entries: Entries = {}
    for k, (axes, name) in enumerate(zip(panels, names, strict=False)):
        (entries[label],) = axes.plot(*thinned(time, result.arrays["contact_force"][:, k]), color=COLOURS[0])
        set_labels(axes, result.units, ylabel=FORCE)
        axes.set_title(one_line(name), loc="right", size=10)
        entries |= draw_references(axes, result, [name])
    legend(panels[0], entries, room=max(30, 74 - len(names[0])))


def draw_references(axes: Axes, result: Result, names: Sequence[str]) -> Entries:
    """Draw the exact histories and the expected values of contacts, and return their legend entries."""
    entries: Entries = {}
    exact, what = result.exact_histories or {}, "exact"
    if result.finer_histories:
        exact, what = result.finer_histories, "finer run (estimate)"
    for name in names:
        if name in exact:
            time, force = (np.asarray(part, dtype=float) for part in exact[name])
            covered = np.isfinite(force)
            # The last step ends after a finer run.
            whole = covered[:-1].all() or not covered.any()
            words = what if whole else f"{what}, up to {time[covered][-1]:.4g}"
            time, force = time[covered], force[covered]
            (entries[words],) = axes.plot(*thinned(time, force), color=INK, linewidth=1.0, dashes=(4, 2), zorder=3)
    marks = {"mean": "|", "max": "v", "min": "^"}
    # A result of an earlier version has no expected forces of its own.
    for expected in result.provenance.get("expected_forces", ()):
        statistic, value, allowed = (expected[key] for key in ("statistic", "value", "allowed"))
        if expected["contact"] not in names or statistic not in marks:
            continue
        interval = expected["during"] or (0.0, result.end)
        axes.fill_between(interval, value - allowed, value + allowed, color=INK, alpha=0.22, linewidth=0, zorder=2.5)
        line = axes.plot(interval, [value, value], color=INK, linewidth=0.9, marker=marks[statistic], zorder=3)
        entries[f"expected {statistic}"] = line[0]
    return entries


def _energies(axes: Axes, result: Result) -> None:
    """Draw the energies and works of a result, and write how well they agree."""
    arrays, heads = result.arrays, {name: quantity.head for name, quantity in QUANTITIES.items()}
    total = arrays["kinetic_energy"] + arrays["elastic_energy"]
    lines: dict[str, tuple[Any, str, Any, float]] = {
        heads["kinetic_energy"]: (arrays["kinetic_energy"], "#0072B2", "-", 1.5),
        heads["elastic_energy"]: (arrays["elastic_energy"], "#E69F00", "-", 1.5),
        "sum": (total, FAINT, "-", 4.0),
        f"sum − {heads['external_work']}": (total - arrays["external_work"], INK, (0, (4, 2)), 1.2),
        heads["contact_work"]: (arrays["contact_work"], "#D55E00", (0, (6, 1.5, 1.2, 1.5)), 1.5),
        heads["external_work"]: (arrays["external_work"], "#009E73", (0, (1.2, 1.2)), 1.8),
    }
    time = arrays["time_half"]
    handles = []
    for values, colour, dash, width in lines.values():
        line = axes.plot(*thinned(time, values), color=colour, linestyle=dash, linewidth=width)
        handles += line
    handles[2].set_zorder(1.9)
    axes.margins(y=0.18)  # The margin leaves the upper right corner free for the words.
    set_labels(axes, result.units, ylabel=(heads["energy"], "energy"))
    closure = ledger_words(result.summary["energy"])
    axes.text(0.99, 0.975, closure, transform=axes.transAxes, ha="right", va="top", size=9, color=SOFT, bbox=PAPER)
    legend(axes, dict(zip(lines, handles, strict=True)))
