"""Demands on shapes, elements and materials that are no bars, and of pairings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from percuss.jsonable import Entries
from percuss.mesh.cell_stiffness import frequencies_of_cells
from percuss.mesh.cells import element_masses, is_solid, lumping_of
from percuss.mesh.surfaces import surface_of
from percuss.methods.interfaces import BodyMesh, Floats, Integers, Mesh, PairedPoints, Region, Surface, Wall
from percuss.methods.plugin_calls import answer
from percuss.testing.bodies import BLOCKS, BodyKernels, FiniteStrain, SolidKernels, slopes, solid_kernels, uneven
from percuss.testing.demands.bulk import bodies_of
from percuss.testing.draws import largest_difference, must_balance, must_compile, per_cent
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, demand

CLOSE = 1e-9
DIRECTIONS = 500  # of waves, whose fastest is sought
ROUND_OFF = 1e-6  # of a tangent, relative to its largest value
SHEARED = np.array([[1.0, 0.3, 0.1], [-0.2, 0.5, 0.2], [0.15, -0.1, 0.7]])
TURN = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
SPIN = np.array([[0.0, 1.0, -0.3], [-1.0, 0.0, 0.5], [0.3, -0.5, 0.0]])
SLIVER = 5.0  # degrees
UNIFORM = 1e-10  # largest relative deviation of a pressure
WAYS = 4  # in which all nodes of two surfaces move at once, each by a length of its own
FEWER, MORE, WIDTH = 5, 7, 0.8  # cells of two surfaces, and the width of the first one


# ------------------------------------------------------------------------------------------------------- runs


@demand("elements", "materials", "pairings")
def check_blocks(subject: Subject) -> None:
    """Two blocks collide in a run with it.

    The kernels are compiled, momentum and energy are balanced, the run gives the same bits if it is made again, and the
    same numbers in plain Python.
    """
    found = [_blocks(subject, made, {"name": subject.name, **options}) for options, made in subject.made()]
    if not any(found):
        raise NotApplicable("none of its examples has bodies that are no bars")
    for case in filter(None, found):
        result = subject.run(case)
        must_compile(result)
        must_balance(result)
        for words, compiled, allowed in (("made again", True, 0.0), ("in plain Python", False, CLOSE)):
            other = largest_difference(result.arrays, subject.run(case, compiled=compiled).arrays)
            if not other <= allowed:
                raise CheckFailed(f"the run {words} differs by {per_cent(other)} of its peak")


def _blocks(subject: Subject, made: Any, own: Entries) -> Entries:
    """Return a case of two blocks that collide, with an element, material or pairing; nothing if it is one of bars."""
    body: Entries = {"material": {"young": 1.0, "density": 1.0, "poisson": 0.3}}
    method: Entries = {"contact": "regularised-lagrange"}
    cells, dim, speed = "quad4", 2, 1e-3
    if subject.family == "pairings":
        method["pairing"], dim = own, made.dimensions[0]
        cells = "hex8" if dim == 3 else cells
    elif subject.family == "elements":
        if made.cell not in BLOCKS:
            return {}
        (cells, dim), body["element"] = BLOCKS[made.cell], own
        body |= {"plane": "axisymmetric" if made.about_axis else "strain"} if dim == 2 else {}
    else:
        solid = next(solid_kernels(made), None)
        if solid is None:
            return {}
        body["material"], speed = own, speed * float(np.sqrt(solid.modulus / made.rho))
        dim, cells = solid.dim, "hex8" if solid.dim == 3 else cells
        body |= {"plane": solid.plane} if dim == 2 else {}

    def block(at: float, elements: list[int], velocity: list[float]) -> Entries:
        shape = {"size": [1.0, 0.5, 0.4][:dim], "elements": elements[:dim], "cells": cells}
        return {"block": shape, "at": [at, 0.0, 0.0][:dim], "velocity": velocity[:dim], **body}

    bodies = {
        "left": block(0.0, [3, 2, 2], [speed, 0.0, 0.0]),
        "right": block(1.0, [2, 3, 1], [0.0, 0.1 * speed, 0.0]),
    }
    contacts = {"seam": {"between": ["left.right", "right.left"]}}
    time = {"steps": 40, "courant": 0.5}
    return {"percuss": 1, "bodies": bodies, "contacts": contacts, "method": method, "time": time}


# --------------------------------------------------------------------------------------------------- elements


def _solids(subject: Subject) -> Iterator[BodyKernels]:
    """Yield a body of uneven cells for each example of an element, with a linear material."""
    if not all(is_solid(element) for _, element in subject.made()):
        raise NotApplicable("it is an element along a line, or sees the strain of single points")
    yield from bodies_of(subject)


@demand("elements")
def check_solid_forces(subject: Subject) -> None:
    """Forces have an energy, rigid bodies none.

    Internal forces have no resultant and are minus the slope of the energy, with Hooke's law and with a material of
    finite strain. Translations and rotations, small ones if the element is linear, of a body of uneven cells give no
    force. A uniform strain leaves a node inside without force. Bodies of revolution move along their axis alone, and
    their uniform strain is the same in both directions across it.
    """
    for kernels in _solids(subject):
        element, x = kernels.element, kernels.body.mesh.nodes
        force = kernels.checked_force()
        BodyKernels(element, FiniteStrain(), kernels.mesh).checked_force()
        dim = x.shape[1]
        uniform = kernels.force(1e-3 * x @ (np.diag([1.0, 0.5]) if kernels.about_axis else SHEARED[:dim, :dim]))
        if np.abs(uniform[len(x) // 2]).max() > CLOSE * np.abs(uniform).max():
            raise CheckFailed("a uniform strain gives a force on a node inside: it fails the patch test")
        small, turn = 1e-3 * x @ SPIN[:dim, :dim], TURN[:dim, :dim]
        if kernels.about_axis:
            continue
        if np.abs(kernels.force(small if element.linear else x @ turn.T - x)).max() > CLOSE * np.abs(force).max():
            raise CheckFailed("a rotation of the body gives a force")


@demand("elements")
def check_finite_rotation(subject: Subject) -> None:
    """Forces turn with a body that turns far.

    With a material of finite strain a large rotation gives no force, and the forces of a strained body turn with it. An
    element for small strains that cannot meet this declares it in `expected_failures`.
    """
    for kernels in _solids(subject):
        element, x = kernels.element, kernels.body.mesh.nodes
        if kernels.about_axis:
            raise NotApplicable("a body of revolution does not turn")
        finite, turn = (
            BodyKernels(element, FiniteStrain(), kernels.mesh),
            TURN[: x.shape[1], : x.shape[1]],
        )
        size = float(np.abs(finite.force(finite.motion)).max())
        for strained in (0.0 * x, finite.motion):
            turned = finite.force((x + strained) @ turn.T - x) - finite.force(strained) @ turn.T
            if np.abs(turned).max() > CLOSE * size:
                raise CheckFailed("the forces do not turn with the body")


@demand("elements")
def check_solid_masses(subject: Subject) -> None:
    """Masses are right and bound frequencies.

    Each node has some of the mass of the body, which is density times volume. No frequency of a body whose nodes move
    by thousandths of a cell is above the highest of a cell by itself at rest, from which the time step follows.
    """
    for kernels in _solids(subject):
        element, body, density = kernels.element, kernels.body, kernels.material.rho
        dim = body.mesh.nodes.shape[1]
        wide, *others = np.ptp(body.mesh.nodes, axis=0)  # the patch is a block, whose axis of revolution is at x = 0
        across = np.pi * wide**2 if kernels.about_axis else wide * (body.section if dim == 2 else 1.0)
        total = density * float(np.prod([across, *others]))
        nodal = lumping_of(element, body).at_nodes(element_masses(element, body, density))
        if not (nodal > 0).all() or abs(nodal.sum() - total) > CLOSE * total:
            raise CheckFailed(f"the nodes have the masses {nodal} of a body of {total:.6g}")
        root = np.sqrt(np.repeat(nodal, dim))
        stiffness = -slopes(kernels.force, np.zeros_like(kernels.motion), 1e-3).reshape(root.size, root.size)
        highest = np.sqrt(np.linalg.eigvals(stiffness / root / root[:, None]).real.max())
        bound = float(frequencies_of_cells(element, kernels.material, body).max())
        if not highest <= bound * (1.0 + 1e-3):
            raise CheckFailed(f"the body has the frequency {highest:.6g}, and no cell at rest one above {bound:.6g}")


# -------------------------------------------------------------------------------------------------- materials


@demand("materials")
def check_solid_stress(subject: Subject) -> None:
    """Stress has an energy and turns along.

    At rest there is no stress. Stress is the slope of the energy that the material stores. It is that of the symmetric
    part of the gradient, or turns with a body that turns. `wave_modulus` is that of the fastest waves of small strains,
    and no wave has a negative one.
    """
    solids = [solid for _, material in subject.made() for solid in solid_kernels(material)]
    if not solids:
        raise NotApplicable("none of its examples has bodies other than bars")
    for solid in solids:
        _check_solid(solid)


def _check_solid(solid: SolidKernels) -> None:
    dim, _, modulus, stress, energy = solid
    tangent = slopes(stress, np.zeros((dim, dim)), 1e-7)
    along = np.random.default_rng(0).normal(size=(DIRECTIONS, dim))
    along /= np.linalg.norm(along, axis=1)[:, None]
    waves = np.linalg.eigvals(np.einsum("ki,jilm,km->kjl", along, tangent.transpose(2, 3, 0, 1), along)).real
    slowest, fastest = float(waves.min()), float(waves.max())
    if not modulus > 0.0 or slowest < -ROUND_OFF * np.abs(waves).max():
        raise CheckFailed(
            f"in {dim} dimensions the tangent at rest gives waves of the moduli {slowest:.6g} to {fastest:.6g}, and "
            f"`wave_modulus` is {modulus:.6g}: none may be negative"
        )
    if np.abs(stress(np.zeros((dim, dim)))).max() > CLOSE * modulus:
        raise CheckFailed(f"a body at rest has stress in {dim} dimensions")
    gradient = 0.05 * uneven(dim, dim)
    found, slope = stress(gradient), slopes(energy, gradient, 1e-6)
    k = int(np.argmax(np.abs(slope - found)))
    here, there = found.flat[k], slope.flat[k]
    if abs(there - here) > 1e-7 * modulus:
        raise CheckFailed(f"in {dim} dimensions the stress is {here:.6g} and the slope of the energy {there:.6g}")
    turn = TURN[:dim, :dim]
    turned = stress(turn @ (np.eye(dim) + gradient) - np.eye(dim)) - turn @ found
    of_small_strain = found - stress(0.5 * (gradient + gradient.T))
    if min(np.abs(turned).max(), np.abs(of_small_strain).max()) > CLOSE * modulus:
        raise CheckFailed(f"in {dim} dimensions the stress does not turn with the body")
    if not 0.99 * modulus <= fastest <= modulus * (1.0 + 1e-5):
        raise CheckFailed(
            f"in {dim} dimensions the fastest waves have the modulus {fastest:.6g}, `wave_modulus` is {modulus:.6g}"
        )


# --------------------------------------------------------------------------------------------------- pairings


@demand("pairings")
def check_pairing(subject: Subject) -> None:
    """Points move with their surfaces.

    The areas of the points are positive and add up to that of the surface that has partners, whichever of two is the
    first; surfaces that do not face each other have no points. Rows are the slopes of the gaps: bodies that move or
    turn as one leave the gaps, and moved apart they open by the distance. The answer turns with the surfaces, and is
    the same in a mirror.
    """
    for dim, pairing in _with_dimensions(subject):
        seen = []
        for angle, mirrored in ((0.0, False), (0.7, False), (2.9, True)):
            turn = _turned(angle, dim)
            turn[:, -1] *= -1.0 if mirrored else 1.0
            first, second = _surfaces(0.1, turn)
            out = turn[:, 0]
            _check_points(pairing, first, second, out)
            _check_points(pairing, second, first, -out)
            _check_points(pairing, first, Wall(first.positions[0] + 0.1 * out, -out), out)
            _check_slopes(pairing, *_surfaces(0.1, turn, wide=1.25))
            far = _surface(second.positions + 9.0 * turn[:, 1], second.facets, second.nodes[0])
            if _points(pairing, first, far).gap.size:
                raise CheckFailed("surfaces that do not face each other have points")
            tilted = _surfaces(0.1, turn, wide=0.6, tilt=0.1)
            found = _points(pairing, *tilted)
            wide, edge = (area ** (1 / (dim - 1)) for area in (found.weight.sum(), tilted[0].areas.max()))
            if not (found.weight > 0).all() or abs(wide - 0.6 * WIDTH) > edge:
                raise CheckFailed(f"of a surface covered by {0.6 * WIDTH:g} the areas of the points are {found.weight}")
            _check_slopes(pairing, *_surfaces(0.1, turn, wide=0.6))
            forces = np.einsum("p,pij->ij", found.weight * found.gap, _rows(found, *tilted))
            seen.append(forces @ turn)
        if np.ptp(seen, axis=0).max() > CLOSE:
            raise CheckFailed("surfaces that are turned or seen in a mirror have other points")


def _check_points(pairing: Any, first: Surface, second: Surface | Wall, out: Floats) -> None:
    """Raise `CheckFailed` unless two surfaces, apart by 0.1 along `out`, have points as a pairing must make them."""
    found = _points(pairing, first, second)
    whole = WIDTH ** (out.size - 1)
    if not (found.weight > 0).all() or abs(found.weight.sum() - whole) > CLOSE:
        raise CheckFailed(f"the areas of the points are {found.weight}, {found.weight.sum():.6g} in all, not {whole:g}")
    if np.abs(found.gap - 0.1).max() > CLOSE or np.abs(found.normal - out).max() > CLOSE:
        raise CheckFailed(f"gaps are {found.gap} and normals {found.normal[0]}, expected 0.1 and {out}")
    rows = _rows(found, first, second)
    for surface, expected in ((first, -out), (second, out)):
        if isinstance(surface, Wall):
            continue
        if np.abs(rows[:, surface.nodes].sum(axis=1) - expected).max() > CLOSE:
            raise CheckFailed("the gap does not change by the distance of its surfaces")


def _check_slopes(pairing: Any, *surfaces: Surface) -> None:
    """Raise `CheckFailed` unless the rows of two surfaces are the slopes of the gaps, and rotations leave them."""
    rows, places = _rows(_points(pairing, *surfaces), *surfaces), np.concatenate([s.positions for s in surfaces])
    if np.abs(np.einsum("pnd,nd->p", rows, places @ SPIN[: places.shape[1], : places.shape[1]])).max() > CLOSE:
        raise CheckFailed("a gap changes if both bodies turn as one")

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
    if np.isnan(wrong).all(axis=0).sum() > 0.5 * len(rows):
        raise CheckFailed("gaps are not those of their rows: most of them are larger")
    wrong = np.nan_to_num(wrong)
    if wrong.max() > 1e-6:
        raise CheckFailed(f"the slope of a gap by a displacement is not that of its row, by up to {wrong.max():.3g}")


@demand("pairings")
def check_patch_test(subject: Subject) -> None:
    """A uniform pressure passes as declared.

    Two strips of 5 and 7 cells across, whichever is the first, are in balance with a uniform pressure on both sides of
    their contact if `passes_patch_test` is declared: each node gets the force that it has by the pressure on its own
    surface, so that the stress in both strips is uniform.
    """
    worst = 0.0
    for dim, pairing in _with_dimensions(subject):
        for first, second in (_surfaces(0.0, np.eye(dim)), _surfaces(0.0, np.eye(dim))[::-1]):
            found = _points(pairing, first, second)
            forces = np.einsum("p,pij->ij", found.weight, _rows(found, first, second))
            for surface in (first, second):
                area = np.bincount(surface.facets.ravel(), surface.of_nodes().ravel())
                expected = -area[:, None] * surface.normals[0]
                wrong = np.abs(forces[surface.nodes] - expected).max(axis=1) / area
                worst = max(worst, float(wrong.max()))
    if not pairing.passes_patch_test:
        hint = "; yet it passes: declare it" if worst <= UNIFORM else f", and pressures are wrong by {worst:.2g}"
        raise NotApplicable(f"it does not declare `passes_patch_test = True`{hint}")
    if worst > UNIFORM:
        raise CheckFailed(f"it declares `passes_patch_test = True`, and pressures at nodes are wrong by {worst:.3g}")


@demand("pairings")
def check_shares(subject: Subject) -> None:
    """Shares and points are as declared.

    The shares of each surface in a gap add up to 1. With `convex`, as by default, none is negative. Without
    `more_points_than_nodes` there are at most as many points as nodes of the first surface: a law without compliance
    needs that.
    """
    for dim, pairing in _with_dimensions(subject):
        for first, second in (_surfaces(0.1, np.eye(dim)), _surfaces(0.1, np.eye(dim))[::-1]):
            found = _points(pairing, first, second)
            shares = np.einsum("pnd,pd->pn", _rows(found, first, second), found.normal)
            shares[:, first.nodes] *= -1.0
            for surface in (first, second):
                sums = shares[:, surface.nodes].sum(axis=1)
                if abs((most := sums[np.abs(sums - 1.0).argmax()]) - 1.0) > CLOSE:
                    raise CheckFailed(f"the shares of a surface in a gap add up to {most:.3g}, expected 1")
            if pairing.convex and shares.min() < -CLOSE:
                raise CheckFailed(f"a node has the share {shares.min():.3g} in a gap: declare `convex = False`")
            if found.gap.size > len(first.nodes) and not pairing.more_points_than_nodes:
                raise CheckFailed(
                    f"{len(first.nodes)} nodes have {found.gap.size} points: declare `more_points_than_nodes = True`"
                )


def _with_dimensions(subject: Subject) -> Iterator[tuple[int, Any]]:
    """Yield each example of a pairing with each number of dimensions in which it pairs surfaces."""
    for _, pairing in subject.made():
        yield from ((dim, pairing) for dim in pairing.dimensions)


def _turned(angle: float, dim: int) -> Floats:
    """Return a rotation by an angle in the plane of the first two axes, and in three dimensions about the first too."""
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return turn[:2, :2] if dim == 2 else turn @ np.roll(turn, 1, axis=(0, 1))


def _points(pairing: Any, first: Surface, second: Surface | Wall) -> PairedPoints:
    found: PairedPoints = answer(pairing, "points", first, second)
    known = first.nodes if isinstance(second, Wall) else np.concatenate([first.nodes, second.nodes])
    if not np.isin(found.node, known).all():
        raise CheckFailed("a point has a node that is on neither surface")
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
