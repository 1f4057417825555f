"""Demands on shapes and pairings: meshes with closed surfaces, and contact points between surfaces."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from percuss.contact.sliding import half_size, points_at_the_start, points_that_move, renewed_points
from percuss.jsonable import Entries
from percuss.mesh.cells import cells_of
from percuss.mesh.surfaces import surface_of
from percuss.methods.interfaces import (
    BodyMesh,
    FacingSurfaces,
    Floats,
    Integers,
    Mesh,
    PairedPoints,
    Region,
    Surface,
    Wall,
)
from percuss.methods.plugin_calls import answer
from percuss.testing.demands.bodies import SPIN, uneven
from percuss.testing.draws import largest_difference, must_balance, must_compile
from percuss.testing.subject import ROUND_OFF, CheckFailed, NotApplicable, Subject, demand, must, must_vanish

UNIFORM = 1e-10  # largest relative deviation of a pressure
WAYS = 4  # in which all nodes of two surfaces move at once, each by a length of its own
FEWER, MORE, WIDTH = 5, 7, 0.8  # cells of two surfaces, and the width of the first one


# ------------------------------------------------------------------------------------------------------ shapes


@demand("shapes")
def check_mesh(subject: Subject) -> None:
    """The mesh is a straight line of elements, or cells that its regions close.

    Of a line lengths, nodes, unit direction and unit outward normals are consistent. Of other bodies cells have
    positive volumes; the regions together are the whole boundary, and their facets turn
    outwards. `element_count` is the number of elements. `refine` moves no region, but for the height of an arc over its
    chord, and divides the size of elements. The body starts where the case places it.
    """
    for _, shape in subject.made():
        start = np.array([0.3, -0.7, 0.2])[: shape.dimension() or 2]
        meshes = [answer(shape, "mesh", start, refine) for refine in (1, 2)]
        for refine, mesh in zip((1, 2), meshes, strict=True):
            told, cells = shape.element_count(refine), cells_of(mesh)
            words = f"`element_count` is {told} with `refine` {refine}, and the mesh has {len(cells)} elements"
            must(told in {None, len(cells)}, words)
            if mesh.line is not None:
                _check_line(mesh)
            else:
                _check_cells(shape, mesh, cells)
                _check_boundary(subject, shape, mesh)
        longest = [float(np.ptp(mesh.nodes[cells_of(mesh)], axis=1).max()) for mesh in meshes]
        words = f"the largest element is {longest[0]:.6g} long, and {longest[1]:.6g} with `refine` 2"
        must(0.35 <= longest[1] / longest[0] <= 0.7, words)
        # The nodes of a round region lie on it, and its outermost point between two of them as far as an arc is high.
        arc = 0.0 if mesh.line is not None else longest[0] ** 2 / (4.0 * float(np.ptp(mesh.nodes, axis=0).min()))
        for name in shape.regions:
            places = [mesh.nodes[_nodes_of(mesh.regions[name])] for mesh in meshes]
            coarse, fine = ([at.min(axis=0), at.max(axis=0)] for at in places)
            must(np.allclose(coarse, fine, rtol=0.0, atol=ROUND_OFF + arc), f"refinement moves the region '{name}'")
        moved = answer(shape, "mesh", start + 1.0, 2).nodes - meshes[1].nodes
        must(np.allclose(moved, 1.0, rtol=0.0, atol=1e-12), "the body does not start where the case places it")


def _check_line(mesh: Mesh) -> None:
    """Raise `CheckFailed` unless a mesh is a straight line."""
    length = np.linalg.norm(mesh.direction)
    must_vanish(length - 1.0, f"`direction` is {mesh.direction}, expected a unit vector", 1e-12)
    steps, ahead = np.diff(mesh.nodes, axis=0), mesh.lengths[:, None] * mesh.direction
    fits = (mesh.lengths > 0).all() and np.allclose(steps, ahead, rtol=1e-9, atol=1e-12 * mesh.lengths.sum())
    must(fits, "nodes, lengths and direction contradict each other")
    for name, region in mesh.regions.items():
        along = abs(float(region.outward @ mesh.direction))
        must(abs(along - 1.0) <= 1e-12, f"the outward normal of region '{name}' is {region.outward}")


def _nodes_of(region: Region) -> list[int]:
    """Return the nodes of a region and of its facets."""
    return [*region.nodes, *(int(node) for facets in region.facets.values() for node in np.ravel(facets))]


def _check_cells(shape: Any, mesh: Mesh, cells: Integers) -> None:
    """Raise `CheckFailed` unless each region has facets and each node a cell."""
    for name in shape.regions:
        must(sum(map(np.size, mesh.regions[name].facets.values())), f"the region '{name}' has no facets")
    for lonely in np.setdiff1d(np.arange(len(mesh.nodes)), cells):
        raise CheckFailed(f"the node {lonely} at {mesh.nodes[lonely].tolist()} belongs to no cell")


def _check_boundary(subject: Subject, shape: Any, mesh: Mesh) -> None:
    """Raise `CheckFailed` unless the regions of a mesh of cells enclose its volume."""
    elements = (subject.registry.get("elements", name) for name in subject.registry.names("elements"))
    element = next(made for made in elements if getattr(made, "cell", "") == shape.cell)()
    body = BodyMesh(mesh, 1.3, "strain") if shape.dimension() == 2 else BodyMesh(mesh, 1.0)
    volumes = np.asarray(answer(element, "volumes_of_cells", body))
    words = f"a cell has the volume {volumes.min():.3g}: it is negative where corners run clockwise"
    must(volumes.min() > 0.0, words)
    surfaces = [surface_of(body, name, 0, volumes).surface for name in shape.regions]
    vectors = np.concatenate([_vector_areas(surface) for surface in surfaces])
    centres = np.concatenate([surface.positions[surface.facets].mean(axis=1) for surface in surfaces])
    # Of a closed surface the fluxes of x, y and z are its volume each.
    volume, flux = volumes.sum(), (vectors * centres).sum(axis=0)
    closed = np.abs(vectors.sum(axis=0)).max() <= ROUND_OFF and np.abs(flux - volume).max() <= 1e-2 * volume
    must(closed, f"its regions do not enclose its volume {volume:.6g}: they flow {flux}")


def _vector_areas(surface: Surface) -> Floats:
    """Return the integral of the normal over each facet, which is shorter than the area if the facet is not plane."""
    if surface.positions.shape[1] == 2:
        return surface.areas[:, None] * surface.normals
    count, corners = surface.facets.shape
    return surface.outward(np.arange(count), np.full((count, corners), 1.0 / corners))


# --------------------------------------------------------------------------------------------------- pairings


@demand("pairings")
def check_pairing(subject: Subject) -> None:
    """Points move with their surfaces.

    The areas of the points are positive and add up to that of the surface that has partners, whichever of two is the
    first; surfaces that do not face each other have no points. Rows are the slopes of the gaps: bodies that move or
    turn as one leave the gaps, and moved apart they open by the distance. The answer turns with the surfaces, and is
    the same in a mirror.
    """
    for pairing, dim in [(made, dim) for _, made in subject.made() for dim in made.dimensions]:
        seen = []
        turned = np.linalg.qr(uneven(dim, dim))[0]
        for turn in (np.eye(dim), turned, turned * [*[1.0] * (dim - 1), -1.0]):  # one of the last two is a mirror
            first, second = _surfaces(0.1, turn)
            out = turn[:, 0]
            _check_points(pairing, first, second, out)
            _check_points(pairing, second, first, -out)
            _check_points(pairing, first, Wall(first.positions[0] + 0.1 * out, -out), out)
            _check_slopes(pairing, *_surfaces(0.1, turn, wide=1.25))
            far = _surface(second.positions + 9.0 * turn[:, 1], second.facets, second.nodes[0])
            must(not _points(pairing, first, far).gap.size, "surfaces that do not face each other have points")
            tilted = _surfaces(0.1, turn, wide=0.6, tilt=0.1)
            found = _points(pairing, *tilted)
            wide, edge = (area ** (1 / (dim - 1)) for area in (found.weight.sum(), tilted[0].areas.max()))
            covered = (found.weight > 0).all() and abs(wide - 0.6 * WIDTH) <= edge
            must(covered, f"of a surface covered by {0.6 * WIDTH:g} the areas of the points are {found.weight}")
            _check_slopes(pairing, *_surfaces(0.1, turn, wide=0.6))
            forces = np.einsum("p,pij->ij", found.weight * found.gap, _rows(found, *tilted))
            seen.append(forces @ turn)
        must_vanish(np.ptp(seen, axis=0), "surfaces that are turned or seen in a mirror have other points")


def _check_points(pairing: Any, first: Surface, second: Surface | Wall, out: Floats) -> None:
    """Raise `CheckFailed` unless two surfaces, apart by 0.1 along `out`, have points as a pairing must make them."""
    found = _points(pairing, first, second)
    whole = WIDTH ** (out.size - 1)
    right = (found.weight > 0).all() and abs(found.weight.sum() - whole) <= ROUND_OFF
    must(right, f"the areas of the points are {found.weight}, {found.weight.sum():.6g} in all, not {whole:g}")
    right = np.abs(found.gap - 0.1).max() <= ROUND_OFF and np.abs(found.normal - out).max() <= ROUND_OFF
    must(right, f"gaps are {found.gap} and normals {found.normal[0]}, expected 0.1 and {out}")
    rows = _rows(found, first, second)
    for surface, expected in ((first, -out), (second, out)):
        if isinstance(surface, Surface):
            change = rows[:, surface.nodes].sum(axis=1)
            must_vanish(change - expected, "the gap does not change by the distance of its surfaces")


def _check_slopes(pairing: Any, *surfaces: Surface) -> None:
    """Raise `CheckFailed` unless the rows of two surfaces are the slopes of the gaps, and rotations leave them."""
    rows, places = _rows(_points(pairing, *surfaces), *surfaces), np.concatenate([s.positions for s in surfaces])
    change = np.einsum("pnd,nd->p", rows, places @ SPIN[: places.shape[1], : places.shape[1]])
    must_vanish(change, "a gap changes if both bodies turn as one")

    def gaps(move: Floats) -> Floats:
        parts = np.split(move, [len(surfaces[0].nodes)])
        moved = [_surface(s.positions + by, s.facets, s.nodes[0]) for s, by in zip(surfaces, parts, strict=True)]
        found = _points(pairing, *moved)
        direct = np.einsum("pnd,nd->p", _rows(found, *moved), np.concatenate([s.positions for s in moved]))
        # A mean that goes on beyond what is covered may be held up to the least distance, which is no slope of a row.
        held = ~pairing.convex & (found.gap > direct + 1e-12)
        return np.where(held, np.nan, found.gap)

    moves = 1e-6 * uneven(WAYS, *places.shape)
    found = [gaps(move) - gaps(-move) for move in moves]
    wrong = np.abs(np.array(found) / 2.0 - np.einsum("pnd,wnd->wp", rows, moves)) / 1e-6
    larger = np.isnan(wrong).all(axis=0).sum()
    must(larger <= 0.5 * len(rows), "gaps are not those of their rows: most of them are larger")
    worst = np.nan_to_num(wrong).max()
    must(worst <= 1e-6, f"the slope of a gap by a displacement is not that of its row, by up to {worst:.3g}")


@demand("pairings")
def check_patch_test(subject: Subject) -> None:
    """A uniform pressure passes as declared.

    Two strips of 5 and 7 cells across, whichever is the first, are in balance with a uniform pressure on both sides of
    their contact if `passes_patch_test` is declared: each node gets the force that it has by the pressure on its own
    surface, so that the stress in both strips is uniform.
    """
    if not subject.component.passes_patch_test:  # type: ignore[attr-defined]
        raise NotApplicable("it does not declare `passes_patch_test = True`")
    worst = 0.0
    for _, first, second, found in _faced(subject, 0.0):
        forces = np.einsum("p,pij->ij", found.weight, _rows(found, first, second))
        for surface in (first, second):
            area = np.bincount(surface.facets.ravel(), surface.of_nodes().ravel())
            expected = -area[:, None] * surface.normals[0]
            worst = max(worst, float((np.abs(forces[surface.nodes] - expected).max(axis=1) / area).max()))
    must(worst <= UNIFORM, f"it declares `passes_patch_test = True`, and pressures at nodes are wrong by {worst:.3g}")


@demand("pairings")
def check_shares(subject: Subject) -> None:
    """Shares and points are as declared.

    The shares of each surface in a gap add up to 1. With `convex`, as by default, none is negative. Without
    `more_points_than_nodes` there are at most as many points as nodes of the first surface: a law without compliance
    needs that.
    """
    for pairing, first, second, found in _faced(subject, 0.1):
        shares = np.einsum("pnd,pd->pn", _rows(found, first, second), found.normal)
        shares[:, first.nodes] *= -1.0
        for surface in (first, second):
            sums = shares[:, surface.nodes].sum(axis=1)
            farthest = sums[np.abs(sums - 1.0).argmax()]
            must_vanish(farthest - 1.0, f"the shares of a surface in a gap add up to {farthest:.3g}, expected 1")
        words = f"a node has the share {shares.min():.3g} in a gap: declare `convex = False`"
        must(not pairing.convex or shares.min() >= -ROUND_OFF, words)
        nodes, points = len(first.nodes), found.gap.size
        words = f"{nodes} nodes have {points} points: declare `more_points_than_nodes = True`"
        must(points <= nodes or pairing.more_points_than_nodes, words)


@demand("pairings")
def check_places(subject: Subject) -> None:
    """The places of points that slide are those of the points.

    Each place is on its facet: its shares are at least 0 and add up to 1. Where all points of `places` have a partner,
    they are those of `points` in the same order, with the same nodes, shares and areas, and the gaps and rows that the
    framework finds of them at the start are those of `points`: the facet nearest to a point is the one that it meets.
    """
    for pairing, dim in [(made, dim) for _, made in subject.made() for dim in made.dimensions]:
        for tilt in (0.0, 0.1):
            first, second = _surfaces(0.1, np.eye(dim), wide=1.25, tilt=tilt)
            places = answer(pairing, "places", first, second)
            if places is None:
                raise NotApplicable("it has no `places`: it does not slide")
            least, sums = places.shares.min(), places.shares.sum(axis=1)
            must(least >= -ROUND_OFF, f"a place has the share {least:.3g}: it is not on its facet")
            words = f"the shares of a place add up to {sums[np.abs(sums - 1.0).argmax()]:.3g}, expected 1"
            must_vanish(sums - 1.0, words)
            found, points = _points(pairing, first, second), places.weight.size
            must(found.gap.shape == (points,), f"there are {points} places and {found.gap.size} points")
            must_vanish(places.weight - found.weight, "places have other areas than points")
            own = np.zeros((points, 1 + first.nodes.max()))
            np.add.at(own, (np.arange(points)[:, None], first.nodes[first.facets[places.facets]]), places.shares)
            rows = _rows(found, first, second)
            of_points = -np.einsum("pnd,pd->pn", rows, found.normal)[:, first.nodes]
            must_vanish(own[:, first.nodes] - of_points, "places are not those of the points in their order")
            at_start = points_at_the_start(places, first, second)
            must_vanish(at_start.gap - found.gap, "a point does not meet the facet nearest to its place")
            must_vanish(
                _rows(at_start, first, second) - rows, "a point meets the facet nearest to its place by other rows"
            )


@demand("pairings")
def check_renewed(subject: Subject) -> None:
    """The kernel `renew` writes the points of `points` where surfaces are at the start.

    That is on surfaces that face each other, also tilted, and where the second one covers a part. Gaps, areas, normals
    and shares are the same, what `points` leaves out has no area, and the shares of a point add up to 1.
    """
    for pairing, dim in [(made, dim) for _, made in subject.made() for dim in made.renews]:
        for tilt, wide in itertools.product((0.0, 0.1), (1.25, 0.6)):
            first, second = _surfaces(0.1, np.eye(dim), wide=wide, tilt=tilt)
            found, points = _points(pairing, first, second), renewed_points(first, len(second.nodes))
            nodes = len(first.nodes)
            at, facets = np.concatenate([first.positions, second.positions]), second.facets + nodes
            low, high = at[facets].min(axis=(0, 1)), at[facets].max(axis=(0, 1))
            pairing.renew(
                FacingSurfaces(
                    at, first.facets, facets, first.facets, first.areas, low[None], high[None], len(facets),
                    half_size(first),
                ),
                points,
            )  # fmt: skip
            meets = np.flatnonzero(points.area > 0.0)
            must(meets.size == found.gap.size, f"{meets.size} points have an area, and `points` finds {found.gap.size}")
            for name, written, expected in (
                ("gap", points.gap, found.gap), ("area", points.area, found.weight),
                ("normal", points.normal, found.normal),
            ):  # fmt: skip
                must_vanish(written[meets] - expected, f"its {name} is not that of `points`")
            shares = np.zeros((meets.size, nodes + len(second.nodes)))
            for row, p in zip(shares, meets, strict=True):
                met = points.node[p, : points.meets[p]]
                np.add.at(row, met, points.share[p, : met.size])
                row[p] = -1.0
            must_vanish(shares.sum(axis=1), "the shares of a point do not add up to 1")
            rows = np.einsum("pnd,pd->pn", _rows(found, first, second), found.normal)
            must_vanish(shares - rows[:, [*first.nodes, *second.nodes]], "a share is not that of `points`")
    if not any(made.renews for _, made in subject.made()):
        raise NotApplicable("it has no kernel `renew`")


@demand("pairings")
def check_slides_far(subject: Subject) -> None:
    """Surfaces that slide far are like those that slide little where they do, and like a wall where one is.

    Two blocks of one mesh that meet head on give the numbers of `sliding: small`. A block that slides over many facets
    of a body of another mesh, all of whose nodes are held, gives those of a wall. The accounts are balanced.
    """
    for options, pairing in subject.made():
        dim = pairing.dimensions[0]
        if points_that_move(pairing, *_surfaces(0.1, np.eye(dim))) is None:
            raise NotApplicable("it has neither `places` nor `renew`: it does not slide")
        small, large = (subject.run(subject.placed(_head_on(dim, far), options)) for far in ("small", "large"))
        must_compile(large)
        must_balance(large)
        apart = largest_difference(small.arrays, large.arrays)
        must(apart <= ROUND_OFF, f"where blocks meet head on, `sliding: small` differs by {apart:.3g} of its peak")
        on_body = subject.run(subject.placed(_over(dim), options))
        must_balance(on_body)
        on_wall = subject.run(subject.placed(_over(dim, at_wall=True), options))
        for name in ("contact_force", "kinetic_energy"):
            one, other = on_body.arrays[name], on_wall.arrays[name]
            apart = np.abs(one - other).max() / np.abs(other).max()
            must(apart <= ROUND_OFF, f"on a held body {name} differs from that on a wall by {apart:.3g} of its peak")


def _head_on(dim: int, sliding: str) -> Entries:
    """Return two blocks of one mesh that meet head on, held at their sides."""
    sides: list[Any] = [{"on": side, "along": "x"} for side in ("left", "right")]
    sides += [{"on": side, "along": "y"} for side in ("front", "back")][: 2 * dim - 4]
    below = _block([1.0, 0.5, 0.5], [4, 2, 2], [0.0, 0.0, -0.5], [0.0, 0.0, 0.0], sides, dim)
    return _on(below, _block([1.0, 0.5, 0.5], [4, 2, 2], [0.0, 0.0, 0.0], [0.0, 0.0, -0.05], sides, dim), sliding)


def _over(dim: int, *, at_wall: bool = False) -> Entries:
    """Return a block that slides over a body all of whose nodes are held, or on a wall in its place."""
    below = _block([4.0, 1.0, 0.5], [17, 3, 1], [-0.5, -0.25, -0.5], [0.0, 0.0, 0.0], ["top", "bottom"], dim)
    case = _on(below, _block([1.0, 0.5, 0.5], [4, 2, 2], [0.0, 0.0, 0.0], [1.0, 0.0, -0.05], [], dim), "large")
    if at_wall:
        wall = {"point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}
        case |= {
            "bodies": {"upper": case["bodies"]["upper"]},
            "contacts": {"seam": {"body": "upper.bottom", "wall": wall}},
        }
    return case


def _block(
    size: list[float], elements: list[int], at: list[float], velocity: list[float], held: list[Any], dim: int
) -> Entries:
    """Return a block in space, or without its second direction in the plane."""
    size, elements, at, velocity = ([each[0], *each[4 - dim :]] for each in (size, elements, at, velocity))
    material = {"young": 1.0, "density": 1.0, "poisson": 0.3}
    shape = {"size": size, "elements": elements}
    return {"block": shape, "at": at, "velocity": velocity, "fixed": held, "material": material}


def _on(lower: Entries, upper: Entries, sliding: str) -> dict[str, Any]:
    """Return a block that moves on another one."""
    return {
        "percuss": 1,
        "bodies": {"upper": upper, "lower": lower},
        "contacts": {"seam": {"between": ["upper.bottom", "lower.top"], "sliding": sliding}},
        "method": {"contact": "regularised-lagrange"},
        "time": {"end": 2.0, "courant": 0.5},
    }


def _faced(subject: Subject, gap: float) -> Iterator[tuple[Any, Surface, Surface, PairedPoints]]:
    """Yield each example of a pairing, two surfaces that are so far apart, whichever is the first, and their points."""
    for _, pairing in subject.made():
        for dim in pairing.dimensions:
            pair = _surfaces(gap, np.eye(dim))
            for first, second in (pair, pair[::-1]):
                yield pairing, first, second, _points(pairing, first, second)


def _points(pairing: Any, first: Surface, second: Surface | Wall) -> PairedPoints:
    found: PairedPoints = answer(pairing, "points", first, second)
    known = first.nodes if isinstance(second, Wall) else np.concatenate([first.nodes, second.nodes])
    must(np.isin(found.node, known).all(), "a point has a node that is on neither surface")
    return found


def _rows(found: PairedPoints, *surfaces: Surface | Wall) -> Floats:
    """Return the slopes of the gaps by the displacements of the nodes of both surfaces, (points, nodes, dim)."""
    nodes = 1 + max(int(surface.nodes.max()) for surface in surfaces if isinstance(surface, Surface))
    rows = np.zeros((found.gap.size, nodes, found.value.shape[1]))
    np.add.at(rows, (np.repeat(np.arange(found.gap.size), np.diff(found.start)), found.node), found.value)
    return rows


def _surfaces(gap: float, turn: Floats, wide: float = 1.0, tilt: float = 0.0) -> tuple[Surface, Surface]:
    """Return two uneven flat surfaces that face each other, all turned by a matrix or seen in a mirror.

    The first one lies across x and has its normal along x; the second one is `wide` times as wide.
    """
    made: list[Surface] = []
    for count, x, width, slope in ((FEWER, 0.0, -1.0, 0.0), (MORE, gap, wide, tilt)):
        y = WIDTH * width * (0.5 - (np.arange(count + 1) / count) ** 1.2)
        number = np.arange((count + 1) ** (len(turn) - 1)).reshape([count + 1] * (len(turn) - 1))
        facets = np.stack([number[:-1], number[1:]], axis=-1)
        nodes = np.stack([x + slope * y, y], axis=1)
        if len(turn) == 3:
            facets = np.concatenate([facets[:, :-1], facets[:, 1:, ::-1]], axis=-1).reshape(-1, 4)
            facets = facets if width < 0 else facets[:, ::-1]
            nodes = np.concatenate([np.repeat(nodes, y.size, axis=0), np.tile(y, y.size)[:, None]], axis=1)
        facets = facets if np.linalg.det(turn) > 0 else facets[:, ::-1]  # with the body on their left
        made.append(_surface(nodes @ turn.T, facets, sum(len(one.nodes) for one in made)))
    return made[0], made[1]


def _surface(nodes: Floats, facets: Integers, start: int) -> Surface:
    """Return the surface of a body of facets between nodes, which are numbered from `start`."""
    kind = "line" if facets.shape[1] == 2 else "quad"
    mesh = Mesh(nodes, {kind: facets}, {"all": Region((), np.zeros(nodes.shape[1]), {kind: facets})})
    return surface_of(BodyMesh(mesh, 1.0), "all", int(start), np.ones(len(facets))).surface
