"""Figure of a case of bodies in two dimensions before its run: mesh, regions, contacts, supports, loads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.paired_surfaces import walls_of
from percuss.errors import InputError, Problem
from percuss.jsonable import Entries
from percuss.mesh.cells import cells_of
from percuss.reporting.deformed import draw_walls, outline
from percuss.reporting.figures import COLOURS, FAINT, INK, PAPER, SOFT, legend_below, new_figure, one_line, set_labels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.march.model import Model
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats

ARROW = 0.05  # length of an arrow, over the size of all bodies
MOST_ARROWS = 24  # of a surface or a load
HELD = {(True, True): ("^", "held"), (True, False): ("o", "held along x"), (False, True): ("s", "held along y")}


def case_figure(model: Model) -> Figure:
    """Return the figure of a case: its bodies with regions and meshes, contact surfaces, walls, supports and loads.

    Raises
    ------
    InputError
        If a body of the case is a bar.
    """
    if model.bodies.of_lines:
        advice = "Bars are told in words by `percuss check`, and drawn by `percuss run --plot`."
        raise InputError([Problem(model.case.origin.name, "", "expected bodies in two dimensions to draw", advice)])
    low, high = model.bodies.nodes.min(axis=0), model.bodies.nodes.max(axis=0)
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
        draw_walls(axes, {name: tuple(wall) for name, wall in walls_of(model.case, model.bodies).items()}, low, high)
        for k, name in enumerate(model.case.contacts):
            entries |= _contact(axes, model, name, COLOURS[k % len(COLOURS)], ARROW * size)
        entries |= _supports(axes, model) | _loads(axes, model, 2.0 * ARROW * size)
        for body in model.bodies.values():
            _names(axes, body, 0.3 * ARROW * size)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.grid(visible=False)
        set_labels(axes, model.case.data.get("units") or {}, xlabel=("x", "length"), ylabel=("y", "length"))
        legend_below(figure, entries)
    return figure


def _mesh(axes: Axes, body: Body) -> None:
    """Draw the cells of a body and its outline."""
    from matplotlib.collections import LineCollection, PolyCollection

    nodes, cells = body.mesh.nodes, cells_of(body.mesh)
    style: Any = {"facecolors": "#f4f6f8", "edgecolors": FAINT, "linewidths": 0.4}
    axes.add_collection(PolyCollection(list(nodes[cells]), rasterized=len(cells) > 1000, **style))
    axes.add_collection(LineCollection(list(nodes[outline(cells)]), colors=SOFT, linewidths=0.9))


def _names(axes: Axes, body: Body, inward: float) -> None:
    """Write the name of a body into it, and those of its regions inside of their middles."""
    style: Any = {"ha": "center", "va": "center", "bbox": {**PAPER, "alpha": 0.7, "pad": 1.0}, "zorder": 5}
    x, y = body.mesh.nodes.mean(axis=0)
    axes.text(x, y, one_line(body.name), size=11, weight="bold", color=INK, **style)
    for region in body.mesh.regions:
        surface = body.surface(region).surface
        out = surface.areas @ surface.normals
        if np.linalg.norm(out) > 1e-6 * surface.areas.sum():
            place, out = body.middle(region), out / np.linalg.norm(out)
        else:  # a surface that looks to all sides is named at its highest point
            facet = int(np.argmax(surface.normals[:, 1]))
            place, out = surface.positions[surface.facets[facet]].mean(axis=0), surface.normals[facet]
        turned = 90 if abs(out[0]) > 0.7 else 0
        x, y = place - 1.6 * inward * out
        axes.text(x, y, region, size=8.5, color=SOFT, rotation=turned, **style)


def _contact(axes: Axes, model: Model, name: str, colour: str, length: float) -> Entries:
    """Draw the surfaces of a contact with their outward normals."""
    from matplotlib.collections import LineCollection

    for side in model.case.contacts[name].sides:
        surface = model.bodies[side.body].surface(side.region).surface
        corners = surface.positions[surface.facets]
        lines = axes.add_collection(LineCollection(list(corners), colors=colour, linewidths=2.6, zorder=3))
        some = slice(None, None, max(1, -(-len(corners) // MOST_ARROWS)))
        _arrows(axes, corners.mean(axis=1)[some], length * surface.normals[some], colour)
    return {f"contact {name}, with normals": lines}


def _arrows(axes: Axes, tails: Floats, vectors: Floats, colour: str, **more: Any) -> None:
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "units": "inches", "width": 0.014, "zorder": 4}
    axes.quiver(*tails.T, *vectors.T, color=colour, **style, **more)


def _supports(axes: Axes, model: Model) -> Entries:
    """Mark the nodes that supports hold, by direction, and those that are driven."""
    held: dict[int, Floats] = {}
    driven: list[int] = []
    for constraint in model.loads.constraints:
        if constraint.load is not None:
            driven.append(constraint.node)
        else:
            held[constraint.node] = held.get(constraint.node, np.zeros(2)) + np.abs(constraint.direction)
    nodes, entries = model.bodies.nodes, {}
    for along, (mark, words) in HELD.items():
        some = [node for node, by in held.items() if (by[0] > 1e-9, by[1] > 1e-9) == along]
        if some:
            (entries[words],) = axes.plot(
                *nodes[some].T, mark, color=INK, markersize=7, markerfacecolor="white", zorder=4
            )
    if driven:
        (entries["driven"],) = axes.plot(*nodes[driven].T, "D", color=INK, fillstyle="none", zorder=4)
    return entries


def _loads(axes: Axes, model: Model, length: float) -> Entries:
    """Draw the forces on nodes as they are at amplitude 1, the largest of each load as an arrow of the given length."""
    entries: Entries = {}
    for k, (name, spec) in enumerate(model.case.loads.items()):
        forces = [force for force in model.loads.nodal_forces if force.load is spec]
        if not forces:
            continue
        colour, some = COLOURS[-1 - k % 2], forces[:: max(1, -(-len(forces) // MOST_ARROWS))]
        vectors = np.array([force.force for force in some])
        vectors *= length / np.linalg.norm([force.force for force in forces], axis=1).max()
        _arrows(axes, model.bodies.nodes[[force.node for force in some]], vectors, colour, pivot="tip")
        (entries[f"load {name}"],) = axes.plot([], [], color=colour, marker=r">", linewidth=1.5)
    return entries
