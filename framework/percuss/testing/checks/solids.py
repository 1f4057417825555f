"""Checks of shapes and elements that are no bars, and of pairings."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.mesh.cells import element_masses, is_solid, lumping_of
from percuss.mesh.surfaces import surface_of
from percuss.methods.interfaces import BodyMesh, Floats, Mesh, Region, Surface, Wall
from percuss.methods.plugin_calls import answer
from percuss.testing.bodies import BodyKernels, patch, slopes, uneven
from percuss.testing.checks.bulk import elastic
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check

CLOSE = 1e-9


@check("elements")
def check_solid_forces(subject: Subject) -> None:
    """A rigid body has no force, and forces belong to an energy.

    Translations and small rotations of a body of uneven cells give no force. Internal forces have no resultant and no
    moment, and are minus the slope of the energy. A uniform strain leaves a node inside without force. The mass is that
    of the body, and each node has some.
    """
    for _, element in subject.made():
        if not is_solid(element):
            raise NotApplicable("it is an element along a line, or sees the strain of single points")
        kernels = BodyKernels(element, elastic(subject, young=2.0, density=3.0, poisson=0.3), patch(element.cell))
        x, force = kernels.body.mesh.nodes, kernels.checked_force()
        size = float(np.abs(force).max())
        if np.abs(kernels.force(1e-3 * np.stack([-x[:, 1], x[:, 0]], axis=1))).max() > CLOSE * size:
            raise CheckFailed("a small rotation of the body gives a force")
        if abs(float((x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0]).sum())) > CLOSE * size:
            raise CheckFailed("the internal forces have a moment")
        uniform = kernels.force(1e-3 * x @ np.array([[1.0, 0.3], [-0.2, 0.5]]))
        if np.abs(uniform[4]).max() > CLOSE * np.abs(uniform).max():
            raise CheckFailed("a uniform strain gives a force on a node inside: it fails the patch test")
        masses = element_masses(element, kernels.body, kernels.material.rho)
        nodal, total = lumping_of(element, kernels.body).at_nodes(masses), float(masses.sum())
        if not (nodal > 0).all() or abs(nodal.sum() - total) > CLOSE * total:
            raise CheckFailed(f"the nodes have the masses {nodal} of a body of {total:.6g}")


@check("materials")
def check_solid_stress(subject: Subject) -> None:
    """Stress belongs to an energy and turns along.

    At rest there is no stress. Stress is the slope of the energy that the material stores, and turns with a body that
    turns unless the material is linear. Waves of small strains are no faster than `wave_modulus` says.
    """
    tried = False
    for _, material in subject.made():
        for dim, plane in ((2, "strain"), (3, "")):
            kernel = getattr(material, f"stress_{dim}d", None)
            if kernel is None:
                continue
            try:
                parameters = np.array(answer(material, "solid_parameters", plane))
            except ValueError:  # of a bar alone, or not in this plane
                continue
            tried = True
            _check_kernel(material, kernel, parameters, dim, float(answer(material, "wave_modulus", plane)))
    if not tried:
        raise NotApplicable("no example of it is one of bodies that are no bars")


def _check_kernel(material: Any, kernel: Any, parameters: Floats, dim: int, modulus: float) -> None:
    stored = getattr(material, f"stored_{dim}d")

    def stress(gradient: Floats) -> Floats:
        return np.array(kernel(parameters, tuple(gradient.ravel().tolist()))).reshape(dim, dim)

    def energy(gradient: Floats) -> float:
        return (
            0.5 * float((stress(gradient) * gradient).sum()) if stored is None else stored(parameters, gradient.ravel())
        )

    if np.abs(stress(np.zeros((dim, dim)))).max() > CLOSE * modulus:
        raise CheckFailed(f"a body at rest has stress in {dim} dimensions")
    gradient = 0.05 * uneven(dim, dim)
    found, slope = stress(gradient), slopes(energy, gradient, 1e-6)
    k = int(np.argmax(np.abs(slope - found)))
    here, there = found.flat[k], slope.flat[k]
    if abs(there - here) > 1e-7 * modulus:
        raise CheckFailed(f"in {dim} dimensions the stress is {here:.6g} and the slope of the energy {there:.6g}")
    if not material.linear:
        turn = np.eye(dim)
        turn[:2, :2] = [[0.6, -0.8], [0.8, 0.6]]
        turned = turn @ (np.eye(dim) + gradient) - np.eye(dim)
        if np.abs(stress(turned) - turn @ found).max() > CLOSE * modulus:
            raise CheckFailed(f"in {dim} dimensions the stress does not turn with the body")
    tangent = slopes(stress, np.zeros((dim, dim)), 1e-7)
    fastest = float(np.linalg.eigvals(tangent[0, :, :, 0]).real.max())  # of waves along x
    if fastest > modulus * (1.0 + 1e-5):
        raise CheckFailed(
            f"in {dim} dimensions waves have the modulus {fastest:.6g}, and `wave_modulus` is {modulus:.6g}"
        )


@check("shapes")
def check_solid_mesh(subject: Subject) -> None:
    """The mesh is closed by its regions.

    Cells have positive volumes. The regions together are the whole boundary, and their facets turn outwards. `refine`
    moves no region.
    """
    for _, shape in subject.made():
        if shape.cell == "line":
            raise NotApplicable("its mesh is a line")
        element = next(
            made for name in subject.registry.names("elements")
            if getattr(made := subject.registry.get("elements", name), "cell", "") == shape.cell
        )()  # fmt: skip
        start = np.array([0.3, -0.7, 0.2])[: shape.dimension()]
        extents = []
        for refine in (1, 2):
            body = BodyMesh(answer(shape, "mesh", start, refine), 1.3, "strain")
            volumes = np.asarray(answer(element, "volumes_of_cells", body))
            if not (volumes > 0).all():
                raise CheckFailed(f"a cell has the volume {volumes.min():.6g}")
            surfaces = [surface_of(body, name, 0, volumes).surface for name in shape.regions]
            closed = sum(surface.areas @ surface.normals for surface in surfaces)
            # Of a closed surface the fluxes of x, y and z are its volume each.
            flux = sum(
                np.einsum("f,fd,fd->d", s.areas, s.normals, s.positions[s.facets].mean(axis=1)) for s in surfaces
            )
            if np.abs(closed).max() > CLOSE or np.abs(np.asarray(flux) - volumes.sum()).max() > 1e-2 * volumes.sum():
                raise CheckFailed(f"its regions do not enclose its volume {volumes.sum():.6g}: they flow {flux}")
            extents.append([(s.positions.min(axis=0), s.positions.max(axis=0)) for s in surfaces])
        if not np.allclose(extents[0], extents[1], atol=CLOSE):
            raise CheckFailed("`refine` moves a region")


@check("pairings")
def check_pairing(subject: Subject) -> None:
    """Points move with their surfaces.

    The areas of the points add up to that of the surface that has partners. Both bodies moved as one leave the gaps,
    and moved apart along the normal they open by the distance. The answer turns with the surfaces.
    """
    for _, pairing in subject.made():
        for angle in (0.0, 0.7, 2.9):
            first, second, out = _surfaces(5, 7, 0.1, angle)
            wall = Wall(first.positions[0] + 0.2 * out, -out)
            for other, gap in ((second, 0.1), (wall, 0.2)):
                found = pairing.points(first, other)
                if abs(found.weight.sum() - first.areas.sum()) > CLOSE:
                    raise CheckFailed(
                        f"the areas of the points are {found.weight.sum():.6g}, not {first.areas.sum():.6g}"
                    )
                if np.abs(found.gap - gap).max() > CLOSE or np.abs(found.normal - out).max() > CLOSE:
                    raise CheckFailed(f"gaps are {found.gap} and normals {found.normal[0]}, expected {gap} and {out}")
                for p in range(found.gap.size):
                    inside = slice(found.start[p], found.start[p + 1])
                    of_first = np.isin(found.node[inside], first.nodes)
                    for side, expected in ((of_first, -out), (~of_first, out if other is second else 0.0 * out)):
                        if np.abs(found.value[inside][side].sum(axis=0) - expected).max() > CLOSE:
                            raise CheckFailed("the gap does not change by the distance of its surfaces")


def _surfaces(first: int, second: int, gap: float, angle: float) -> tuple[Surface, Surface, Floats]:
    """Return two straight surfaces that face each other, and the normal from one to the other."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    made: list[Surface] = []
    for count, x, sign in ((first, 0.0, 1.0), (second, gap, -1.0)):
        y = sign * (np.arange(count + 1) / count - 0.5) * 0.8
        nodes = np.stack([np.full(count + 1, x), y], axis=1) @ turn.T
        facets = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
        mesh = Mesh(nodes, {"line": facets}, {"all": Region((), np.zeros(2), {"line": facets})})
        surface = surface_of(BodyMesh(mesh, 1.0), "all", len(made) * 100, np.ones(count)).surface
        made.append(surface)
    return made[0], made[1], turn @ np.array([1.0, 0.0])
