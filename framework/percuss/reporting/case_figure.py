"""Figure of a case before its run, of bodies that are no bars: mesh, regions, contacts, supports, loads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.pairs import walls_of
from percuss.errors import InputError, Problem
from percuss.jsonable import Entries
from percuss.mesh.cells import cells_of
from percuss.reporting.figures import COLOURS, FAINT, INK, PAPER, SOFT, legend_below, new_figure, one_line, set_labels
from percuss.reporting.views import Faces, draw_walls, on_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.contact.model import Model
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers

ARROW = 0.05  # length of an arrow, over the size of all bodies
MOST_ARROWS = 24  # of a surface or a load
MARKS = 0.025  # least distance between two marks of a support, over the size of all bodies
BESIDE, BEYOND = 0.45, 1.35  # distance of a name from its region, over the length of an arrow: without and with arrows
ROOM = 4.5  # of these distances that a body has to have, for the name to stand inside of it
LETTER = 0.012  # height of a letter of a name, over the size of all bodies
MARK_OF = {"x": "o", "y": "s", "z": "v", "xy": "p", "xz": "h", "yz": "8"}  # of a node that is held along these axes


def case_figure(model: Model) -> Figure:
    """Return the figure of a case: its bodies with regions and meshes, contact surfaces, walls, supports and loads.

    Raises
    ------
    InputError
        If a body of the case is a bar.
    """
    if model.bodies.of_lines:
        advice = "`percuss check` describes bars in words; `percuss run --plot` draws them."
        raise InputError([Problem(model.case.origin.name, "", "expected bodies that are no bars to draw", advice)])
    nodes = model.bodies.nodes
    page = on_page(nodes)
    low, high = page.min(axis=0), page.max(axis=0)
    size = float((high - low).max())
    low, high = low - 2.2 * ARROW * size, high + 2.2 * ARROW * size
    width, height = high - low
    tall = float(np.clip(9.0 * height / width, 2.0, 7.5))
    counts = {"bodies": len(model.bodies), "nodes": model.bodies.n_nodes, "contact points": len(model.contact_points)}
    small = ["  ·  ".join(f"{words}: {count}" for words, count in counts.items())]
    entries: Entries = {}
    with new_figure(9.6, tall + 1.9, model.case.title, small) as figure:
        axes = figure.subplots()
        for body in model.bodies.values():
            _mesh(axes, body)
        middle = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0))
        draw_walls(axes, walls_of(model.case, model.bodies), middle, float(np.ptp(nodes, axis=0).max()))
        for k, name in enumerate(model.case.contacts):
            entries |= _contact(axes, model, name, COLOURS[k % len(COLOURS)], ARROW * size)
        entries |= _supports(axes, model, MARKS * size) | _loads(axes, model, 2.0 * ARROW * size)
        for body in model.bodies.values():
            _names(axes, model, body, size)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.grid(visible=False)
        if model.dim == 2:
            set_labels(axes, model.case.data.get("units") or {}, xlabel=("x", "length"), ylabel=("y", "length"))
        else:
            axes.set_axis_off()
        legend_below(figure, entries)
    return figure


def _mesh(axes: Axes, body: Body) -> None:
    """Draw the cells of a body and its outline."""
    from matplotlib.collections import LineCollection, PolyCollection

    nodes, faces = body.mesh.nodes, Faces.of(cells_of(body.mesh), body.mesh.nodes.shape[1])
    seen, page = faces.seen(nodes), on_page(nodes)
    style: Any = {"facecolors": "#f4f6f8", "edgecolors": FAINT, "linewidths": 0.4}
    axes.add_collection(PolyCollection(faces.polygons(seen, nodes), rasterized=seen.size > 1000, **style))
    axes.add_collection(LineCollection(list(page[faces.edges(nodes)]), colors=SOFT, linewidths=0.9))


def _names(axes: Axes, model: Model, body: Body, size: float) -> None:
    """Write the name of a body into its middle, and those of its regions beside theirs, where no arrow is."""
    style: Any = {"ha": "center", "va": "center", "bbox": {**PAPER, "alpha": 0.7, "pad": 1.0}, "zorder": 5}
    touching = {(side.body, side.region) for contact in model.case.contacts.values() for side in contact.sides}
    nodes = body.mesh.nodes
    x, y = on_page(nodes.mean(axis=0))
    axes.text(x, y, one_line(body.name), size=11, weight="bold", color=INK, **style)
    for region in body.mesh.regions:
        surface = body.surface(region).surface
        middles = surface.positions[surface.facets].mean(axis=1)
        if np.linalg.norm(surface.normals.sum(axis=0)) > 1e-6 * len(middles):
            facet = int(np.linalg.norm(middles - middles.mean(axis=0), axis=1).argmin())
        else:  # a surface that looks to all sides is named at its highest point
            facet = int(surface.normals[:, -1].argmax())
        out, touches = surface.normals[facet], (body.name, region) in touching
        away = ARROW * size * (BEYOND if touches else BESIDE)
        flat = out.size == 2
        inside = flat and np.ptp(nodes @ out) > ROOM * away
        # Outside of the middle of a surface that touches another there is the other body.
        place = middles[facet] if inside or not touches else middles[len(middles) // 8]
        upright = flat and np.ptp(surface.positions[:, 1]) > LETTER * size * len(region) and abs(out[0]) > 0.7
        x, y = on_page(place - away * out if inside else place + away * out)
        axes.text(x, y, region, size=8.5, color=SOFT, rotation=90 if upright else 0, **style)


def _some(count: int) -> Integers:
    """Return at most `MOST_ARROWS` of `count` numbers, evenly spread, also where the last is beside the first."""
    most = min(count, MOST_ARROWS)
    return ((np.arange(most) + 0.5) * count / most).astype(int)


def _contact(axes: Axes, model: Model, name: str, colour: str, length: float) -> Entries:
    """Draw the surfaces of a contact with their outward normals."""
    from matplotlib.collections import LineCollection

    contacts = model.case.contacts
    later = list(contacts)[list(contacts).index(name) + 1 :]
    for side in contacts[name].sides:
        surface = model.bodies[side.body].surface(side.region).surface
        corners = surface.positions[surface.facets]
        # A surface of two contacts shows the colours of both, the later one within the other.
        width = 2.6 + 2.8 * sum(side in contacts[other].sides for other in later)
        thin: Any = {"linewidths": width} if model.dim == 2 else {"linewidths": 0.5 * width, "alpha": 0.5}
        rims = on_page(corners if model.dim == 2 else np.concatenate([corners, corners[:, :1]], axis=1))
        lines = axes.add_collection(LineCollection(list(rims), colors=colour, zorder=3, **thin))
        some = _some(len(corners))
        _arrows(axes, corners.mean(axis=1)[some], length * surface.normals[some], colour)
    return {f"contact {name}, with normals": lines}


def _arrows(axes: Axes, tails: Floats, vectors: Floats, colour: str, **more: Any) -> None:
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "units": "inches", "width": 0.014, "zorder": 4}
    axes.quiver(*on_page(tails).T, *on_page(vectors).T, color=colour, **style, **more)


def _supports(axes: Axes, model: Model, apart: float) -> Entries:
    """Mark nodes that supports hold, by direction, and some that are driven; marks that would overlap are left out."""
    held: dict[int, Floats] = {}
    driven: list[int] = []
    for constraint in model.loads.constraints:
        if constraint.load is not None:
            driven.append(constraint.node)
        else:
            held[constraint.node] = held.get(constraint.node, np.zeros(model.dim)) + np.abs(constraint.direction)
    nodes, entries = on_page(model.bodies.nodes), {}
    along: dict[str, list[int]] = {}
    for node, by in held.items():
        along.setdefault("".join(axis for axis, size in zip("xyz", by, strict=False) if size > 1e-9), []).append(node)
    for held_along, some in sorted(along.items(), key=lambda item: (-len(item[0]), item[0])):
        words = "held" if len(held_along) == model.dim else f"held along {' and '.join(held_along)}"
        style: Any = {"color": INK, "markersize": 7, "markerfacecolor": "white", "zorder": 4}
        mark = MARK_OF.get(held_along, "^") if words != "held" else "^"
        (entries[words],) = axes.plot(*_apart(nodes[some], apart).T, mark, **style)
    if driven:
        (entries["driven"],) = axes.plot(*_apart(nodes[driven], apart).T, "D", color=INK, fillstyle="none", zorder=4)
    return entries


def _apart(places: Floats, least: float) -> Floats:
    """Return those places that are not nearer than `least` to one that comes before."""
    kept = places[:1]
    for place in places[1:]:
        if (np.abs(kept - place).max(axis=1) > least).all():
            kept = np.concatenate([kept, place[None]])
    return kept


def _loads(axes: Axes, model: Model, length: float) -> Entries:
    """Draw the forces on nodes as they are at amplitude 1, the largest of each load as an arrow of the given length."""
    entries: Entries = {}
    for k, (name, spec) in enumerate(model.case.loads.items()):
        forces = [force for force in model.loads.nodal_forces if force.load is spec]
        if not forces:
            continue
        colour, some = COLOURS[-1 - k % 2], [forces[k] for k in _some(len(forces))]
        vectors = np.array([force.force for force in some])
        vectors *= length / np.linalg.norm([force.force for force in forces], axis=1).max()
        _arrows(axes, model.bodies.nodes[[force.node for force in some]], vectors, colour, pivot="tip")
        (entries[f"load {name}"],) = axes.plot([], [], color=colour, marker=r">", linewidth=1.5)
    return entries
