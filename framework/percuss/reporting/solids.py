"""How solids come onto a page: faces of cells, arrows and walls, and panels of deformed solids at chosen times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.case.quantities import QUANTITIES, with_unit
from percuss.contact.walls import CYLINDER, PLANE, WallShape
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import REFERENCE_CELLS, Array, Floats, Integers
from percuss.reporting import figures
from percuss.step.parts.friction import STICKS

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

    from percuss.results.result import Result

# A camera far away, to the right of the y axis and above, which looks along y: x runs to the right and z up.
ACROSS, ABOVE = np.radians(28.0), np.radians(22.0)
TO_CAMERA = np.array([np.sin(ACROSS) * np.cos(ABOVE), -np.cos(ACROSS) * np.cos(ABOVE), np.sin(ABOVE)])
RIGHT = np.array([np.cos(ACROSS), np.sin(ACROSS), 0.0])
PAGE = np.stack([RIGHT, np.cross(TO_CAMERA, RIGHT)], axis=1)  # (3, 2)
# The faces of cells by the number of their corners.
FACES: Mapping[int, list[list[int]]] = {
    len(REFERENCE_CELLS[kind].corners): REFERENCE_CELLS[kind].facets.tolist() for kind in ("tetra", "hexahedron")
}
SHARP = 0.8  # largest cosine between two faces that meet in an edge which is drawn
MANY = 500  # polygons; more of them are drawn as an image in a file of lines
COLOUR_MAP = "YlGnBu"  # it differs in lightness alone for readers who see no colours, and is pale where nothing happens
MOST_PICTURES, APART = 4, 0.04  # of the time of the run between two pictures
MOST_MOTION = 5.0  # of a snapshot that is shown, over the size of all solids; an unstable run moves more
LONGEST = 0.22  # arrow, over the geometric mean of the sides of the picture
LEAST = 0.04  # pressure that has an arrow, over the largest
SPACE = 0.13  # least distance between two arrows, over the length of the longest
MOST_EDGES = 3000
AROUND = 48  # pieces of a round wall


def on_page(vectors: Floats) -> Floats:
    """Return points or vectors, (..., dim), as they are seen, (..., 2)."""
    seen: Floats = vectors if vectors.shape[-1] == 2 else vectors @ PAGE
    return seen


class Faces(NamedTuple):
    """Faces of cells that may be seen: cells in two dimensions, the boundary of the solids in three.

    Attributes
    ----------
    corners : (faces, 4) array
        Nodes of each, the last one twice in a triangle.
    cell : (faces,) array
        The cell of each.
    edges : (edges, 2) array
        Nodes of each edge of them.
    beside : (edges, 2) array
        The two faces at each edge, one twice where there is no other.
    """

    corners: Integers
    cell: Integers
    edges: Integers
    beside: Integers

    @classmethod
    def of(cls, cells: Integers, dim: int) -> Faces:
        """Return those of cells, whose nodes end with -1 where others have more."""
        counts = (cells >= 0).sum(axis=1)
        found, owner = [], []
        for count in np.unique(counts).tolist():
            (numbers,) = np.nonzero(counts == count)
            sides = FACES[count] if dim == 3 else [list(range(count))]
            faces = cells[numbers][:, sides].reshape(-1, len(sides[0]))
            _, first, times = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
            outer = np.sort(first[times == 1])
            found.append(np.pad(faces[outer], ((0, 0), (0, 4 - len(sides[0]))), mode="edge"))
            owner.append(numbers[outer // len(sides)])
        corners = np.concatenate(found)
        rims = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
        (real,) = np.nonzero(rims[:, 0] != rims[:, 1])
        _, first, of = np.unique(np.sort(rims[real], axis=1), axis=0, return_index=True, return_inverse=True)
        last = np.zeros_like(first)
        last[of.ravel()] = np.arange(real.size)  # of the faces at an edge the last one stays
        return cls(corners, np.concatenate(owner), rims[real][first], real[np.stack([first, last], axis=1)] // 4)

    def normals(self, nodes: Floats) -> Floats:
        """Return unit normals in three dimensions, (faces, 3), from two diagonals or, of triangles, two sides."""
        at = nodes[self.corners]
        out = np.cross(at[:, 2] - at[:, 0], at[:, 3] - at[:, 1])
        unit: Floats = out / np.maximum(np.linalg.norm(out, axis=1), np.finfo(float).tiny)[:, None]
        return unit

    def seen(self, nodes: Floats) -> Array:
        """Return which faces look to the camera."""
        if nodes.shape[1] == 2:
            return np.full(len(self.cell), fill_value=True)
        front: Array = self.normals(nodes) @ TO_CAMERA > 0.0
        return front

    def outline(self, nodes: Floats) -> Floats:
        """Return the edges of the boundary, in three dimensions the sharp ones that are seen, (edges, 2, dim)."""
        if nodes.shape[1] == 2:
            drawn = self.beside[:, 0] == self.beside[:, 1]
        else:
            normals = self.normals(nodes)[self.beside]
            drawn = ((normals @ TO_CAMERA).max(axis=1) > 0.0) & (normals.prod(axis=1).sum(axis=1) < SHARP)
        lines: Floats = nodes[self.edges[drawn]]
        return lines


class Part(NamedTuple):
    """Polygons of one look.

    Attributes
    ----------
    polygons : (polygons, corners, dim) array
        Their corners in space; two for a line.
    face, edge
        One colour, or one for each polygon.
    width
        Width of the edges.
    nearer
        A length by which they count as nearer to the camera than they are.
    """

    polygons: Floats
    face: Any = "none"
    edge: Any = "none"
    width: float = 0.0
    nearer: float = 0.0


def draw(axes: Axes, parts: Sequence[Part], **options: Any) -> PolyCollection:
    """Draw polygons as one collection: in two dimensions in their order, in three those that are farther away first."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba_array

    counts = [len(part.polygons) for part in parts]
    page = [polygon for part in parts for polygon in on_page(part.polygons)]
    order = np.arange(len(page))
    if parts[0].polygons.shape[-1] == 3:
        depths = [part.polygons.mean(axis=1) @ TO_CAMERA + part.nearer for part in parts]
        order = np.argsort(np.concatenate(depths), kind="stable")

    def colours(each: Sequence[Any]) -> Floats:
        rows = [np.resize(to_rgba_array(one), (count, 4)) for one, count in zip(each, counts, strict=True)]
        return np.concatenate(rows)[order]

    widths = np.repeat([part.width for part in parts], counts)[order]
    looks: Any = {"facecolors": colours([part.face for part in parts]), "edgecolors": colours([p.edge for p in parts])}
    many = len(page) > MANY
    drawn = PolyCollection([page[k] for k in order], linewidths=widths, rasterized=many, **looks, **options)
    axes.add_collection(drawn)
    return drawn


def arrows(tips: Floats, vectors: Floats, width: float) -> Floats:
    """Return arrows as polygons that face the camera, (arrows, 7, dim); the first corner is the tip."""
    length = np.linalg.norm(vectors, axis=1)[:, None]
    along = vectors / np.maximum(length, np.finfo(float).tiny)
    across = np.cross(along, TO_CAMERA) if vectors.shape[1] == 3 else along[:, ::-1] * [1.0, -1.0]
    across /= np.maximum(np.linalg.norm(across, axis=1)[:, None], 1e-9)
    head = np.minimum(4.0 * width, length)
    back = np.concatenate([0.0 * head, head, head, length, length, head, head], axis=1)[..., None]
    aside = width * np.array([0.0, 1.5, 0.5, 0.5, -0.5, -0.5, -1.5])[:, None]
    polygons: Floats = tips[:, None] - back * along[:, None] + aside * across[:, None]
    return polygons


def spread(places: Floats, least: float) -> list[int]:
    """Return the numbers of those places that are not nearer than `least` to one that comes before."""
    kept: list[int] = []
    for k, place in enumerate(places):
        if (np.linalg.norm(places[kept] - place, axis=1) > least).all():
            kept.append(k)
    return kept


def draw_walls(axes: Axes, walls: Iterable[WallShape], nodes: Floats) -> list[Artist]:
    """Draw walls beside nodes: lines with hatches on the far side; in space what lies near. Return what was drawn."""
    size = float(np.ptp(nodes, axis=0).max())
    drawn: list[Artist] = []
    for wall in walls:
        sheet = _sheet(wall, nodes, size)
        if nodes.shape[1] == 2:
            _, out = wall.meet(sheet)
            far = (sheet - 0.035 * size * out)[::-1]
            style: Entries = {"facecolor": "#f3f3f3", "edgecolor": figures.FAINT, "hatch": "////", "linewidth": 0}
            drawn += axes.fill(*np.concatenate([sheet, far]).T, **style)
            drawn += axes.plot(*sheet.T, color=figures.INK, linewidth=1.2)
            continue
        _, out = wall.meet(0.5 * (nodes.min(axis=0) + nodes.max(axis=0))[None])
        behind = bool(out[0] @ TO_CAMERA > 0.0)  # the camera and the solids are on one side
        part = Part(sheet, "#f3f3f3" if behind else "#e8e8e855", figures.FAINT, 1.0 if len(sheet) == 1 else 0.4)
        drawn.append(draw(axes, [part], zorder=0 if behind else 3))
    return drawn


def _sheet(wall: WallShape, nodes: Floats, size: float) -> Floats:
    """Return the part of a wall near nodes: the corners of a line, (n, 2), or of quadrilaterals in space, (n, 4, 3)."""
    middle, dim = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0)), nodes.shape[1]
    if wall.kind == PLANE:
        foot = middle - wall.axis * float(wall.axis @ (middle - wall.point))
        if dim == 2:
            along = 9.0 * size * np.array([-wall.axis[1], wall.axis[0]])  # beyond the view, if solids move far
            return np.array([foot - along, foot + along])
        first = np.cross(wall.axis, np.eye(3)[int(np.abs(wall.axis).argmin())])
        first *= 0.6 * size / np.linalg.norm(first)
        second = np.cross(wall.axis, first)
        return np.array([[foot + a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]])
    _, (up,) = wall.meet(middle[None])
    up, reach = wall.side * up, min(np.pi, 1.2 * size / wall.radius)
    angle = np.linspace(-reach, reach, AROUND + 1)
    if dim == 2:
        beside = np.array([-up[1], up[0]])
        line: Floats = wall.point + wall.radius * (np.cos(angle)[:, None] * up + np.sin(angle)[:, None] * beside)
        return line
    if wall.kind == CYLINDER:
        foot = wall.point + wall.axis * float(wall.axis @ (middle - wall.point))
        around = np.cos(angle)[:, None] * up + np.sin(angle)[:, None] * np.cross(wall.axis, up)
        grid = np.array([foot + side * 0.6 * size * wall.axis + wall.radius * around for side in (-1.0, 1.0)])
    else:
        first = np.cross(up, np.eye(3)[int(np.abs(up).argmin())])
        first /= np.linalg.norm(first)
        turn = np.linspace(0.0, 2.0 * np.pi, AROUND + 1)[:, None]
        around = np.cos(turn) * first + np.sin(turn) * np.cross(up, first)
        tilts = angle[AROUND // 2 :]
        grid = np.array([wall.point + wall.radius * (np.cos(a) * up + np.sin(a) * around) for a in tilts])
    corners = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2)
    return corners.reshape(-1, 4, 3)


# --------------------------------------------------------------------------- deformed solids


def last_whole(fields: Data) -> int:
    """Return the last snapshot in which no body has left the picture, as those of an unstable run do."""
    size = np.ptp(fields["node_position"], axis=0).max()
    whole = (np.abs(fields["displacement"]) < MOST_MOTION * size).all(axis=(1, 2))
    return int(np.flatnonzero(whole)[-1])


def chosen_times(fields: Data, end: float) -> dict[int, str]:
    """Return the snapshots that tell most of a contact, in their order, each with the reason; at most four.

    Snapshots that are nearly one count once, as what stands first in this list: largest force, release, half of the
    contact, end, first touch, start. A last snapshot before the `end` of the run is not called its end.
    """
    last = last_whole(fields)
    force = np.zeros(last + 1)
    if "contact_pressure" in fields:
        force = np.nan_to_num(np.abs(fields["contact_pressure"][: last + 1]) @ fields["point_area"])
    wanted = [(last, "end" if fields["time"][last] > (1.0 - 1e-9) * end else "last snapshot"), (0, "start")]
    pressed = np.flatnonzero(force)
    if pressed.size:
        first, after = int(pressed[0]), int(pressed[-1]) + 1
        released = [(after, "release")] if after <= last else []
        half = (first + min(after, last)) // 2
        wanted = [(int(force.argmax()), "largest force"), *released, (half, "half of the contact"), wanted[0]]
        wanted += [(first, "first touch"), (0, "start")]
    else:
        wanted += [(last // 3, ""), (2 * last // 3, "")]
    chosen: dict[int, str] = {}
    for snapshot, why in wanted:
        if all(abs(snapshot - other) > APART * last for other in chosen) and len(chosen) < MOST_PICTURES:
            chosen[snapshot] = why
    return dict(sorted(chosen.items()))


def stress_of_cells(fields: Data) -> tuple[str, Floats]:
    """Return label and values of the stress that colours the cells, (snapshots, cells).

    It is that of von Mises, or the largest shear in the plane where a material does not say the stress across it.
    """
    if np.isfinite(fields["von_mises"]).any():
        return QUANTITIES["von_mises"].label, fields["von_mises"]
    xx, yy, xy = np.moveaxis(fields["stress"], -1, 0)  # in two dimensions: in three there is nothing across
    return "largest shear stress in the plane", np.hypot(0.5 * (xx - yy), xy)


class Scene(NamedTuple):
    """What all pictures of the solids of a result share: view, walls, and the scales of colours and arrows.

    Attributes
    ----------
    fields
        Fields of the result.
    label
        Name of the stress that colours the cells.
    stress
        This stress, (snapshots, cells).
    limit, extend
        Stress of the darkest colour, and whether single cells have more, as `percuss.reporting.figures.colour_limit`
        finds them for the snapshots of `chosen_times`.
    pressure
        Largest contact pressure among the snapshots that are shown, 0 without one.
    faces
        The faces of cells that may be seen.
    low, high
        Corners of the view on the page.
    arrow
        Length of the longest arrow.
    walls
        The walls at rest.
    moving
        The walls that move, each with its displacements in the snapshots.
    """

    fields: Data
    label: str
    stress: Floats
    limit: float
    extend: str
    pressure: float
    faces: Faces
    low: Floats
    high: Floats
    arrow: float
    walls: Sequence[WallShape]
    moving: Sequence[tuple[WallShape, Floats]]


def scene_of(result: Result, snapshots: Sequence[int]) -> Scene:
    """Return what the pictures of snapshots share; the scale of colours is that of `chosen_times`."""
    fields: Any = result.field_arrays
    label, stress = stress_of_cells(fields)
    limit, extend = figures.colour_limit(stress[list(chosen_times(fields, result.end))])
    faces = Faces.of(np.asarray(fields["cell_nodes"]), fields["node_position"].shape[1])
    nodes = fields["node_position"] + fields["displacement"][snapshots]
    places = on_page(nodes.reshape(-1, nodes.shape[-1]))
    sides, largest = np.ptp(places, axis=0), 0.0
    arrow, margin = LONGEST * float(np.sqrt(sides.prod())), 0.03 * float(sides.max())
    if "contact_pressure" in fields:
        pressure = np.nan_to_num(np.abs(fields["contact_pressure"][snapshots]))
        largest = float(pressure.max(initial=0.0))
        along = fields["point_normal"]
        if "point_traction" in fields and largest > 0.0:
            along = -fields["point_traction"][snapshots] / largest
        tails = (fields["point_position"][snapshots] + arrow * along)[pressure > 0.0]
        places = np.concatenate([places, on_page(tails)])
    low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
    geometry = result.provenance["geometry"]
    walls = {name: WallShape.of_entries(entries) for name, entries in geometry.get("walls", {}).items()}
    moves = geometry.get("wall_displacements", {})
    still = [wall for name, wall in walls.items() if name not in moves]
    moving = [(walls[name], np.array(displacements)) for name, displacements in moves.items()]
    return Scene(fields, label, stress, limit, extend, largest, faces, low, high, arrow, still, moving)


def still_parts(axes: Axes, scene: Scene) -> None:
    """Draw the walls, and set the view of a panel of solids."""
    draw_walls(axes, scene.walls, scene.fields["node_position"])
    axes.set(xlim=(scene.low[0], scene.high[0]), ylim=(scene.low[1], scene.high[1]), aspect="equal")
    axes.grid(visible=False)
    axes.tick_params(labelsize=8, colors=figures.SOFT)
    if scene.fields["node_position"].shape[1] == 3:
        axes.set_axis_off()  # the page has no coordinates of its own


def moving_parts(axes: Axes, scene: Scene, snapshot: int) -> list[Artist]:
    """Draw solids and contact pressures at a snapshot, and return what was drawn."""
    from matplotlib import colormaps
    from matplotlib.patheffects import withStroke

    nodes = scene.fields["node_position"] + scene.fields["displacement"][snapshot]
    seen = scene.faces.seen(nodes)
    shares = np.ma.masked_invalid(scene.stress[snapshot, scene.faces.cell[seen]] / scene.limit)
    colours = colormaps[COLOUR_MAP](shares)
    cells = Part(nodes[scene.faces.corners[seen]], colours, colours if len(colours) > MOST_EDGES else "#00000055", 0.15)
    lines = Part(scene.faces.outline(nodes), edge=figures.INK, width=0.8, nearer=0.05 * scene.arrow)
    walls = (wall.moved(displacements[snapshot]) for wall, displacements in scene.moving)
    drawn = [*draw_walls(axes, walls, scene.fields["node_position"]), draw(axes, [cells, lines])]
    pressure = scene.fields["contact_pressure"][snapshot] if scene.pressure > 0.0 else np.zeros(0)
    pressed = np.argsort(-np.nan_to_num(np.abs(pressure)), kind="stable")  # the longest arrow is drawn in any case
    pressed = pressed[np.nan_to_num(np.abs(pressure[pressed])) > LEAST * scene.pressure]
    if pressed.size:
        places = scene.fields["point_position"][snapshot][pressed]
        some = spread(places, SPACE * scene.arrow)
        push = -(pressure[pressed] / scene.pressure)[:, None] * scene.fields["point_normal"][pressed]
        colour: Any = figures.ALARM
        if "point_traction" in scene.fields:
            push = scene.fields["point_traction"][snapshot][pressed] / scene.pressure
            sticks = scene.fields["point_status"][snapshot][pressed[some]] == STICKS
            colour = [figures.CALM if one else figures.ALARM for one in sticks]
        arrow = Part(arrows(places[some], scene.arrow * push[some], 0.05 * scene.arrow), colour)
        outline = [withStroke(linewidth=2.0, foreground="white")]
        drawn.append(draw(axes, [arrow], zorder=4, path_effects=outline))
    return drawn


def write_names(axes: Axes, fields: Data, snapshot: int) -> list[Artist]:
    """Write the names of the bodies, if there are two or more, into their middles at a snapshot."""
    owner = np.array(fields["node_body"], dtype=object)
    nodes = fields["node_position"] + fields["displacement"][snapshot]
    style: Any = {"ha": "center", "va": "center", "size": 9, "bbox": {**figures.PAPER, "alpha": 0.7}}
    texts: list[Artist] = []
    for name in dict.fromkeys(owner) if len(set(owner)) > 1 else ():
        x, y = on_page(nodes[owner == name].mean(axis=0))
        texts.append(axes.text(x, y, figures.one_line(name), **style))
    return texts


def colour_bar(figure: Figure, panels: Sequence[Axes], scene: Scene, units: Data) -> None:
    """Add the colour bar of the stress below panels, which also says how long an arrow is."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    extend = "max" if scene.extend == "both" else "neither"
    colours = ScalarMappable(Normalize(0.0, scene.limit), COLOUR_MAP)
    bar = figure.colorbar(colours, ax=panels, location="bottom", aspect=45, pad=0.02, extend=extend, panchor=False)
    bar.ax.set_xlabel(with_unit(scene.label, figures.STRESS[1], units))
    if scene.pressure > 0.0:
        words = f"longest arrow: contact pressure {figures.number(scene.pressure)}"
        if "point_traction" in scene.fields:
            words = f"arrows: tractions, red where a point slides, blue where it sticks\n{words}"
        bar.ax.set_title(with_unit(words, figures.STRESS[1], units), loc="right", size=9.5, color=figures.ALARM)
    if np.isnan(scene.stress).all():
        figures.write_reason(panels[0], "No element calls the stress of its material.")


def deformed(figure: Figure, place: SubplotSpec, result: Result) -> None:
    """Draw the bodies of a result at chosen times, in their true motion and on one scale, with one colour bar."""
    fields: Any = result.field_arrays
    chosen = chosen_times(fields, result.end)
    scene = scene_of(result, list(chosen))
    count, (width, height) = len(chosen), scene.high - scene.low
    # Of these arrangements the one whose pictures become largest in a panel, about a square.
    choices = [(count, 1), (-(-count // 2), 2), (1, count)]
    rows, columns = max(choices, key=lambda choice: min(1.0 / choice[1] / width, 1.05 / choice[0] / height))
    grid = place.subgridspec(rows, columns, hspace=0.05, wspace=0.05)
    panels = [figure.add_subplot(grid[divmod(k, columns)]) for k in range(count)]
    for axes, (snapshot, why) in zip(panels, chosen.items(), strict=True):
        moving_parts(axes, scene, snapshot)
        still_parts(axes, scene)
        axes.label_outer()
        time = with_unit(f"time {figures.number(float(fields['time'][snapshot]))}", "time", result.units)
        between = "  ·  " if columns == 1 else "\n"  # a narrow picture has a narrow title
        axes.set_title(between.join(filter(None, [time, why])), loc="left", size=9.5)
    write_names(panels[-1], fields, list(chosen)[-1])
    colour_bar(figure, panels, scene, result.units)
