"""Panels of deformed bodies at chosen times: stress of the cells, contact pressures as arrows, walls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.case.quantities import QUANTITIES, with_unit
from percuss.jsonable import Data
from percuss.reporting.figures import ALARM, INK, PAPER, SOFT, STRESS, number, one_line, write_reason
from percuss.reporting.views import Faces, draw_walls, on_page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

    from percuss.methods.interfaces import Floats
    from percuss.results.result import Result

COLOUR_MAP = "YlGnBu"  # it differs in lightness alone for readers who see no colours, and is pale where nothing happens
MOST_PICTURES, APART = 4, 0.04  # of the time of the run between two pictures
MOST_MOTION = 5.0  # of a snapshot that is shown, over the size of all bodies; an unstable run moves more
LONGEST = 0.22  # arrow, over the geometric mean of the sides of the picture
LEAST = 0.04  # pressure that has an arrow, over the largest
MOST_ARROWS, MOST_EDGES = 30, 3000


def last_whole(fields: Data) -> int:
    """Return the last snapshot in which no body has left the picture, as those of an unstable run do."""
    size = np.ptp(fields["node_position"], axis=0).max()
    whole = (np.abs(fields["displacement"]) < MOST_MOTION * size).all(axis=(1, 2))
    return int(np.flatnonzero(whole)[-1])


def chosen_times(fields: Data) -> dict[int, str]:
    """Return the snapshots that tell most of a contact, in their order, each with the reason; at most four.

    Snapshots that are nearly one count once, as what stands first in this list: largest force, release, half of the
    contact, end, first touch, start.
    """
    last = last_whole(fields)
    force = np.zeros(last + 1)
    if "contact_pressure" in fields:
        force = np.nan_to_num(np.abs(fields["contact_pressure"][: last + 1]) @ fields["point_area"])
    wanted = [(last, "end"), (0, "start")]
    pressed = np.flatnonzero(force)
    if pressed.size:
        first, after = int(pressed[0]), int(pressed[-1]) + 1
        released = [(after, "release")] if after <= last else []
        half = (first + min(after, last)) // 2
        wanted = [(int(force.argmax()), "largest force"), *released, (half, "half of the contact"), (last, "end")]
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
    """What all pictures of the bodies of a result share: view, walls, and the scales of colours and arrows.

    Attributes
    ----------
    fields
        Fields of the result.
    label
        Name of the stress that colours the cells.
    stress
        This stress, (snapshots, cells).
    limit
        Stress of the darkest colour; single cells may have more.
    largest
        Largest stress among the snapshots of `chosen_times`, nan where no cell has one.
    pressure
        Largest contact pressure among the snapshots that are shown, 0 without one.
    faces
        The faces of cells that may be seen.
    low, high
        Corners of the view on the page.
    arrow
        Length of the longest arrow.
    walls
        Point and normal of each wall.
    """

    fields: Data
    label: str
    stress: Floats
    limit: float
    largest: float
    pressure: float
    faces: Faces
    low: Floats
    high: Floats
    arrow: float
    walls: Data


def scene_of(result: Result, snapshots: Sequence[int]) -> Scene:
    """Return what the pictures of snapshots share; the scale of colours is that of `chosen_times`."""
    fields: Any = result.field_arrays
    label, stress = stress_of_cells(fields)
    chosen = stress[list(chosen_times(fields))]
    finite = chosen[np.isfinite(chosen)]
    largest = float(finite.max(initial=0.0))
    limit = float(np.percentile(finite, 99.5)) if finite.size else 0.0
    limit = limit if limit > 1e-3 * largest else largest or 1.0
    pressure = np.abs(fields["contact_pressure"][snapshots]).max() if "contact_pressure" in fields else 0.0
    walls = result.provenance["geometry"].get("walls", {})
    low, high, arrow = _view(fields, snapshots, walls)
    largest = largest if finite.size else np.nan
    faces = Faces.of(np.asarray(fields["cell_nodes"]), fields["node_position"].shape[1])
    return Scene(fields, label, stress, limit, largest, float(pressure), faces, low, high, arrow, walls)


def still_parts(axes: Axes, scene: Scene) -> None:
    """Draw the walls, and set the view of a panel of bodies."""
    places = scene.fields["node_position"]
    draw_walls(axes, scene.walls, 0.5 * (places.min(axis=0) + places.max(axis=0)), float(np.ptp(places, axis=0).max()))
    axes.set(xlim=(scene.low[0], scene.high[0]), ylim=(scene.low[1], scene.high[1]), aspect="equal")
    axes.grid(visible=False)
    axes.tick_params(labelsize=8, colors=SOFT)


def moving_parts(axes: Axes, scene: Scene, snapshot: int) -> list[Artist]:
    """Draw bodies and contact pressures at a snapshot, and return what was drawn."""
    fields = scene.fields
    nodes = fields["node_position"] + fields["displacement"][snapshot]
    drawn = _bodies(axes, scene.faces, nodes, scene.stress[snapshot], scene.limit)
    return [*drawn, *(_arrows(axes, scene, snapshot) if scene.pressure > 0.0 else [])]


def colour_bar(figure: Figure, panels: Sequence[Axes], scene: Scene, units: Data) -> None:
    """Add the colour bar of the stress below panels, which also says how long an arrow is."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    extend = "max" if scene.largest > 1.001 * scene.limit else "neither"
    colours = ScalarMappable(Normalize(0.0, scene.limit), COLOUR_MAP)
    bar = figure.colorbar(colours, ax=panels, location="bottom", aspect=45, pad=0.02, extend=extend)
    bar.ax.set_xlabel(with_unit(scene.label, STRESS[1], units))
    if scene.pressure > 0.0:
        words = with_unit(f"longest arrow: contact pressure {number(scene.pressure)}", STRESS[1], units)
        bar.ax.set_title(words, loc="right", size=9.5, color=ALARM)
    if np.isnan(scene.largest):
        write_reason(panels[0], "No element calls the stress of its material.")


def deformed(figure: Figure, place: SubplotSpec, result: Result) -> None:
    """Draw the bodies of a result at chosen times, in their true motion and on one scale, with one colour bar."""
    fields: Any = result.field_arrays
    chosen = chosen_times(fields)
    scene = scene_of(result, list(chosen))
    rows, columns = _arrangement(len(chosen), *(scene.high - scene.low))
    grid = place.subgridspec(rows, columns, hspace=0.05, wspace=0.05)
    panels = [figure.add_subplot(grid[divmod(k, columns)]) for k in range(len(chosen))]
    for axes, (snapshot, why) in zip(panels, chosen.items(), strict=True):
        moving_parts(axes, scene, snapshot)
        still_parts(axes, scene)
        axes.label_outer()
        time = with_unit(f"time {number(float(fields['time'][snapshot]))}", "time", result.units)
        between = "  ·  " if columns == 1 else "\n"  # a narrow picture has a narrow title
        axes.set_title(between.join(filter(None, [time, why])), loc="left", size=9.5)
    names_in_bodies(panels[-1], fields, list(chosen)[-1])
    colour_bar(figure, panels, scene, result.units)


def _view(fields: Data, snapshots: Sequence[int], walls: Data) -> tuple[Floats, Floats, float]:
    """Return the corners of the picture that shows nodes at all snapshots, and the length of the longest arrow."""
    nodes = fields["node_position"] + fields["displacement"][snapshots]
    places = on_page(nodes.reshape(-1, nodes.shape[-1]))
    low, high = places.min(axis=0), places.max(axis=0)
    arrow = LONGEST * float(np.sqrt((high - low).prod()))
    margin = 0.03 * float((high - low).max())
    tails = [places]
    if walls and "contact_pressure" in fields:
        pressed = np.abs(fields["contact_pressure"][snapshots]) > 0.0
        tails.append(on_page(fields["point_position"][snapshots] + arrow * fields["point_normal"])[pressed])
    reach = np.concatenate([places, *tails])
    return reach.min(axis=0) - margin, reach.max(axis=0) + margin, arrow


def _arrangement(count: int, width: float, height: float) -> tuple[int, int]:
    """Return the rows and columns of pictures of a given shape that become largest in a panel, about a square."""
    choices = [(count, 1), (-(-count // 2), 2), (1, count)]
    return max(choices, key=lambda choice: min(1.0 / choice[1] / width, 1.05 / choice[0] / height))


def _bodies(axes: Axes, faces: Faces, nodes: Floats, stress: Floats, limit: float) -> list[Artist]:
    """Draw cells in the colours of their stress, and the outline of the bodies."""
    from matplotlib.collections import LineCollection, PolyCollection

    seen, page = faces.seen(nodes), on_page(nodes)
    style: Any = {"linewidths": 0.15, "edgecolors": "#00000055"} if seen.size <= MOST_EDGES else {"edgecolors": "face"}
    drawn = PolyCollection(faces.polygons(seen, nodes), cmap=COLOUR_MAP, rasterized=True, **style)
    drawn.set_array(np.ma.masked_invalid(stress[faces.cell[seen]]))
    drawn.set_clim(0.0, limit)
    lines = LineCollection(list(page[faces.edges(nodes)]), colors=INK, linewidths=0.8)
    return [axes.add_collection(drawn), axes.add_collection(lines)]


def _arrows(axes: Axes, scene: Scene, snapshot: int) -> list[Artist]:
    """Draw the contact pressures on the first side of each contact as arrows that point into the body."""
    from matplotlib.patheffects import Normal, Stroke

    fields, pressure = scene.fields, scene.fields["contact_pressure"][snapshot]
    pressed = np.flatnonzero(np.abs(np.nan_to_num(pressure)) > LEAST * scene.pressure)
    pressed = pressed[:: max(1, -(-pressed.size // MOST_ARROWS))]
    if not pressed.size:
        return []
    push = -(scene.arrow / scene.pressure * pressure[pressed])[:, None] * fields["point_normal"][pressed]
    push, places = on_page(push), on_page(fields["point_position"][snapshot][pressed])
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "pivot": "tip", "units": "inches", "zorder": 4}
    style["width"] = 0.016 if fields["node_position"].shape[1] == 2 else 0.008  # of a face there are more than of edges
    outlined = [Stroke(linewidth=1.6, foreground="white"), Normal()]
    return [axes.quiver(*places.T, *push.T, color=ALARM, path_effects=outlined, **style)]


def names_in_bodies(axes: Axes, fields: Data, snapshot: int) -> list[Artist]:
    """Write the names of the bodies, if there are two or more, into their middles at a snapshot."""
    owner = np.array(fields["node_body"], dtype=object)
    nodes = fields["node_position"] + fields["displacement"][snapshot]
    style: Any = {"ha": "center", "va": "center", "size": 9, "bbox": {**PAPER, "alpha": 0.7}}
    texts: list[Artist] = []
    for name in dict.fromkeys(owner) if len(set(owner)) > 1 else ():
        x, y = on_page(nodes[owner == name].mean(axis=0))
        texts.append(axes.text(x, y, one_line(name), **style))
    return texts
