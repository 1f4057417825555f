"""The partner of a contact point: the facet nearest to it, its place there, and the normal; kernels of the time loop.

They work on one contact at a time and write into arrays that they are given.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from percuss.jit import called
from percuss.methods.interfaces.nearest import EVEN, FARTHEST, FOUND, NEWTON

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers

AT_AN_END = 1e-8  # of the size of a facet: a point that lies so far beyond the end of a surface is still inside
MOST = {2: 12, 3: 64}  # candidates of a point, by the dimension of space
GROUP = 16  # facets, side by side, that a search looks at together
NOBODY = -1  # partner of a point that has none


class Partners(NamedTuple):
    """Facets that contact points may meet, and the candidates of each point; facets of all contacts in one row."""

    rank: Integers  # (F,) number of each facet on its surface; here they stand so that neighbours are near each other
    node: Integers  # (F, w) of each facet, as a row of `at`
    width: Integers  # (F,) number of its nodes
    rim: Integers  # (F, w) 1 where the edge from this node to the next one is the rim of an open surface
    corner: Integers  # (F, w) 1 where the node is on the rim
    at: Floats  # (nodes, dim) places of the nodes at t_n
    low: Floats  # (F, dim) corners of the box around each facet
    high: Floats
    group_low: Floats  # (F, dim) corners of the box around each `GROUP` facets of a contact, in the place of the first
    group_high: Floats
    candidates: Integers  # (S, most)
    candidate_count: Integers  # (S,)
    partner: Integers  # (S,) facet that each point met last, NOBODY for none
    first: Integers  # (S,) the facets of its contact are those from first to last
    last: Integers
    skin: Floats  # (S,) size of a facet of its contact
    # what is found of a point
    point: Floats  # (dim,)
    share: Floats  # (w,) shape functions at its place on its partner
    trial: Floats  # (w,)
    out: Floats  # (dim,) unit vector out of the partner
    place: Floats  # (dim,) on the partner
    other: Floats  # (dim,)


def beyond(data: Partners, f: int) -> float:
    """Return the square of the distance of the point from the box around a facet."""
    return outside(data.point, data.low[f], data.high[f])


def outside(point: Floats, low: Floats, high: Floats) -> float:
    """Return the square of the distance of a point from a box."""
    square = 0.0
    for d in range(point.size):
        apart = max(low[d] - point[d], point[d] - high[d], 0.0)
        square += apart * apart
    return square


def enclose(data: Partners) -> None:
    """Find the boxes around all facets."""
    for f in range(data.width.size):
        for d in range(data.point.size):
            data.low[f, d], data.high[f, d] = np.inf, -np.inf
            for a in range(data.width[f]):
                data.low[f, d] = min(data.low[f, d], data.at[data.node[f, a], d])
                data.high[f, d] = max(data.high[f, d], data.at[data.node[f, a], d])


def enclose_groups(data: Partners, first: int, last: int) -> None:
    """Find the boxes around the groups of facets of a contact."""
    for begin in range(first, last, GROUP):
        for d in range(data.point.size):
            data.group_low[begin, d], data.group_high[begin, d] = data.low[begin, d], data.high[begin, d]
            for f in range(begin, min(begin + GROUP, last)):
                data.group_low[begin, d] = min(data.group_low[begin, d], data.low[f, d])
                data.group_high[begin, d] = max(data.group_high[begin, d], data.high[f, d])


@called
def place_on(data: Partners, f: int, share: Floats) -> float:
    """Set the shape functions of a facet at its place nearest to the point; return the square of the distance."""
    width, dim, least, best, part = data.width[f], data.point.size, np.inf, 0, 0.0
    if width > 2 and inside(data, f, share):
        return apart_from(data, f, share)
    for a in range(1 if width == 2 else width):
        p, q = data.node[f, a], data.node[f, (a + 1) % width]
        across, along = 0.0, 0.0
        for d in range(dim):
            edge = data.at[q, d] - data.at[p, d]
            across += (data.point[d] - data.at[p, d]) * edge
            along += edge * edge
        on_edge = min(max(across / along, 0.0), 1.0)
        square = 0.0
        for d in range(dim):
            apart = data.point[d] - (1.0 - on_edge) * data.at[p, d] - on_edge * data.at[q, d]
            square += apart * apart
        if square < least:
            least, best, part = square, a, on_edge
    for a in range(width):
        share[a] = 0.0
    share[best] = 1.0 - part
    share[(best + 1) % width] = part
    return least


def apart_from(data: Partners, f: int, share: Floats) -> float:
    """Return the square of the distance of the point from the place of a facet with these shape functions."""
    square = 0.0
    for d in range(data.point.size):
        apart = data.point[d]
        for a in range(data.width[f]):
            apart -= share[a] * data.at[data.node[f, a], d]
        square += apart * apart
    return square


def shares_at(width: int, x: float, y: float, share: Floats) -> None:
    """Set the shape functions of a triangle or a quadrilateral."""
    if width == 3:
        share[0], share[1], share[2] = 1.0 - x - y, x, y
    else:
        share[0], share[1] = 0.25 * (1.0 - x) * (1.0 - y), 0.25 * (1.0 + x) * (1.0 - y)
        share[2], share[3] = 0.25 * (1.0 + x) * (1.0 + y), 0.25 * (1.0 - x) * (1.0 + y)


def inside(data: Partners, f: int, share: Floats) -> bool:
    """Set the shape functions where the vector to the point is across the facet; return whether that is inside.

    Newton's method for quadrilaterals, with the curvature of the facet; of triangles its first step is exact.
    """
    width, x, y = data.width[f], 0.0, 0.0
    for _ in range(1 if width == 3 else NEWTON):
        shares_at(width, x, y, share)
        xx, xy, yy, right_x, right_y = 0.0, 0.0, 0.0, 0.0, 0.0
        for d in range(data.point.size):
            c0, c1, c2 = data.at[data.node[f, 0], d], data.at[data.node[f, 1], d], data.at[data.node[f, 2], d]
            if width == 3:
                along_x, along_y, twist = c1 - c0, c2 - c0, 0.0
            else:
                c3 = data.at[data.node[f, 3], d]
                along_x = 0.25 * ((1.0 - y) * (c1 - c0) + (1.0 + y) * (c2 - c3))
                along_y = 0.25 * ((1.0 - x) * (c3 - c0) + (1.0 + x) * (c2 - c1))
                twist = 0.25 * (c0 - c1 + c2 - c3)
            apart = data.point[d]
            for a in range(width):
                apart -= share[a] * data.at[data.node[f, a], d]
            xx += along_x * along_x
            xy += along_x * along_y - apart * twist
            yy += along_y * along_y
            right_x += along_x * apart
            right_y += along_y * apart
        determinant = xx * yy - xy * xy
        if not abs(determinant) > 1e-12 * (xx + yy) * (xx + yy):
            break
        next_x = min(max(x + (right_x * yy - right_y * xy) / determinant, -FARTHEST), FARTHEST)
        next_y = min(max(y + (right_y * xx - right_x * xy) / determinant, -FARTHEST), FARTHEST)
        moved = max(abs(next_x - x), abs(next_y - y))
        x, y = next_x, next_y
        if moved <= FOUND:
            break
    shares_at(width, x, y, share)
    for a in range(width):
        if share[a] < 0.0:
            return False
    return width == 3 or max(abs(x), abs(y)) <= 1.0


def set_place(data: Partners, f: int, share: Floats, place: Floats) -> None:
    """Set the place of a facet where it has these shape functions."""
    for d in range(place.size):
        place[d] = 0.0
        for a in range(data.width[f]):
            place[d] += share[a] * data.at[data.node[f, a], d]


def set_out(data: Partners, f: int, share: Floats, out: Floats) -> None:
    """Set the unit vector out of a facet where it has these shape functions."""
    at, node, width = data.at, data.node, data.width[f]
    if width == 2:
        out[0] = at[node[f, 1], 1] - at[node[f, 0], 1]
        out[1] = at[node[f, 0], 0] - at[node[f, 1], 0]
    else:
        x, y = 0.0, 0.0
        if width == 4:
            x = share[1] + share[2] - share[0] - share[3]
            y = share[2] + share[3] - share[0] - share[1]
        for d in range(3):
            e, g = (d + 1) % 3, (d + 2) % 3
            out[d] = along_x(data, f, y, e) * along_y(data, f, x, g) - along_x(data, f, y, g) * along_y(data, f, x, e)
    length = 0.0
    for d in range(out.size):
        length += out[d] * out[d]
    for d in range(out.size):
        out[d] /= np.sqrt(length)


def along_x(data: Partners, f: int, y: float, d: int) -> float:
    """Return a component of the tangent of a facet along its first edge."""
    at, node = data.at, data.node
    edge = at[node[f, 1], d] - at[node[f, 0], d]
    if data.width[f] == 3:
        return edge  # type: ignore[no-any-return]
    return (1.0 - y) * edge + (1.0 + y) * (at[node[f, 2], d] - at[node[f, 3], d])  # type: ignore[no-any-return]


def along_y(data: Partners, f: int, x: float, d: int) -> float:
    """Return a component of the tangent of a facet along its last edge."""
    at, node = data.at, data.node
    if data.width[f] == 3:
        return at[node[f, 2], d] - at[node[f, 0], d]  # type: ignore[no-any-return]
    edge = at[node[f, 3], d] - at[node[f, 0], d]
    return (1.0 - x) * edge + (1.0 + x) * (at[node[f, 2], d] - at[node[f, 1], d])  # type: ignore[no-any-return]


def is_on_rim(data: Partners, f: int, share: Floats) -> bool:
    """Return whether a place of a facet lies on the rim of an open surface."""
    width, held = data.width[f], 0
    for a in range(width):
        if share[a] > 0.0:
            held += 1
    for a in range(width):
        b = (a + 1) % width
        if share[a] > 0.0 and held == 1 and data.corner[f, a] == 1:
            return True
        if width > 2 and held == 2 and share[a] > 0.0 and share[b] > 0.0 and data.rim[f, a] == 1:
            return True
    return False


# ------------------------------------------------------------------------------------------------------------- search


@called
def nearest(data: Partners, s: int, best: int) -> tuple[float, int]:
    """Return the square of the least distance of a point from all facets, and the facet; `best` is looked at first."""
    square = place_on(data, best, data.trial)
    for begin in range(data.first[s], data.last[s], GROUP):
        if outside(data.point, data.group_low[begin], data.group_high[begin]) < square:
            for f in range(begin, min(begin + GROUP, data.last[s])):
                if beyond(data, f) < square:
                    found = place_on(data, f, data.trial)
                    if found < square:
                        square, best = found, f
    return square, best


@called
def search(data: Partners, s: int) -> float:
    """Find the candidates of a point; return how far nodes may move before it needs others.

    If no node moves by more than that, a facet that is no candidate cannot become the nearest one: the distances of the
    point change by twice the motion. A point so far away that it touches nothing before then has the nearest one alone.
    """
    most, skin, best = data.candidates.shape[1], data.skin[s], data.candidates[s, 0]
    square, best = nearest(data, s, best)
    near = np.sqrt(square)
    data.candidates[s, 0], data.candidate_count[s] = best, 1
    if near > skin:
        return 0.25 * skin  # type: ignore[no-any-return]
    margin = skin
    for _ in range(60):
        count, reach = 1, (near + margin) * (near + margin)
        for begin in range(data.first[s], data.last[s], GROUP):
            if outside(data.point, data.group_low[begin], data.group_high[begin]) <= reach:
                for f in range(begin, min(begin + GROUP, data.last[s])):
                    if f != best and beyond(data, f) <= reach:
                        if count < most:
                            data.candidates[s, count] = f
                        count += 1
        if count <= most:
            data.candidate_count[s] = count
            return 0.25 * margin  # type: ignore[no-any-return]
        margin = 0.5 * margin
    data.candidate_count[s] = most
    return 0.0


@called
def meet(data: Partners, s: int) -> float:
    """Find partner, shape functions and normal of a point; return its gap, infinite where it has no partner.

    Of facets that are equally near the first one of the surface counts. Where facets meet, the gap is the distance,
    along the vector to the point; of points that touch along the mean of their normals. The candidate that was nearest
    last is looked at first, and stays the first one.
    """
    dim, size = data.point.size, data.skin[s]
    even, best, place = EVEN * size, data.candidates[s, 0], 0
    least = place_on(data, best, data.share)
    for k in range(1, data.candidate_count[s]):
        f = data.candidates[s, k]
        if beyond(data, f) <= (np.sqrt(least) + even) * (np.sqrt(least) + even):
            square = place_on(data, f, data.trial)
            nearer = np.sqrt(square) < np.sqrt(least) - even
            if nearer or (np.sqrt(square) <= np.sqrt(least) + even and data.rank[f] < data.rank[best]):
                best, place = f, k
                for a in range(data.width[f]):
                    data.share[a] = data.trial[a]
            least = min(least, square)
    data.candidates[s, place], data.candidates[s, 0] = data.candidates[s, 0], best
    limit = (np.sqrt(least) + even) * (np.sqrt(least) + even)
    data.partner[s] = best
    set_out(data, best, data.share, data.out)
    set_place(data, best, data.share, data.place)
    gap, apart = 0.0, 0.0
    for d in range(dim):
        gap += (data.point[d] - data.place[d]) * data.out[d]
    for d in range(dim):
        beside = data.point[d] - data.place[d] - gap * data.out[d]
        apart += beside * beside
    if is_on_rim(data, best, data.share):
        if apart <= (AT_AN_END * size) * (AT_AN_END * size):
            return gap
        data.partner[s] = NOBODY
        return np.inf
    cornered = False
    for a in range(data.width[best]):
        cornered = cornered or data.share[a] <= AT_AN_END
    return at_corner(data, s, best, gap, limit) if cornered else gap


def at_corner(data: Partners, s: int, best: int, gap: float, limit: float) -> float:
    """Set the normal where several facets are nearest to a point at one place; return the gap."""
    dim, size, outside, square = data.point.size, data.skin[s], False, 0.0
    for d in range(dim):
        data.out[d] = 0.0
        square += (data.point[d] - data.place[d]) * (data.point[d] - data.place[d])
    apart, touches = np.sqrt(square), np.sqrt(square) <= AT_AN_END * size
    for k in range(data.candidate_count[s]):
        f = data.candidates[s, k]
        if beyond(data, f) > limit or place_on(data, f, data.trial) > limit:
            continue
        set_place(data, f, data.trial, data.other)
        between = 0.0
        for d in range(dim):
            between += (data.other[d] - data.place[d]) * (data.other[d] - data.place[d])
        if between > (AT_AN_END * size) * (AT_AN_END * size):
            continue
        for a in range(data.width[f]):
            data.trial[a] = 1.0 / data.width[f]
        set_out(data, f, data.trial, data.other)
        toward = 0.0
        for d in range(dim):
            toward += data.other[d] * (data.point[d] - data.place[d])
            if touches:
                data.out[d] += data.other[d]
        outside = outside or toward > 0.0
    if touches or outside:
        length = 0.0
        for d in range(dim):
            if not touches:
                data.out[d] = data.point[d] - data.place[d]
            length += data.out[d] * data.out[d]
        for d in range(dim):
            data.out[d] /= np.sqrt(length)
        return gap if touches else apart
    set_out(data, best, data.share, data.out)
    return gap
