"""Figure of a run or of an exact solution: contact forces, energies of a run, and stress in space and time."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.case.quantities import QUANTITIES, with_unit
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import Array, Floats, Integers
from percuss.reporting import figures
from percuss.reporting.figures import COLOURS, INK, MOST_PANELS
from percuss.reporting.solids import deformed
from percuss.results.ledger import ledger_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.results.result import Result


def plotted(result: Result, path: str | os.PathLike[str] | None = None) -> Figure:
    """Return the figure of a result, which a notebook shows; write it to `path` if that is given."""
    if path is not None:
        figures.check_suffix(path)
    figure = figure_of(result)
    vars(figure)["_repr_png_"] = partial(figures.picture, figure, "png")
    if path is not None:
        figures.write(path, figure)
    return figure


def figure_of(result: Result) -> Figure:
    """Return the figure of a run or of an exact solution: contact forces, energies of a run, stress in space and time.

    Where its attribute ``exact_histories`` is not None, a mapping of a contact's name to (times, forces), these exact
    forces are drawn over those of the run; else those of a finer run, ``finer_histories``.
    """
    until = figures.axis_end(result)
    names = result.coordinates["contact"]
    count = min(max(len(names), 1), MOST_PANELS)
    small, loud = [*figures.subtitle_lines(result), *contacts_left_out(names)], figures.warning_lines(result)
    with figures.new_figure(12.8, 5.0 + 1.2 * (count + result.marched), result.title, small, loud) as figure:
        widths, heights = (1.15, 1.0 if result.field_arrays else 0.4), [1.0] * count
        heights += [1.0 if count == 1 else 1.4] * result.marched
        grid = figure.add_gridspec(len(heights), 2, width_ratios=widths, height_ratios=heights)
        panels = [figure.add_subplot(grid[0, 0])]
        panels += [figure.add_subplot(grid[k, 0], sharex=panels[0]) for k in range(1, len(heights))]
        forces(panels[:count], result)
        if result.marched:
            _energies(panels[-1], result)
        figures.set_labels(panels[-1], result.units, xlabel=figures.TIME)
        panels[0].set_xlim(0, until)
        for axes in panels:
            axes.tick_params(labelbottom=axes is panels[-1])
            figures.hatch_after_stop(axes, result, until)
        if "cell_nodes" in result.field_arrays:
            deformed(figure, grid[:, 1], result)
        else:
            space_time(figure.add_subplot(grid[:, 1]), result, until)
    return figure


def contacts_left_out(names: Sequence[str]) -> list[str]:
    """Return a note on the contacts that have no panel, or nothing."""
    return [f"the first {MOST_PANELS} of {len(names)} contacts are shown"] if len(names) > MOST_PANELS else []


def forces(panels: Sequence[Axes], result: Result) -> None:
    """Draw the force of each contact in a panel with the values that the case expects and the exact history."""
    names, time = result.coordinates["contact"], result.arrays["time"]
    if not names:
        figures.write_reason(panels[0], "This case has no contact.")
        return
    label = "computed" if "resolved" in result.provenance else "exact"
    entries: Entries = {}
    for k, (axes, name) in enumerate(zip(panels, names, strict=False)):
        entries[label] = figures.draw_line(axes, time, result.arrays["contact_force"][:, k], color=COLOURS[0])
        figures.set_labels(axes, result.units, ylabel=figures.FORCE)
        axes.set_title(figures.one_line(name), loc="right", size=10)
        entries |= draw_references(axes, result, [name])
    figures.legend(panels[0], entries, room=max(30, 76 - len(names[0])))


def draw_references(axes: Axes, result: Result, names: Sequence[str]) -> Entries:
    """Draw the exact histories and the expected values of contacts, and return the entries of the legend."""
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
            style: Entries = {"color": INK, "linewidth": 1.0, "dashes": (4, 2), "zorder": 3}
            entries[words] = figures.draw_line(axes, time[covered], force[covered], **style)
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
    work = arrays["external_work"]
    lines: list[tuple[str, Floats, str, Any, float]] = [
        (heads["kinetic_energy"], arrays["kinetic_energy"], "#0072B2", "-", 1.5),
        (heads["elastic_energy"], arrays["elastic_energy"], "#E69F00", "-", 1.5),
        ("sum", total, figures.FAINT, "-", 4.0),
        (f"sum − {heads['external_work']}", total - work, INK, (0, (4, 2)), 1.2),
        (heads["contact_work"], arrays["contact_work"], "#D55E00", (0, (6, 1.5, 1.2, 1.5)), 1.5),
        (heads["external_work"], work, "#009E73", (0, (1.2, 1.2)), 1.8),
    ]
    if "friction_work" in arrays:
        friction = arrays["friction_work"].sum(axis=1)
        lines.append((heads["friction_work"], friction, "#CC79A7", (0, (3, 1.2)), 1.5))
    if "damped_energy" in arrays:
        lines.append((heads["damped_energy"], arrays["damped_energy"], "#56B4E9", (0, (5, 1, 1, 1)), 1.5))
    entries: Entries = {}
    for label, values, colour, dash, width in lines:
        style: Entries = {"color": colour, "linestyle": dash, "linewidth": width, "zorder": 1.9 if width > 2 else 2}
        entries[label] = figures.draw_line(axes, arrays["time_half"], values, **style)
    axes.margins(y=0.18)  # The margin leaves the upper right corner free for the words.
    figures.set_labels(axes, result.units, ylabel=(heads["energy"], "energy"))
    place: Entries = {"ha": "right", "va": "top", "size": 9, "color": figures.SOFT, "bbox": figures.PAPER}
    axes.text(0.99, 0.975, ledger_words(result.summary["energy"]), transform=axes.transAxes, **place)
    figures.legend(axes, entries)


# --------------------------------------------------------------------------- stress in space and time


class _Strip(NamedTuple):
    """A body in the space-time picture.

    Attributes
    ----------
    columns
        Column numbers of the body's elements in the recorded stress field.
    edges
        Positions of the element boundaries on the picture's axis, (elements + 1,).
    ends
        Start and end of the body in space, (2, dim).
    """

    columns: Integers
    edges: Floats
    ends: Floats


def strips_of(fields: Data, ends: Data) -> tuple[dict[str, _Strip], str]:
    """Return the strip of each body on one common axis, and the label of that axis.

    Bodies on one straight line keep their positions along it. Others are laid one after another by their lengths.
    `ends` has the first and the last node of each body.
    """
    owner, position = np.array(fields["body"], dtype=object), np.asarray(fields["position"], dtype=float)
    edges, columns = {}, {}
    for name in dict.fromkeys(owner):
        columns[name] = np.flatnonzero(owner == name)
        edges[name] = _edges(position[columns[name]], np.asarray(ends[name], dtype=float))
    first, *_ = edges.values()
    in_space = position.shape[1] > 1
    direction = (first[-1] - first[0]) / np.linalg.norm(first[-1] - first[0]) if in_space else np.ones(1)
    origin = first[0] if in_space else np.zeros(1)
    offset = np.concatenate(list(edges.values())) - origin
    if np.abs(offset - np.outer(offset @ direction, direction)).max() <= 1e-6 * np.abs(offset).max():
        placed = {name: (points - origin) @ direction for name, points in edges.items()}
        label = f"distance along the line of '{next(iter(edges))}'" if in_space else "position"
    else:
        label = "length along each body, one after another"
        placed, start = {}, 0.0
        for name, points in edges.items():
            steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
            placed[name] = start + np.concatenate([[0.0], np.cumsum(steps)])
            start = placed[name][-1] + 0.06 * np.linalg.norm(first[-1] - first[0])
    return {name: _Strip(columns[name], placed[name], edges[name][[0, -1]]) for name in edges}, label


def _edges(middle: Floats, ends: Floats) -> Floats:
    """Return the boundaries of a body's elements in space, half-way between their midpoints: (elements + 1, dim)."""
    return np.stack([ends[0], *(0.5 * (middle[1:] + middle[:-1])), ends[1]])


def space_time(axes: Axes, result: Result, until: float) -> None:
    """Draw the stress of each body over position and time up to `until`, and each contact as a line while closed."""
    fields = result.field_arrays
    if not fields or not np.size(fields["stress"]):
        figures.write_reason(
            axes, "No stress over space\nand time was recorded.\nAsk for it with\n\nrecord: {fields: 200}"
        )
        return
    if "geometry" not in result.provenance:
        figures.write_reason(
            axes, "This result was saved by an earlier version,\nwhich did not keep the places of the bodies."
        )
        return
    strips, label = strips_of(fields, result.provenance["geometry"]["bodies"])
    time, stress = np.asarray(fields["time"], dtype=float), np.asarray(fields["stress"], dtype=float)
    limit, extend = figures.colour_limit(stress)
    step = time[1] - time[0] if time.size > 1 else result.summary.get("dt") or until
    rows = np.concatenate([time - 0.5 * step, [time[-1] + 0.5 * step]]).clip(0, max(result.end, step))
    style: Entries = {"cmap": "RdBu_r", "vmin": -limit, "vmax": limit, "rasterized": True}
    for strip in strips.values():
        mesh = axes.pcolormesh(strip.edges, rows, np.ma.masked_invalid(stress[:, strip.columns]), **style)
        axes.vlines(strip.edges[[0, -1]], 0, rows[-1], colors="#8a8a8a", linewidth=0.6, zorder=2.5)
    _contact_lines(axes, result, strips, up=body_names(axes, strips))
    figures.set_labels(axes, result.units, xlabel=(label, "length"), ylabel=figures.TIME)
    axes.set_ylim(0, until)
    axes.grid(visible=False)
    figures.hatch_after_stop(axes, result, until, upwards=True)
    bar = axes.figure.colorbar(mesh, ax=axes, aspect=45, pad=0.015, extend=extend)
    middle = with_unit(*figures.STRESS, result.units)
    bar.ax.set_ylabel(f"compression  ←  {middle}  →  tension")


def body_names(axes: Axes, strips: Mapping[str, _Strip]) -> float:
    """Write the names of the bodies above their strips, and return the upper edge of the names in axes coordinates.

    The names are turned upright where a strip is too narrow for its name; at most 30 of them are written.
    """
    whole = np.concatenate([strip.edges for strip in strips.values()])
    low, high = float(whole.min()), float(whole.max())
    axes.set_xlim(low - 0.012 * (high - low), high + 0.012 * (high - low))
    upright = any(0.018 * len(name) * (high - low) > np.ptp(strip.edges) for name, strip in strips.items())
    frame, turn = axes.get_xaxis_transform(), 90 if upright else 0
    longest = 0
    for name in list(strips)[:: -(-len(strips) // 30)]:
        words = name if len(name) <= 16 or not upright else f"{name[:15]}…"
        anchor = (float(strips[name].edges[[0, -1]].mean()), 1.01)
        style: Entries = {"rotation": turn, "size": 9, "ha": "center", "va": "bottom"}
        axes.text(*anchor, words, transform=frame, **style)
        longest = max(longest, len(words))
    return 1.02 + 0.0155 * longest if upright else 1.045


def _contact_lines(axes: Axes, result: Result, strips: Mapping[str, _Strip], up: float) -> None:
    """Mark the times at which each contact is closed, with a thicker line while it carries force.

    A white outline keeps both lines visible on the colours of the stress.
    """
    from matplotlib.patheffects import withStroke

    contacts = result.provenance["geometry"]["contacts"]
    time, drawn = result.arrays["time"], Entries()
    size = float(np.ptp(np.concatenate([strip.edges for strip in strips.values()])))
    for k, name in enumerate(result.coordinates["contact"]):
        pressed = result.arrays["contact_force"][:, k] > 0
        closed = (result.arrays["gap"][:, k] <= 1e-9 * size) | pressed
        for words, mask, width in (("contact closed", closed, 1.4), ("with force", pressed, 3.4)):
            start, stop = _intervals(mask, time)
            for place in contact_positions(contacts[name], strips):
                style: Entries = {"colors": figures.INK, "linewidth": width, "zorder": 3, "capstyle": "butt"}
                drawn[words] = axes.vlines(np.full(start.shape, place), start, stop, **style)
                drawn[words].set_path_effects([withStroke(linewidth=width + 1.8, foreground="white")])
    if drawn:
        figures.legend(axes, drawn, up=up)


def _intervals(mask: Array, time: Floats) -> tuple[Floats, Floats]:
    """Return the start and stop times of the intervals in which a condition holds.

    Each sample stands for half a sampling interval on either side of it.
    """
    padded = np.concatenate([[False], mask, [False]])
    change = np.flatnonzero(padded[1:] != padded[:-1])
    half = 0.5 * (time[1] - time[0]) if time.size > 1 else 0.0
    return np.maximum(time[change[::2]] - half, 0.0), time[change[1::2] - 1] + half


def contact_positions(sides: Sequence[tuple[str, Sequence[float]]], strips: Mapping[str, _Strip]) -> list[float]:
    """Return the positions of a contact on the picture's axis: one in the middle of the gap, or one for each side.

    The two sides have a position each where the axis shows them farther apart than they are in space.

    Parameters
    ----------
    sides
        Body and place in space of each side.
    strips
        The strips of the bodies whose stress was recorded.
    """
    places, nodes = [], []
    for body, node in sides:
        if body in strips:
            end = int(np.argmin(np.linalg.norm(strips[body].ends - np.asarray(node), axis=1)))
            places.append(float(strips[body].edges[(0, -1)[end]]))
            nodes.append(np.asarray(node))
    # The axis shows the two sides as near to each other as they are in space, so one line serves for both.
    if len(places) == 2 and abs(places[1] - places[0]) < np.linalg.norm(nodes[0] - nodes[1]) + 1e-6 * abs(places[0]):
        return [0.5 * (places[0] + places[1])]
    return places
