"""The picture of stress in space and time: the waves, and the contact between the bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.reporting.figures import INK, legend, not_computed, powers, say, shown_until, stopped_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from percuss.results.result import Result


class _Strip(NamedTuple):
    """A body in the space-time picture."""

    columns: Any  # its elements in the field
    edges: Any  # of its elements along the picture's axis
    ends: Any  # start and end in space, (2, dim)


def _strips(fields: Mapping[str, Any]) -> tuple[dict[str, _Strip], str]:
    """Lay the bodies along one axis: as they stand where they form a line, else one after another."""
    owner, position = np.array(fields["body"], dtype=object), np.asarray(fields["position"], dtype=float)
    edges, columns = {}, {}
    for name in dict.fromkeys(owner):
        columns[name] = np.flatnonzero(owner == name)
        edges[name] = _edges(position, columns[name])
    first, *_ = edges.values()
    flat = position.shape[1] > 1
    along = (first[-1] - first[0]) / np.linalg.norm(first[-1] - first[0]) if flat else np.ones(1)
    origin = first[0] if flat else np.zeros(1)
    off = np.concatenate(list(edges.values())) - origin
    if np.abs(off - np.outer(off @ along, along)).max() <= 1e-6 * np.abs(off).max():
        placed = {name: (points - origin) @ along for name, points in edges.items()}
        label = f"distance along the line of '{next(iter(edges))}'" if flat else "position"
    else:
        label = "length along each body, one after another"
        placed, at = {}, 0.0
        for name, points in edges.items():
            steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
            placed[name] = at + np.concatenate([[0.0], np.cumsum(steps)])
            at = placed[name][-1] + 0.06 * np.linalg.norm(first[-1] - first[0])
    return {name: _Strip(columns[name], placed[name], edges[name][[0, -1]]) for name in edges}, label


def _edges(position: Any, columns: Any) -> Any:
    """Return the ends of a body's elements in space from their middles."""
    middle = position[columns]
    if len(middle) > 1:
        inner = 0.5 * (middle[1:] + middle[:-1])
        return np.stack([1.5 * middle[0] - 0.5 * middle[1], *inner, 1.5 * middle[-1] - 0.5 * middle[-2]])
    # nothing says how long a lone element is: let it reach half-way to its neighbour
    others = np.linalg.norm(np.delete(position, columns, axis=0) - middle, axis=1)
    half = np.zeros(position.shape[1])
    half[0] = 0.5 * others.min(initial=np.inf) if others.size else 0.5
    return np.stack([middle[0] - half, middle[0] + half])


def space_time(axes: Axes, result: Result) -> None:
    """Draw stress over position and time, bodies by themselves, contacts as lines where closed."""
    fields = result.field_arrays
    if not fields or not np.size(fields["stress"]):
        say(axes, "No stress over space\nand time was recorded.\nAsk for it with\n\nrecord: {fields: 200}")
        return
    strips, label = _strips(fields)
    time, stress = np.asarray(fields["time"], dtype=float), np.asarray(fields["stress"], dtype=float)
    finite = np.abs(stress[np.isfinite(stress)])
    largest = float(finite.max(initial=0.0))
    limit = float(np.percentile(finite, 99.5)) if finite.size else 0.0
    limit = limit if limit > 1e-3 * largest else largest or 1.0
    step = time[1] - time[0] if time.size > 1 else result.summary["dt"]
    rows = np.concatenate([time - 0.5 * step, [time[-1] + 0.5 * step]]).clip(0, max(stopped_at(result), step))
    look: dict[str, Any] = {"cmap": "RdBu_r", "vmin": -limit, "vmax": limit, "rasterized": True}
    for strip in strips.values():
        mesh = axes.pcolormesh(strip.edges, rows, np.ma.masked_invalid(stress[:, strip.columns]), **look)
        axes.vlines(strip.edges[[0, -1]], 0, rows[-1], colors="#8a8a8a", linewidth=0.6, zorder=2.5)
    _contact_lines(axes, result, strips, up=_body_names(axes, strips))
    axes.set(xlabel=label, ylabel="time", ylim=(0, shown_until(result)))
    axes.grid(visible=False)
    powers(axes)
    not_computed(axes, result, upwards=True)
    extend = "both" if largest > 1.001 * limit else "neither"
    bar = axes.figure.colorbar(mesh, ax=axes, aspect=45, pad=0.015, extend=extend)
    powers(bar.ax)
    bar.set_label("compression  ←  stress  →  tension")


def _body_names(axes: Axes, strips: Mapping[str, _Strip]) -> float:
    """Write each body's name above it, upright where they are narrow; return how high they reach."""
    whole = np.concatenate([strip.edges for strip in strips.values()])
    low, high = float(whole.min()), float(whole.max())
    axes.set_xlim(low - 0.012 * (high - low), high + 0.012 * (high - low))
    room = {name: 5.0 * float(np.ptp(strip.edges)) / (high - low) for name, strip in strips.items()}
    upright = any(0.09 * len(name) > inches for name, inches in room.items())
    frame, turn = axes.get_xaxis_transform(), 90 if upright else 0
    longest = 0
    for name in list(strips)[:: -(-len(strips) // 30)]:
        words = name if len(name) <= 16 or not upright else f"{name[:15]}…"
        where = (float(strips[name].edges[[0, -1]].mean()), 1.01)
        style: dict[str, Any] = {"rotation": turn, "size": 9, "ha": "center", "va": "bottom"}
        axes.text(*where, words, transform=frame, parse_math=False, **style)
        longest = max(longest, len(words))
    return 1.02 + 0.0155 * longest if upright else 1.045


def _contact_lines(axes: Axes, result: Result, strips: Mapping[str, _Strip], up: float) -> None:
    """Mark where each contact is closed, thicker while it carries force; white around keeps both visible."""
    contacts = result.provenance["case"].get("contacts") or {}
    time, drawn = result.arrays["time"], {}
    size = float(np.ptp(np.concatenate([strip.edges for strip in strips.values()])))
    for k, name in enumerate(result.coordinates["contact"]):
        pressed = result.arrays["contact_force"][:, k] > 0
        closed = (result.arrays["gap"][:, k] <= 1e-9 * size) | pressed
        lines = ((closed, 3.0, "white"), (pressed, 5.5, "white"), (closed, 1.4, INK), (pressed, 3.4, INK))
        for place in _places(contacts.get(name) or {}, strips):
            for mask, width, colour in lines:
                start, stop = _stretches(mask, time)
                at = np.full(start.shape, place)
                drawn[width] = axes.vlines(at, start, stop, colors=colour, lw=width, zorder=3, capstyle="butt")
    if drawn:
        legend(axes, {"contact closed": drawn[1.4], "with force": drawn[3.4]}, up=up)


def _stretches(mask: Any, time: Any) -> tuple[Any, Any]:
    """Return when a condition begins and ends to hold; a sample stands for half a spacing to either side."""
    padded = np.concatenate([[False], mask, [False]])
    change = np.flatnonzero(padded[1:] != padded[:-1])
    half = 0.5 * (time[1] - time[0]) if time.size > 1 else 0.0
    return np.maximum(time[change[::2]] - half, 0.0), time[change[1::2] - 1] + half


def _places(contact: Mapping[str, Any], strips: Mapping[str, _Strip]) -> list[float]:
    """Return where a contact stands on the picture's axis: in the gap, or at both ends where these lie apart."""
    ends = []
    for address in contact.get("between") or [contact.get("body") or ""]:
        body, _, region = str(address).partition(".")
        if body in strips:
            ends.append((body, {"left": 0, "right": -1}.get(region, 0)))
    places = [float(strips[body].edges[end]) for body, end in ends]
    if len(places) == 2:
        spread = np.linalg.norm(strips[ends[0][0]].ends[ends[0][1]] - strips[ends[1][0]].ends[ends[1][1]])
        if abs(places[1] - places[0]) < spread + 1e-6 * abs(places[0]):  # drawn as near as they are
            return [0.5 * (places[0] + places[1])]
    return places
