"""Figure of a run: contact forces, energies, and stress in space and time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import QUANTITIES
from percuss.reporting.figures import (
    COLOURS,
    DASHES,
    FAINT,
    INK,
    OVERLAY,
    PAPER,
    SOFT,
    axis_end,
    drawing,
    fix_layout,
    hatch_after_stop,
    header,
    legend,
    number,
    one_line,
    powers,
    stopped_at,
    subtitle_lines,
    thinned,
    warning_lines,
    write,
    write_reason,
)
from percuss.reporting.space_time import space_time
from percuss.results.ledger import ledger_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.reporting.figures import Drawn
    from percuss.results.result import Result


def plot_result(result: Result, path: str | os.PathLike[str]) -> None:
    """Write the figure of a run: contact forces, energy ledger, stress in space and time.

    Parameters
    ----------
    result
        The run. Where its attribute ``exact_histories`` is not None, a mapping of a contact's name to
        (times, forces), these exact forces are drawn over those of the run.
    path
        File ending in .png, .svg or .pdf, which is written completely or not at all. Errors are those of
        `check_suffix`.
    """
    write(path, lambda: figure_of(result))


def figure_of(result: Result) -> Figure:
    """Return the figure of a run without a window: contact forces, energies and stress."""
    energy = result.summary["energy"]
    closure = ledger_words(energy, number(energy["ledger_error"]))
    return history_figure(result, axis_end(result), subtitle_lines(result), warning_lines(result), closure)


def history_figure(result: Drawn, until: float, small: Sequence[str], loud: Sequence[str], closure: str) -> Figure:
    """Return a figure of contact forces, energies and stress in space and time.

    Parameters
    ----------
    result
        The result of a run, or an exact solution.
    until
        End of the time axis.
    small, loud
        Small lines and warnings below the title.
    closure
        How well the energies agree with the work, in words.
    """
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12.8, 7.4), facecolor="white")
        header(figure, result.title, small, loud)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0 if result.field_arrays else 0.4))
        force = figure.add_subplot(grid[0, 0])
        energy = figure.add_subplot(grid[1, 0])
        forces(force, result)
        force.set_xlabel("")
        _energies(energy, result, closure)
        for axes, word in ((force, True), (energy, False)):
            axes.set_xlim(0, until)
            hatch_after_stop(axes, result, until, word=word)
        space_time(figure.add_subplot(grid[:, 1]), result, until)
        return fix_layout(figure)


def force_figure(result: Drawn, until: float) -> Figure:
    """Return the figure of the contact forces up to `until`, as a notebook shows it."""
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7.6, 3.0), facecolor="white", layout="constrained")
        axes = figure.add_subplot()
        forces(axes, result)
        axes.set_xlim(0, until)
        hatch_after_stop(axes, result, until)
        return fix_layout(figure)


def forces(axes: Axes, result: Drawn) -> None:
    """Draw the force of every contact with the values that the case expects and the exact histories."""
    names, time = result.coordinates["contact"], result.arrays["time"]
    axes.set(xlabel="time", ylabel=QUANTITIES["contact_force"].label)
    if not names:
        write_reason(axes, "This case has no contact.")
        return
    handles = {}
    for k, (name, colour) in enumerate(zip(names, colours(len(names)), strict=True)):
        dash = DASHES[k] if len(names) <= OVERLAY else "-"
        force = result.arrays["contact_force"][:, k]
        (handles[name],) = axes.plot(*thinned(time, force), color=colour, linestyle=dash)
    if len(names) > OVERLAY:
        _contact_scale(axes, names)
        handles = {}
    powers(axes)
    handles |= draw_references(axes, result, names)
    if handles:
        legend(axes, handles)


def colours(count: int) -> list[Any]:
    """Return a colour for each of `count` lines: distinct colours for a few lines, a colour scale for many."""
    if count <= OVERLAY:
        return list(COLOURS[:count])
    import matplotlib as mpl

    # The light end of the scale would not be visible on white paper.
    return list(mpl.colormaps["viridis"](np.linspace(0.0, 0.9, count)))


def _contact_scale(axes: Axes, names: Sequence[str]) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap

    count = len(names)
    scale = ScalarMappable(BoundaryNorm(np.arange(count + 1) - 0.5, count), ListedColormap(colours(count)))
    shown = range(0, count, -(-count // 12))
    bar = axes.figure.colorbar(scale, ax=axes, ticks=list(shown), pad=0.01, aspect=30, label="contact")
    bar.ax.minorticks_off()
    bar.ax.set_yticklabels([one_line(names[k])[:24] for k in shown], parse_math=False, size=9)


def draw_references(axes: Axes, result: Drawn, names: Sequence[str]) -> dict[str, Any]:
    """Draw the exact histories and the expected values of contacts, and return their legend entries."""
    entries: dict[str, Any] = {}
    exact = getattr(result, "exact_histories", None) or {}
    for name in names:
        if name in exact:
            time, force = (np.asarray(part, dtype=float) for part in exact[name])
            covered = np.isfinite(force)
            words = "exact" if covered.all() or not covered.any() else f"exact, up to {time[covered][-1]:.4g}"
            time, force = time[covered], force[covered]
            (entries[words],) = axes.plot(*thinned(time, force), color=INK, linewidth=1.0, dashes=(4, 2), zorder=3)
    marks = {"mean": "|", "max": "v", "min": "^"}
    # A result of an earlier version has no expected forces of its own.
    for expected in result.provenance.get("expected_forces", ()):
        statistic, value, allowed = (expected[key] for key in ("statistic", "value", "allowed"))
        if expected["contact"] not in names or statistic not in marks:
            continue
        interval = expected["during"] or (0.0, stopped_at(result))
        axes.fill_between(interval, value - allowed, value + allowed, color=INK, alpha=0.22, linewidth=0, zorder=2.5)
        line = axes.plot(interval, [value, value], color=INK, linewidth=0.9, marker=marks[statistic], zorder=3)
        entries[f"expected {statistic}"] = line[0]
    return entries


def _energies(axes: Axes, result: Drawn, closure: str) -> None:
    """Draw the energies and works of a result, and write how well they agree."""
    arrays, heads = result.arrays, {name: quantity.head for name, quantity in QUANTITIES.items()}
    total = arrays["kinetic_energy"] + arrays["elastic_energy"]
    lines: dict[str, tuple[Any, str, Any, float]] = {
        heads["kinetic_energy"]: (arrays["kinetic_energy"], "#0072B2", "-", 1.5),
        heads["elastic_energy"]: (arrays["elastic_energy"], "#E69F00", "-", 1.5),
        "sum": (total, FAINT, "-", 4.0),
        f"sum − {heads['external_work']}": (total - arrays["external_work"], INK, (0, (4, 2)), 1.2),
        heads["contact_work"]: (arrays.get("contact_work"), "#D55E00", (0, (6, 1.5, 1.2, 1.5)), 1.5),
        heads["external_work"]: (arrays["external_work"], "#009E73", (0, (1.2, 1.2)), 1.8),
    }
    lines = {label: line for label, line in lines.items() if line[0] is not None}  # exact contact does no work
    time = arrays.get("time_half", arrays["time"])
    handles = []
    for values, colour, dash, width in lines.values():
        line = axes.plot(*thinned(time, values), color=colour, linestyle=dash, linewidth=width)
        handles += line
    handles[2].set_zorder(1.9)
    axes.margins(y=0.18)  # The margin leaves the upper right corner free for the words.
    axes.set(xlabel="time", ylabel=heads["energy"])
    powers(axes)
    axes.text(0.99, 0.975, closure, transform=axes.transAxes, ha="right", va="top", size=9, color=SOFT, bbox=PAPER)
    legend(axes, dict(zip(lines, handles, strict=True)))
