"""Figure of a case before its run, of bodies that are no bars: mesh, regions, contacts, supports, loads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from percuss.contact.pairs import walls_of
from percuss.errors import InputError, Problem
from percuss.jsonable import Entries
from percuss.mesh.cells import cells_of
from percuss.reporting import figures, solids
from percuss.reporting.figures import COLOURS, FAINT, INK, SOFT
from percuss.reporting.solids import Part

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.contact.model import Model
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats

Signs: TypeAlias = list[Part]  # marks and arrows, which no name may hide
Drawn: TypeAlias = dict[
    str, tuple[list[Part], Signs, Entries]
]  # surfaces and signs by label, and its line in the legend

# Lengths over the size of all bodies.
NORMAL, LOAD = 0.05, 0.1  # an arrow of a surface, the longest one of a load
APART = 0.04  # least distance between two arrows or marks
MARK = 0.009  # radius of the mark of a support
STEP = 0.03  # from a surface to its name, at least
# Corners and turn of the mark of a node that is held along these axes, along all, or driven.
MARKS = {"x": (20, 0), "y": (4, 45), "z": (3, 180), "xy": (5, 0), "xz": (6, 0), "yz": (8, 0)}
HELD, DRIVEN = (3, 0), (4, 0)


def case_figure(model: Model) -> Figure:
    """Return the figure of a case: its bodies with regions and meshes, contact surfaces, walls, supports and loads.

    In three dimensions bodies are translucent: what they hide is pale.

    Raises
    ------
    InputError
        If a body of the case is a bar.
    """
    if model.bodies.of_lines:
        advice = "`percuss check` describes bars in words; `percuss run --plot` draws them."
        raise InputError([Problem(model.case.origin.name, "", "expected bodies that are no bars to draw", advice)])
    nodes = model.bodies.nodes
    page = solids.on_page(nodes)
    size = float(np.ptp(page, axis=0).max())
    low, high = page.min(axis=0) - 2.2 * NORMAL * size, page.max(axis=0) + 2.2 * NORMAL * size
    tall = float(np.clip(9.0 * (high - low)[1] / (high - low)[0], 2.0, 7.5))
    facts = [f"bodies: {len(model.bodies)}", f"nodes: {len(nodes)}", f"contact points: {len(model.contact_points)}"]
    facts.append(f"size: {' × '.join(map(figures.number, np.ptp(nodes, axis=0)))}")
    with figures.new_figure(9.6, tall + 1.9, model.case.title, ["  ·  ".join(facts)]) as figure:
        from matplotlib.lines import Line2D

        axes = figure.subplots()
        solids.draw_walls(axes, walls_of(model.case, model.bodies).values(), nodes)
        meshes = [part for body in model.bodies.values() for part in _mesh(body, size)]
        drawn = _contacts(model, size) | _supports(model, size) | _loads(model, size)
        surfaces = [part for some, _, _ in drawn.values() for part in some]
        signs = [part for _, some, _ in drawn.values() for part in some]
        solids.draw(axes, [*meshes, *surfaces, *signs], zorder=2)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.grid(visible=False)
        if model.dim == 2:
            units = model.case.data.get("units") or {}
            figures.set_labels(axes, units, xlabel=("x", "length"), ylabel=("y", "length"))
        else:
            axes.set_axis_off()
        entries = {label: Line2D([], [], **style) for label, (_, _, style) in drawn.items()}
        if entries:
            figures.add_legend(figure, entries, loc="outside lower center")
        _write_names(axes, model, size)
    return figure


def _mesh(body: Body, size: float) -> list[Part]:
    """Return the cells of a body and its outline."""
    nodes = body.mesh.nodes
    faces = solids.Faces.of(cells_of(body.mesh), nodes.shape[1])
    cells = Part(nodes[faces.corners], "#f4f6f8" if nodes.shape[1] == 2 else "#eef1f4a8", FAINT, 0.4)
    return [cells, Part(faces.outline(nodes), edge=SOFT, width=0.9, nearer=0.2 * STEP * size)]


def _contacts(model: Model, size: float) -> Drawn:
    """Return the surfaces of the contacts with their outward normals.

    A surface of two contacts shows the colours of both, the later one within the other.
    """
    contacts, drawn = model.case.contacts, Drawn()
    for k, (name, contact) in enumerate(contacts.items()):
        colour, later = COLOURS[k % len(COLOURS)], list(contacts.values())[k + 1 :]
        surfaces: list[Part] = []
        normals: Signs = []
        for side in contact.sides:
            surface = model.bodies[side.body].surface(side.region).surface
            corners = surface.positions[surface.facets]
            width = 2.6 + 2.8 * sum(side in other.sides for other in later)
            if model.dim == 2:
                surfaces.append(Part(corners, edge=colour, width=width))
            else:
                surfaces.append(Part(corners, f"{colour}30", f"{colour}90", 0.3 * width, nearer=0.1 * STEP * size))
            tails, out = corners.mean(axis=1), NORMAL * size * surface.normals
            normals.append(_arrows(tails + out, out, size, colour))
        drawn[f"contact {name}, with normals"] = surfaces, normals, {"color": colour, "linewidth": 2.6}
    return drawn


def _arrows(tips: Floats, vectors: Floats, size: float, colour: str) -> Part:
    """Return arrows that stand evenly apart."""
    some = solids.spread(tips - vectors, APART * size)
    return Part(solids.arrows(tips[some], vectors[some], 0.0025 * size), colour, nearer=STEP * size)


def _supports(model: Model, size: float) -> Drawn:
    """Return marks on nodes that supports hold, by direction, or drive; marks that would overlap are left out."""
    held: dict[int, Floats] = {}
    driven: dict[int, bool] = {}
    for constraint in model.loads.constraints:
        if constraint.load is not None:
            driven[constraint.node] = True
        else:
            held[constraint.node] = held.get(constraint.node, np.zeros(model.dim)) + np.abs(constraint.direction)
    along: dict[str, list[int]] = {}
    for node, by in held.items():
        along.setdefault("".join(axis for axis, part in zip("xyz", by, strict=False) if part > 1e-9), []).append(node)
    drawn = Drawn()
    for axes, nodes in sorted(along.items(), key=lambda item: (-len(item[0]), item[0])):
        whole = len(axes) == model.dim
        words = "held" if whole else f"held along {' and '.join(axes)}"
        drawn[words] = _marks(model, nodes, HELD if whole else MARKS.get(axes, HELD), size)
    return drawn | ({"driven": _marks(model, list(driven), DRIVEN, size)} if driven else {})


def _marks(model: Model, nodes: list[int], shape: tuple[int, int], size: float) -> tuple[list[Part], Signs, Entries]:
    """Return regular polygons on nodes that stand evenly apart, given by their corners and turn."""
    sides, turn = shape
    places = model.bodies.nodes[nodes]
    angles = np.radians(90.0 + turn) + 2.0 * np.pi * np.arange(sides) / sides
    corners = MARK * size * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    corners = corners if model.dim == 2 else corners @ solids.PAGE.T
    marks = places[solids.spread(places, APART * size)][:, None] + corners
    style: Entries = {"marker": (sides, 0, turn), "linestyle": "none", "color": INK}
    look = {**style, "markerfacecolor": "white", "markersize": 8}
    return [], [Part(marks, "white", INK, 1.0, nearer=STEP * size)], look


def _loads(model: Model, size: float) -> Drawn:
    """Return the forces on nodes as they are at amplitude 1, the largest of each load as an arrow of a given length."""
    drawn = Drawn()
    for k, (name, spec) in enumerate(model.case.loads.items()):
        forces = [force for force in model.loads.nodal_forces if force.load is spec]
        if forces:
            colour, vectors = COLOURS[-1 - k % 2], np.array([force.force for force in forces])
            vectors *= LOAD * size / np.linalg.norm(vectors, axis=1).max()
            arrows = _arrows(model.bodies.nodes[[force.node for force in forces]], vectors, size, colour)
            drawn[f"load {name}"] = [], [arrows], {"color": colour, "marker": ">", "linewidth": 1.5}
    return drawn


def _write_names(axes: Axes, model: Model, size: float) -> None:
    """Write the names of the bodies into their middles, and those of their regions beside what is seen of them."""
    style: Any = {"ha": "center", "va": "center", "bbox": {**figures.PAPER, "alpha": 0.7, "pad": 1.0}, "zorder": 5}
    for body in model.bodies.values():
        middle = solids.on_page(body.mesh.nodes.mean(axis=0))
        axes.text(middle[0], middle[1], figures.one_line(body.name), size=11, weight="bold", color=INK, **style)
        for region in body.mesh.regions:
            place = _beside(body, region, STEP * size)
            axes.text(place[0], place[1], region, size=8.5, color=SOFT, **style)


def _beside(body: Body, region: str, step: float) -> Floats:
    """Return the place for the name of a region: a step from the facet in the middle of what is seen of it.

    In two dimensions it is in the body, if that is thick there.
    """
    surface = body.surface(region).surface
    middles, normals = surface.positions[surface.facets].mean(axis=1), surface.normals
    flat = middles.shape[1] == 2
    seen = np.full(len(middles), fill_value=True) if flat else normals @ solids.TO_CAMERA > 0.1
    if seen.any():
        first = np.where(seen, np.linalg.norm(middles - middles[seen].mean(axis=0), axis=1), np.inf)
    else:
        first = -middles @ solids.TO_CAMERA  # its nearest edge is seen
    facet = int(first.argmin())
    inside = flat and np.ptp(body.mesh.nodes @ normals[facet]) > 5.0 * step
    return solids.on_page(middles[facet] + (-step if inside else step) * normals[facet])
