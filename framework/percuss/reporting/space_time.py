"""Panel of the stress in space and time, which shows the waves and the contact between the bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from percuss.case.quantities import with_unit
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import Array, Floats, Integers
from percuss.reporting.figures import INK, STRESS, TIME, hatch_after_stop, legend, set_labels, write_reason

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from percuss.results.result import Result


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
        write_reason(axes, "No stress over space\nand time was recorded.\nAsk for it with\n\nrecord: {fields: 200}")
        return
    if "geometry" not in result.provenance:
        write_reason(axes, "This result was saved by an earlier version,\nwhich did not keep the places of the bodies.")
        return
    strips, label = strips_of(fields, result.provenance["geometry"]["bodies"])
    time, stress = np.asarray(fields["time"], dtype=float), np.asarray(fields["stress"], dtype=float)
    finite = np.abs(stress[np.isfinite(stress)])
    largest = float(finite.max(initial=0.0))
    limit = float(np.percentile(finite, 99.5)) if finite.size else 0.0
    limit = limit if limit > 1e-3 * largest else largest or 1.0
    step = time[1] - time[0] if time.size > 1 else result.summary.get("dt") or until
    rows = np.concatenate([time - 0.5 * step, [time[-1] + 0.5 * step]]).clip(0, max(result.end, step))
    style: Entries = {"cmap": "RdBu_r", "vmin": -limit, "vmax": limit, "rasterized": True}
    for strip in strips.values():
        mesh = axes.pcolormesh(strip.edges, rows, np.ma.masked_invalid(stress[:, strip.columns]), **style)
        axes.vlines(strip.edges[[0, -1]], 0, rows[-1], colors="#8a8a8a", linewidth=0.6, zorder=2.5)
    _contact_lines(axes, result, strips, up=body_names(axes, strips))
    set_labels(axes, result.units, xlabel=(label, "length"), ylabel=TIME)
    axes.set_ylim(0, until)
    axes.grid(visible=False)
    hatch_after_stop(axes, result, until, upwards=True)
    extend = "both" if largest > 1.001 * limit else "neither"
    bar = axes.figure.colorbar(mesh, ax=axes, aspect=45, pad=0.015, extend=extend)
    middle = with_unit(*STRESS, result.units)
    bar.ax.set_ylabel(f"compression  ←  {middle}  →  tension")


def body_names(axes: Axes, strips: Mapping[str, _Strip]) -> float:
    """Write the names of the bodies above their strips, and return the upper edge of the names in axes coordinates.

    The names are turned upright where a strip is too narrow for its name; at most 30 of them are written.
    """
    whole = np.concatenate([strip.edges for strip in strips.values()])
    low, high = float(whole.min()), float(whole.max())
    axes.set_xlim(low - 0.012 * (high - low), high + 0.012 * (high - low))
    room = {name: 5.0 * float(np.ptp(strip.edges)) / (high - low) for name, strip in strips.items()}
    upright = any(0.09 * len(name) > inches for name, inches in room.items())
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
    contacts = result.provenance["geometry"]["contacts"]
    time, drawn = result.arrays["time"], {}
    size = float(np.ptp(np.concatenate([strip.edges for strip in strips.values()])))
    for k, name in enumerate(result.coordinates["contact"]):
        pressed = result.arrays["contact_force"][:, k] > 0
        closed = (result.arrays["gap"][:, k] <= 1e-9 * size) | pressed
        lines = ((closed, 3.0, "white"), (pressed, 5.5, "white"), (closed, 1.4, INK), (pressed, 3.4, INK))
        for place in contact_positions(contacts[name], strips):
            for mask, width, colour in lines:
                start, stop = _intervals(mask, time)
                at = np.full(start.shape, place)
                drawn[width] = axes.vlines(at, start, stop, colors=colour, lw=width, zorder=3, capstyle="butt")
    if drawn:
        legend(axes, {"contact closed": drawn[1.4], "with force": drawn[3.4]}, up=up)


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
