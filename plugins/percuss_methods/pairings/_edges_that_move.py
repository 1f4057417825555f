"""Dual mortar between edges at the time t_n: the kernel that finds what each node of the first surface meets.

The integrals are those of the dual mortar at the start (`percuss_methods.pairings.mortar`), in closed form. On a piece
of an edge all functions are linear along it: over a piece of the area A, as a part of the edge l long, the integral of
two of them is ``A (f g + f' g' l^2 / 12)``, with f and g in its middle. The functions psi of an edge follow from the
area A, the centre c and the mean square r^2 about it of what is covered, with s along the edge: psi_j is
``D_j (1 + (s_j - c) (s - c) / r^2) / A``, where ``D_1 = A (1 - c)``, ``D_2 = A c``, and s_j is 0 or 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss_methods.pairings._closest import AT_AN_END

if TYPE_CHECKING:
    from percuss import FacingSurfaces, Floats, Integers, RenewedPoints

FACING = 0.5  # least cosine of the angle by which edges that meet may be turned from facing each other
# What is kept of each edge of the first surface. Of the edges of the second one that lie over it, in the order in which
# they are found: number, and where their ends project to. Of its pieces: which of these covers it, start and stop. And
# in the last row: how many pieces there are, c, r^2.
EDGE, BEGINS, ENDS, OVER, START, STOP = range(6)
PIECES, CENTRE, SPREAD = range(3)
# What is kept of each point: its mean gap times its area, the least gap at the corners of its pieces, and whether it
# meets more nodes than there is room for.
MEAN, LEAST, CROWDED = range(3)


def renew(surfaces: FacingSurfaces, points: RenewedPoints) -> None:
    """Write the points at the nodes of a first surface of edges."""
    for j in range(points.gap.size):
        points.area[j], points.meets[j] = 0.0, 0
        points.normal[j, 0], points.normal[j, 1] = 0.0, 0.0
        points.of_points[j, MEAN], points.of_points[j, LEAST], points.of_points[j, CROWDED] = 0.0, np.inf, 0.0
    for e in range(surfaces.area.size):
        cut(surfaces, points, e, edges_over(surfaces, points, e))
        cover(surfaces, points, e)
    for j in range(points.gap.size):
        if points.area[j] > 0.0:
            length = np.sqrt(points.normal[j, 0] * points.normal[j, 0] + points.normal[j, 1] * points.normal[j, 1])
            points.normal[j, 0] /= length
            points.normal[j, 1] /= length
    for e in range(surfaces.area.size):
        kept = points.of_facets[e]
        for k in range(int(kept[-1, PIECES])):
            meet(surfaces, points, e, k)
    for j in range(points.gap.size):
        if points.area[j] > 0.0:
            for k in range(points.meets[j]):
                points.share[j, k] /= points.area[j]
            points.gap[j] = max(points.of_points[j, MEAN] / points.area[j], points.of_points[j, LEAST])
            if points.of_points[j, CROWDED] == 1.0:
                points.gap[j] = np.nan


def edges_over(surfaces: FacingSurfaces, points: RenewedPoints, e: int) -> int:
    """Keep the edges of the second surface that face an edge of the first one and project onto it; return how many."""
    at, kept, count = surfaces.at, points.of_facets[e], 0
    p, q = surfaces.first[e, 0], surfaces.first[e, 1]
    x, y = at[p, 0], at[p, 1]
    along_x, along_y = at[q, 0] - x, at[q, 1] - y
    square = along_x * along_x + along_y * along_y
    for g in range(len(surfaces.low)):
        middle = 0.5 * (surfaces.low[g, 0] + surfaces.high[g, 0] - 2.0 * x) * along_x
        middle += 0.5 * (surfaces.low[g, 1] + surfaces.high[g, 1] - 2.0 * y) * along_y
        half = 0.5 * (surfaces.high[g, 0] - surfaces.low[g, 0]) * abs(along_x)
        half += 0.5 * (surfaces.high[g, 1] - surfaces.low[g, 1]) * abs(along_y)
        if middle + half <= 0.0 or middle - half >= square:
            continue
        for f in range(g * surfaces.group, min((g + 1) * surfaces.group, len(surfaces.second))):
            p, q = surfaces.second[f, 0], surfaces.second[f, 1]
            begins = ((at[p, 0] - x) * along_x + (at[p, 1] - y) * along_y) / square
            ends = ((at[q, 0] - x) * along_x + (at[q, 1] - y) * along_y) / square
            length = np.sqrt((at[q, 0] - at[p, 0]) ** 2 + (at[q, 1] - at[p, 1]) ** 2)
            faces = (begins - ends) * np.sqrt(square) >= FACING * length
            if faces and begins > 0.0 and ends < 1.0 and count < len(kept) - 1:
                kept[count, EDGE], kept[count, BEGINS], kept[count, ENDS] = f, begins, ends
                count += 1
    return count


def cut(surfaces: FacingSurfaces, points: RenewedPoints, e: int, count: int) -> None:
    """Keep the pieces into which the ends of the edges over an edge cut it, each with the nearest edge over it."""
    kept, start, pieces = points.of_facets[e], 0.0, 0
    while start < 1.0 and pieces < len(kept) - 1:
        stop = 1.0
        for c in range(count):
            if kept[c, BEGINS] > start + AT_AN_END:
                stop = min(stop, kept[c, BEGINS])
            if kept[c, ENDS] > start + AT_AN_END:
                stop = min(stop, kept[c, ENDS])
        if stop > 1.0 - AT_AN_END:
            stop = 1.0
        middle, nearest, least = 0.5 * (start + stop), -1, np.inf
        for c in range(count):
            if kept[c, ENDS] <= middle <= kept[c, BEGINS]:
                across = apart(surfaces, points, e, c, middle, 0) * outward(surfaces.at, surfaces.first[e], 0)
                across += apart(surfaces, points, e, c, middle, 1) * outward(surfaces.at, surfaces.first[e], 1)
                # The far side of a closed body is behind the edge, too, by more than the body can overlap.
                if across > -surfaces.reach and abs(across) < least:
                    nearest, least = c, abs(across)
        if nearest >= 0:
            kept[pieces, OVER], kept[pieces, START], kept[pieces, STOP] = nearest, start, stop
            pieces += 1
        start = stop
    kept[-1, PIECES] = pieces


def cover(surfaces: FacingSurfaces, points: RenewedPoints, e: int) -> None:
    """Find area, centre and spread of what is covered of an edge; add them to areas and normals of its nodes."""
    kept = points.of_facets[e]
    first, second = surfaces.points[e, 0], surfaces.points[e, 1]
    whole, centre, spread = 0.0, 0.0, 0.0
    for k in range(int(kept[-1, PIECES])):
        length, middle = kept[k, STOP] - kept[k, START], 0.5 * (kept[k, START] + kept[k, STOP])
        area, other = surfaces.area[e] * length, surfaces.second[over(kept, k)]
        whole += length
        centre += length * middle
        for d in range(2):
            into = -outward(surfaces.at, other, d)
            points.normal[first, d] += area * (1.0 - middle) * into
            points.normal[second, d] += area * middle * into
    if whole == 0.0:
        return
    centre /= whole
    for k in range(int(kept[-1, PIECES])):
        length, off = kept[k, STOP] - kept[k, START], 0.5 * (kept[k, START] + kept[k, STOP]) - centre
        spread += length * (off * off + length * length / 12.0) / whole
    kept[-1, CENTRE], kept[-1, SPREAD] = centre, spread
    points.area[first] += surfaces.area[e] * whole * (1.0 - centre)
    points.area[second] += surfaces.area[e] * whole * centre


def meet(surfaces: FacingSurfaces, points: RenewedPoints, e: int, k: int) -> None:
    """Add what a piece of an edge has in the gaps of its nodes, and in the shares of the nodes over it."""
    kept, c = points.of_facets[e], int(points.of_facets[e, k, OVER])
    start, stop, begins, ends = kept[k, START], kept[k, STOP], kept[c, BEGINS], kept[c, ENDS]
    length, middle, f = stop - start, 0.5 * (start + stop), int(kept[c, EDGE])
    area = surfaces.area[e] * length
    for a in range(2):
        j = surfaces.points[e, a]
        centre = kept[-1, CENTRE]
        own = centre if a == 1 else 1.0 - centre
        slope = own * (a - centre) / kept[-1, SPREAD]
        dual = own + slope * (middle - centre)
        at_start, at_stop = 0.0, 0.0
        for d in range(2):
            normal = points.normal[j, d]
            at_start += normal * apart(surfaces, points, e, c, start, d)
            at_stop += normal * apart(surfaces, points, e, c, stop, d)
        mean = dual * 0.5 * (at_start + at_stop) + slope * (at_stop - at_start) * length / 12.0
        points.of_points[j, MEAN] += area * mean
        points.of_points[j, LEAST] = min(points.of_points[j, LEAST], at_start, at_stop)
        rise = 1.0 / (ends - begins)
        far = dual * (middle - begins) * rise + slope * rise * length * length / 12.0
        add_share(points, j, surfaces.second[f, 0], area * (dual - far))
        add_share(points, j, surfaces.second[f, 1], area * far)


def over(kept: Floats, k: int) -> int:
    """Return the number of the edge of the second surface that lies over a piece."""
    return int(kept[int(kept[k, OVER]), EDGE])


def add_share(points: RenewedPoints, j: int, node: int, share: float) -> None:
    """Add to the share of a node of the second surface in the gap of a point."""
    for k in range(points.meets[j]):
        if points.node[j, k] == node:
            points.share[j, k] += share
            return
    k = points.meets[j]
    if k == points.node.shape[1]:
        points.of_points[j, CROWDED] = 1.0  # its gap is no number, and the run ends
        return
    points.node[j, k], points.share[j, k], points.meets[j] = node, share, k + 1


def apart(surfaces: FacingSurfaces, points: RenewedPoints, e: int, c: int, s: float, d: int) -> float:
    """Return a component of the vector from a place of an edge to the edge that lies over it there."""
    at, kept = surfaces.at, points.of_facets[e]
    p, q, other = surfaces.first[e, 0], surfaces.first[e, 1], surfaces.second[int(kept[c, EDGE])]
    t = (s - kept[c, BEGINS]) / (kept[c, ENDS] - kept[c, BEGINS])
    return (1.0 - t) * at[other[0], d] + t * at[other[1], d] - (1.0 - s) * at[p, d] - s * at[q, d]  # type: ignore[no-any-return]


def outward(at: Floats, edge: Integers, d: int) -> float:
    """Return a component of the unit vector out of the body at an edge."""
    x, y = at[edge[1], 0] - at[edge[0], 0], at[edge[1], 1] - at[edge[0], 1]
    length = np.sqrt(x * x + y * y)
    return y / length if d == 0 else -x / length  # type: ignore[no-any-return]
