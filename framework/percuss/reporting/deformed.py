"""Panels of deformed bodies at chosen times: stress of the cells, contact pressures as arrows, walls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import QUANTITIES, with_unit
from percuss.jsonable import Data
from percuss.reporting.figures import ALARM, FAINT, INK, PAPER, SOFT, STRESS, number, one_line, write_reason

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

    from percuss.methods.interfaces import Floats, Integers
    from percuss.results.result import Result

COLOUR_MAP = "YlGnBu"  # it differs in lightness alone for readers who see no colours, and is pale where nothing happens
MOST_PICTURES, APART = 4, 0.04  # of the time of the run between two pictures
MOST_MOTION = 5.0  # of a snapshot that is shown, over the size of all bodies; an unstable run moves more
LONGEST = 0.22  # arrow, over the geometric mean of the sides of the picture
LEAST = 0.04  # pressure that has an arrow, over the largest
MOST_ARROWS, MOST_EDGES = 30, 3000


def chosen_times(fields: Data) -> dict[int, str]:
    """Return the snapshots that tell most of a contact, in their order, each with the reason; at most four.

    Snapshots that are nearly one count once, as what stands first in this list: largest force, release, half of the
    contact, end, first touch, start.
    """
    size = np.ptp(fields["node_position"], axis=0).max()
    whole = (np.abs(fields["displacement"]) < MOST_MOTION * size).all(axis=(1, 2))
    last = int(np.flatnonzero(whole)[-1])
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
    xx, yy, xy = np.moveaxis(fields["stress"], -1, 0)
    return "largest shear stress in the plane", np.hypot(0.5 * (xx - yy), xy)


def outline(cells: Integers) -> Integers:
    """Return the edges of cells that belong to one of them alone, (edges, 2) nodes."""
    edges = []
    for corners in np.unique((cells >= 0).sum(axis=1)):
        own = cells[(cells >= 0).sum(axis=1) == corners, :corners]
        edges.append(np.stack([own, np.roll(own, -1, axis=1)], axis=-1).reshape(-1, 2))
    every = np.concatenate(edges)
    _, first, count = np.unique(np.sort(every, axis=1), axis=0, return_index=True, return_counts=True)
    alone: Integers = every[first[count == 1]]
    return alone


def deformed(figure: Figure, place: SubplotSpec, result: Result) -> None:
    """Draw the bodies of a result at chosen times, in their true motion and on one scale, with one colour bar."""
    fields: Any = result.field_arrays
    chosen = chosen_times(fields)
    label, stress = stress_of_cells(fields)
    shown = stress[list(chosen)]
    finite = shown[np.isfinite(shown)]
    largest = float(finite.max(initial=0.0))
    limit = float(np.percentile(finite, 99.5)) if finite.size else 0.0
    limit = limit if limit > 1e-3 * largest else largest or 1.0
    nodes = {k: fields["node_position"] + fields["displacement"][k] for k in chosen}
    walls = result.provenance["geometry"].get("walls", {})
    low, high, arrow = _view(fields, nodes, walls)
    pressure = np.abs(fields["contact_pressure"][list(chosen)]).max() if "contact_pressure" in fields else 0.0
    rows, columns = _arrangement(len(chosen), *(high - low))
    grid = place.subgridspec(rows, columns, hspace=0.05, wspace=0.05)
    panels = [figure.add_subplot(grid[divmod(k, columns)]) for k in range(len(chosen))]
    for axes, (snapshot, why) in zip(panels, chosen.items(), strict=True):
        drawn = _bodies(axes, fields["cell_nodes"], nodes[snapshot], stress[snapshot], limit)
        draw_walls(axes, walls, low, high)
        if pressure > 0.0:
            _arrows(axes, fields, snapshot, float(pressure), arrow)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.grid(visible=False)
        axes.tick_params(labelsize=8, colors=SOFT)
        axes.label_outer()
        time = with_unit(f"time {number(float(fields['time'][snapshot]))}", "time", result.units)
        between = "  ·  " if columns < 3 else "\n"  # a narrow picture has a narrow title
        axes.set_title(between.join(filter(None, [time, why])), loc="left", size=9.5)
    _names(panels[-1], fields, list(nodes.values())[-1])
    extend = "max" if largest > 1.001 * limit else "neither"
    bar = figure.colorbar(drawn, ax=panels, location="bottom", aspect=45, pad=0.02, extend=extend)
    bar.ax.set_xlabel(with_unit(label, STRESS[1], result.units))
    if pressure > 0.0:
        words = with_unit(f"longest arrow: contact pressure {number(float(pressure))}", STRESS[1], result.units)
        bar.ax.set_title(words, loc="right", size=9.5, color=ALARM)
    if np.isnan(finite).all():
        write_reason(panels[0], "No element calls the stress of its material.")


def _view(fields: Data, nodes: Mapping[int, Floats], walls: Data) -> tuple[Floats, Floats, float]:
    """Return the corners of the picture that shows nodes at all chosen times, and the length of the longest arrow."""
    places = np.concatenate(list(nodes.values()))
    low, high = places.min(axis=0), places.max(axis=0)
    arrow = LONGEST * float(np.sqrt((high - low).prod()))
    margin = 0.03 * float((high - low).max())
    tails = [fields["point_position"][k] + arrow * fields["point_normal"] for k in nodes] if walls else [places]
    if walls:
        pressed = [np.abs(fields["contact_pressure"][k]) > 0.0 for k in nodes]
        tails = [tail[mask] for tail, mask in zip(tails, pressed, strict=True)]
    reach = np.concatenate([places, *tails])
    return reach.min(axis=0) - margin, reach.max(axis=0) + margin, arrow


def _arrangement(count: int, width: float, height: float) -> tuple[int, int]:
    """Return the rows and columns of pictures of a given shape that become largest in a panel, about a square."""
    choices = [(count, 1), (-(-count // 2), 2), (1, count)]
    return max(choices, key=lambda choice: min(1.0 / choice[1] / width, 1.05 / choice[0] / height))


def _bodies(axes: Axes, cells: Integers, nodes: Floats, stress: Floats, limit: float) -> Any:
    """Draw cells in the colours of their stress, and the outline of the bodies."""
    from matplotlib.collections import LineCollection, PolyCollection

    corners = [nodes[cell[cell >= 0]] for cell in cells]
    style: Any = {"linewidths": 0.15, "edgecolors": "#00000055"} if len(cells) <= MOST_EDGES else {"edgecolors": "face"}
    drawn = PolyCollection(corners, cmap=COLOUR_MAP, rasterized=True, **style)
    drawn.set_array(np.ma.masked_invalid(stress))
    drawn.set_clim(0.0, limit)
    axes.add_collection(drawn)
    axes.add_collection(LineCollection(list(nodes[outline(cells)]), colors=INK, linewidths=0.8))
    return drawn


def draw_walls(axes: Axes, walls: Data, low: Floats, high: Floats) -> None:
    """Draw each wall as a line with hatches on its far side."""
    size = float(np.linalg.norm(high - low))
    for point, normal in walls.values():
        middle, out = np.asarray(point, dtype=float), np.asarray(normal, dtype=float)
        along = np.array([-out[1], out[0]])
        middle = middle + along * float(along @ (0.5 * (low + high) - middle))
        ends = np.array([middle - size * along, middle + size * along])
        far = ends[::-1] - 0.035 * size * out
        axes.fill(*np.concatenate([ends, far]).T, facecolor="#f3f3f3", edgecolor=FAINT, hatch="////", linewidth=0)
        axes.plot(*ends.T, color=INK, linewidth=1.2)


def _arrows(axes: Axes, fields: Data, snapshot: int, largest: float, length: float) -> None:
    """Draw the contact pressures on the first side of each contact as arrows that point into the body."""
    from matplotlib.patheffects import Normal, Stroke

    pressure = fields["contact_pressure"][snapshot]
    pressed = np.flatnonzero(np.abs(np.nan_to_num(pressure)) > LEAST * largest)
    pressed = pressed[:: max(1, -(-pressed.size // MOST_ARROWS))]
    if not pressed.size:
        return
    push = -(length / largest * pressure[pressed])[:, None] * fields["point_normal"][pressed]
    places = fields["point_position"][snapshot][pressed]
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "pivot": "tip", "units": "inches", "zorder": 4}
    outlined = [Stroke(linewidth=1.6, foreground="white"), Normal()]
    axes.quiver(*places.T, *push.T, color=ALARM, width=0.016, path_effects=outlined, **style)


def _names(axes: Axes, fields: Data, nodes: Floats) -> None:
    """Write the names of the bodies into a picture, the last, where arrows are fewest."""
    owner = np.array(fields["node_body"], dtype=object)
    for name in dict.fromkeys(owner) if len(set(owner)) > 1 else ():
        x, y = nodes[owner == name].mean(axis=0)
        axes.text(x, y, one_line(name), ha="center", va="center", size=9, bbox={**PAPER, "alpha": 0.7})
