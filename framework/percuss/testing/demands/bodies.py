"""Demands on elements, materials and masses, with the small bodies of unlike cells on which they are checked."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from percuss.case.defaults import DEFAULTS
from percuss.jit import Kernel, plain
from percuss.jsonable import Entries
from percuss.mesh import cells as of_cells
from percuss.mesh.cell_kernels import add_up_forces, energy_of_cells
from percuss.mesh.cell_stiffness import frequencies_of_cells
from percuss.mesh.cells import cells_of, element_masses, has_cells, is_solid, lumping_of, volumes_of
from percuss.mesh.element_probe import ElementProbe
from percuss.mesh.materials import MaterialPoints, solid_slots
from percuss.methods import slots
from percuss.methods.interfaces import BodyMesh, Floats, Lumping, Mass, Material, Mesh, Region, SolidMaterial
from percuss.methods.plugin_calls import answer
from percuss.methods.registry import Registry
from percuss.testing.draws import largest_difference, must_balance, must_compile, per_cent
from percuss.testing.subject import ROUND_OFF, NotApplicable, Subject, demand, must, must_vanish

SECTION = 1.3
EXACT = 1e-10  # largest relative error of a mass, a volume, or an answer that is declared linear
STEP = 1e-6  # of difference quotients: of energies, and of strains relative to these
# What `block` calls the cells that fill it, and the dimensions of their block.
BLOCKS = {"quad": ("quad4", 2), "triangle": ("tri3", 2), "hexahedron": ("hex8", 3), "tetra": ("tet4", 3)}
UNITS_OF_MASS = tuple(k / 10.0 for k in range(1, 31))  # powers of two leave all results the same to the last bit
CYCLE_STEPS = 400  # steps of each quarter of a cycle of strain
UNACCOUNTED = 1e-2  # share of the work along a cycle of strain that may be neither stored nor dissipated
UNLIKE = np.array([2.0, 1.0, 4.0, 0.5, 3.0])  # masses of the elements of a line
EVEN = [np.ones(count) for count in range(1, 13)]
TOUCHING = {"no": [], "the first": [0], "the last": [-1], "the first and the last": [0, -1]}  # nodes in contact
ELASTIC = 1e-4  # strain at which a material with state variables is taken as elastic
CYCLES, COUNTED = 1000, 10  # of elastic strain, and how many times their drift is counted, for 10 000 of them
CYCLE_SIZES = 0.1, 0.01, 1e-3  # strains at which a material with state variables may still be elastic
PATH = 200  # steps of a path of strain
LEAST_SLOPE = 0.9  # share of the modulus that the slope of the stress must reach at some strain
SMALL, LARGE = 1e-3, 40.0  # how far nodes of a small body move, and how many times as far in finite strain
UNSTRAINED = "there is stress or energy without strain"
DIRECTIONS = 500  # of waves, whose fastest is sought
HELD = 1e-4  # least stiffness of a mode of a cell, relative to the largest one
STABLE = 1e-6  # largest negative modulus of a wave, relative to the largest
SHEARED = np.array([[1.0, 0.3, 0.1], [-0.2, 0.5, 0.2], [0.15, -0.1, 0.7]])
TURN = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
SPIN = np.array([[0.0, 1.0, -0.3], [-1.0, 0.0, 0.5], [0.3, -0.5, 0.0]])


# ------------------------------------------------------------------------------------- bodies and their kernels


def line(count: int, dim: int = 1) -> Mesh:
    """Return a line mesh of unlike elements, along an oblique direction in two and three dimensions."""
    direction = np.array([1.0, 2.0, -2.0][:dim])
    direction /= np.linalg.norm(direction)
    lengths = 0.1 * (1.0 + 0.2 * np.cos(np.arange(count)))
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    regions = {"left": Region((0,), -direction), "right": Region((count,), direction)}
    return Mesh.of_line(along[:, None] * direction, lengths, direction, regions)


def patch(cell: str, registry: Registry) -> Mesh:
    """Return two by two cells of uneven sizes in a block round a node inside, its middle one; in space two in each way.

    Raises
    ------
    NotApplicable
        If there is no block of such cells.
    """
    if cell not in BLOCKS:
        raise NotApplicable(f"the kit has no block of {cell} cells")
    kind, dim = BLOCKS[cell]
    block: Any = registry.get("shapes", "block")
    shape = block(size=(1.2, 1.1, 1.3)[:dim], elements=(2, 2, 2)[:dim], cells=kind, grading=(1.4, 0.7, 1.2)[:dim])
    mesh: Mesh = shape.mesh(np.zeros(dim), 1)
    nodes = mesh.nodes.copy()
    nodes[len(nodes) // 2] += np.array([0.08, -0.05, 0.06])[:dim]
    return Mesh(nodes, mesh.cells, {})


def uneven(*shape: int) -> Floats:
    """Return an array of numbers between -1 and 1 without any order."""
    return np.asarray(np.cos(np.arange(math.prod(shape)) ** 2.0).reshape(shape), dtype=float)


def slopes(function: Callable[[Floats], Any], at: Floats, step: float) -> Floats:
    """Return the symmetric difference quotients of a function by the entries of its argument, which come first."""
    steps = step * np.eye(at.size).reshape(-1, *at.shape)
    found = np.array([function(at + one) - function(at - one) for one in steps]) / (2.0 * step)
    return found.reshape(*at.shape, *found.shape[1:])


class SolidKernels(NamedTuple):
    """A material of bodies that are no bars, in one plane or in space.

    Attributes
    ----------
    dim, plane
        Number of dimensions, and the plane, empty in space.
    modulus
        What `wave_modulus` says.
    points
        Its parameters and state, as the kernels of a run receive them.
    stored_in
        The state variable that is the energy it stores, None of a material without state.
    stress_kernel, energy_kernel
        The kernels of a run in plain Python.
    """

    dim: int
    plane: str
    modulus: float
    points: MaterialPoints
    stored_in: int | None
    stress_kernel: Kernel
    energy_kernel: Kernel

    def stress(self, gradient: Floats) -> Floats:
        """Return the stress, (dim, dim), of a displacement gradient, (dim, dim)."""
        return np.reshape(self.stress_kernel(self.points, 0, tuple(gradient.ravel().tolist())), gradient.shape)

    def energy(self, gradient: Floats) -> float:
        """Return the stored energy per volume of a displacement gradient, (dim, dim)."""
        if self.stored_in is not None:
            self.stress(gradient)
            return float(self.points.after[0, self.stored_in])
        return float(self.energy_kernel(self.points, 0, gradient.ravel(), gradient.ravel()))


def solid_kernels(material: Any) -> Iterator[SolidKernels]:
    """Yield the kernels of a material in each plane, and in space, in which it works."""
    for dim, plane in ((2, "strain"), (2, "stress"), (3, "")):
        if getattr(material, f"stress_{dim}d", None) is None:
            continue
        try:
            parameters = of_cells.solid_parameters(material, plane)
        except ValueError:  # of a bar alone, or not in this plane
            continue
        filled, before = solid_slots(material, dim), np.zeros((1, material.state))
        asked = filled[slots.stress_2d if dim == 2 else slots.stress_3d], filled[slots.energy_density]
        kernels = (plain(kernel, filled) for kernel in asked)
        modulus = float(answer(material, "wave_modulus", plane))
        points = MaterialPoints(parameters, before, before.copy())
        yield SolidKernels(dim, plane, modulus, points, material.stored_in, *kernels)


@dataclass(frozen=True)
class FiniteStrain(SolidMaterial):
    """Hooke's law of Green's strain: no rotation of the body gives stress.

    Formula: ``P = F (tr(E) I + 2 E)``, ``E = (F^T F - I) / 2``, ``F = I + H``.
    """

    name = "finite-strain"
    summary = "Hooke's law of Green's strain"
    rho = 3.0

    def wave_modulus(self, plane: str) -> float:  # noqa: ARG002
        """Return 3."""
        return 3.0

    def solid_parameters(self, plane: str) -> tuple[float, ...]:  # noqa: ARG002
        """Return nothing."""
        return ()

    @staticmethod
    def stress_2d(parameters: Floats, gradient: tuple[float, ...]) -> tuple[float, ...]:  # noqa: ARG004
        """Return the stress of a displacement gradient."""
        deformed, strain = _strained(gradient)
        return tuple((deformed @ (np.trace(strain) * np.eye(len(strain)) + 2.0 * strain)).ravel().tolist())

    @staticmethod
    def stored_2d(parameters: Floats, gradient: Floats) -> float:  # noqa: ARG004
        """Return the stored energy per volume."""
        _, strain = _strained(gradient)
        return float(0.5 * np.trace(strain) ** 2 + (strain**2).sum())

    stress_3d, stored_3d = stress_2d, stored_2d


def _strained(gradient: Any) -> tuple[Floats, Floats]:
    """Return deformation gradient and Green's strain of a displacement gradient."""
    identity = np.eye(math.isqrt(np.size(gradient)))
    deformed = identity + np.reshape(gradient, identity.shape)
    return deformed, 0.5 * (deformed.T @ deformed - identity)


class BodyKernels:
    """Force and energy of a body, from the kernels of its element and material in plain Python.

    Parameters
    ----------
    element, material
        The methods of the body.
    mesh
        Its mesh as a shape makes it; all three are attributes too.

    Attributes
    ----------
    body
        The body as its element receives it.
    probe
        The force of single elements.
    about_axis
        Whether it is a body of revolution.
    """

    def __init__(self, element: Any, material: Any, mesh: Mesh) -> None:
        self.element, self.material, self.mesh = element, material, mesh
        self.about_axis = bool(getattr(element, "about_axis", False))
        flat = is_solid(element) and mesh.nodes.shape[1] == 2
        plane = "axisymmetric" if self.about_axis else "strain" if flat else ""
        section = 1.0 if self.about_axis or (is_solid(element) and not flat) else SECTION
        self.body = BodyMesh(of_cells.mesh_of_element(element, mesh), section, plane)
        self.probe = ElementProbe(element, material, self.body)
        points = of_cells.points_at_rest(element, material, self.body)
        slots = {**of_cells.slots_of_material(element, material), **of_cells.element_slots(element)}
        if has_cells(element):
            kernels: Any = (add_up_forces, energy_of_cells)
            cells = of_cells.cell_arrays(element, [self.body])
            arguments: tuple[Any, ...] = (cells, points, 0)
        else:
            kernels = (element.internal_force, element.energy)
            arguments = (element.bind(self.body), points, 0, mesh.nodes.shape[1])
        self._force, self._energy = (partial(plain(kernel, slots), *arguments) for kernel in kernels)

    @property
    def motion(self) -> Floats:
        """Small displacements without any order, (nodes, dim)."""
        return SMALL * uneven(*self.body.mesh.nodes.shape)

    def force(self, displacement: Floats) -> Floats:
        """Return the internal force on the nodes, (nodes, dim); nan where the kernel leaves an entry unset."""
        force = np.full(displacement.size, np.nan)
        self._force(displacement.ravel(), force)
        return force.reshape(displacement.shape)

    def energy(self, displacement: Floats) -> float:
        """Return the strain energy at rest."""
        return float(self._energy(displacement.ravel(), np.zeros(displacement.size), 0.0))

    def checked_force(self) -> Floats:
        """Return the force of `motion`, (nodes, dim).

        Raises
        ------
        CheckFailed
            Unless it is minus the slope of the energy, has no resultant, is the same in another place, and is the sum
            of the forces of single elements.
        """
        u, dim = self.motion, self.body.mesh.nodes.shape[1]
        force = self.force(u)
        size = float(np.abs(force).max())
        kernel = "force" if has_cells(self.element) else "internal_force"
        must(not np.isnan(force).any(), f"`{kernel}` leaves an entry unset: it must set every entry, not add to it")
        slope = slopes(self.energy, u, STEP)
        i = int(np.argmax(np.abs(force + slope)))
        words = f"entry {i} of the force is {force.flat[i]:.6g}, minus the slope of the energy {-slope.flat[i]:.6g}"
        must_vanish((force + slope) / size, words, 1e-6)
        rigid = np.arange(1.0, dim + 1.0)
        rigid[: int(self.about_axis)] = 0.0  # a ring moves along its axis alone
        words = f"the sum of the internal forces is not zero in {dim} dimensions"
        must_vanish(force.sum(axis=0)[rigid > 0.0] / size, words)
        moved = self.force(u + 1e-3 * rigid)
        must_vanish((moved - force) / size, "a translation of the body changes its internal force")
        of_elements = np.zeros(u.shape)
        for number, nodes in enumerate(cells_of(self.body.mesh)):
            of_elements[nodes] += self.probe.force(number, u[nodes].ravel()).reshape(-1, dim)
        words = "the forces of single elements, from `first` on, do not add up to that of the whole body"
        must_vanish((of_elements - force) / size, words)
        return force

    def check_large_strains(self) -> None:
        """Raise `CheckFailed` unless at large strains the work against the force is what the energy gains."""
        large, along = LARGE * self.motion, self.motion[::-1]
        work = -float((self.force(large) * along).sum())
        gained = float(slopes(lambda share: self.energy(large + share[0] * along), np.zeros(1), 1e-3)[0])
        words = f"at large strains a motion gains the energy {gained:.6g}, and the work against the force is {work:.6g}"
        must(abs(gained - work) <= 1e-6 * abs(work), words)


# ------------------------------------------------------------------------------------------------------- runs


@demand("elements", "materials", "pairings")
def check_blocks(subject: Subject) -> None:
    """Two blocks collide in a run with it.

    The kernels are compiled, momentum and energy are balanced, the run gives the same bits if it is made again, and the
    same numbers in plain Python.
    """
    found = [_blocks(subject, made, options) for options, made in subject.made()]
    if not any(found):
        raise NotApplicable("none of its examples has bodies that are no bars")
    for case in filter(None, found):
        result = subject.run(case)
        must_compile(result)
        must_balance(result)
        for words, compiled, allowed in (("made again", True, 0.0), ("in plain Python", False, ROUND_OFF)):
            other = largest_difference(result.arrays, subject.run(case, compiled=compiled).arrays)
            must(other <= allowed, f"the run {words} differs by {per_cent(other)} of its peak")


def _blocks(subject: Subject, made: Any, options: Entries) -> Entries:
    """Return a case of two blocks that collide, with an element, material or pairing; nothing if it is one of bars."""
    dim, cells, plane, speed = 2, "", "strain", 1e-3
    if subject.family == "pairings":
        dim = made.dimensions[0]
    elif subject.family == "elements":
        if made.cell not in BLOCKS:
            return {}
        cells, dim = BLOCKS[made.cell]
        plane = "axisymmetric" if made.about_axis else plane
    else:
        solid = next(solid_kernels(made), None)
        if solid is None:
            return {}
        dim, plane, speed = solid.dim, solid.plane, speed * float(np.sqrt(solid.modulus / made.rho))
    cells = cells or ("hex8" if dim == 3 else "quad4")
    body: Entries = {"material": {"young": 1.0, "density": 1.0, "poisson": 0.3}}
    body |= {"plane": plane} if dim == 2 else {}

    def block(at: float, elements: list[int], velocity: list[float]) -> Entries:
        shape = {"size": [1.0, 0.5, 0.4][:dim], "elements": elements[:dim], "cells": cells}
        return {"block": shape, "at": [at, 0.0, 0.0][:dim], "velocity": velocity[:dim], **body}

    bodies = {
        "left": block(0.0, [3, 2, 2], [speed, 0.0, 0.0]),
        "right": block(1.0, [2, 3, 1], [0.0, 0.1 * speed, 0.0]),
    }
    contacts = {"seam": {"between": ["left.right", "right.left"]}}
    method, time = {"contact": "regularised-lagrange"}, {"steps": 40, "courant": 0.5}
    case = {"percuss": 1, "bodies": bodies, "contacts": contacts, "method": method, "time": time}
    return subject.placed(case, options)


# -------------------------------------------------------------------------------------------------- materials


@demand("materials")
def check_stress_and_energy(subject: Subject) -> None:
    """Stress is the slope of the energy.

    Stress is the derivative of the energy density. It is zero at zero strain and has the sign of the strain.
    `modulus` is the largest slope of the stress at strains up to 5 %: wave speed, critical step and penalty scales
    use it. The energy ledger uses the energy density. For a material with state variables, the work of the stress
    along a cycle of strain is the energy that it stores and has dissipated.
    """
    subject.along_line()
    cls: Any = subject.component
    for _, material in subject.made():
        parameters, modulus = np.array(material.parameters(), dtype=float), material.modulus
        must(material.rho > 0 and modulus > 0, f"density {material.rho} and modulus {modulus} must be positive")
        (_check_cycle if cls.state else _check_slopes)(cls, parameters, modulus)


def _check_cycle(cls: Any, parameters: Floats, modulus: float) -> None:
    """Raise `CheckFailed` if along a cycle of strain the stress is too steep, or its work is not accounted for."""
    turns = [0.0, *(sign * size for size in (1e-4, 2e-3, 0.05) for sign in (1.0, -1.0, 1.0, 0.0))]
    ways = [np.linspace(*ends, CYCLE_STEPS + 1)[1:] for ends in itertools.pairwise(turns)]
    strain = np.concatenate([[0.0], *ways])
    stress, states = np.zeros(strain.size), np.zeros((strain.size + 1, cls.state))  # at the start there is none
    for k in range(strain.size):
        states[k + 1] = states[k]
        stress[k] = cls.stress(parameters, strain[k], states[k], states[k + 1])
    stored = states[1:, cls.stored_in]
    dissipated = 0.0 * stored if cls.dissipated_in is None else states[1:, cls.dissipated_in]
    must(stress[0] == 0.0 and stored[0] == 0.0, UNSTRAINED)
    steep = np.abs(np.diff(stress)) <= modulus * (np.abs(np.diff(strain)) * (1.0 + 1e-6) + 1e-12)
    must(steep.all(), f"at strain {strain[1:][steep.argmin()]:.3g} it is stiffer than its modulus")
    work = cumulative_trapezoid(stress, strain, initial=0.0)
    grows = np.diff(dissipated) >= -1e-12 * np.maximum.accumulate(work)[1:]
    must(grows.all(), f"at strain {strain[1:][grows.argmin()]:.3g} the energy that it has dissipated decreases")
    missing, allowed = work[-1] - stored[-1] - dissipated[-1], UNACCOUNTED * work.max()
    must(
        missing >= -allowed and (cls.dissipated_in is None or missing <= allowed),
        f"along a cycle of strain the work of the stress is {work[-1]:.6g}, it stores {stored[-1]:.6g} and has "
        f"dissipated {dissipated[-1]:.6g}",
    )


def _check_slopes(cls: type[Material], parameters: Floats, modulus: float) -> None:
    """Raise `CheckFailed` unless stress is the slope of the energy, and `modulus` the largest slope of the stress."""
    must(cls.stress(parameters, 0.0) == 0.0 and cls.energy_density(parameters, 0.0, 0.0) == 0.0, UNSTRAINED)
    strain = np.outer(np.geomspace(1e-10, 0.05, 18), (1.0, -1.0)).ravel()
    ends = strain * (1.0 - STEP), strain * (1.0 + STEP)
    stress, *stresses = (np.array([cls.stress(parameters, one) for one in at]) for at in (strain, *ends))
    energies = (np.array([cls.energy_density(parameters, one, one) for one in at]) for at in ends)
    slope, gradient = ((after - before) / (ends[1] - ends[0]) for before, after in (stresses, energies))
    k = int((stress * strain).argmin())
    must(stress[k] * strain[k] >= 0.0, f"at strain {strain[k]:.3g} the stress is {stress[k]:.6g}: tension is positive")
    steepest = np.maximum(slope, stress / strain)
    k, most = int(steepest.argmax()), float(steepest.max())
    must(most <= modulus * (1.0 + 1e-6), f"at strain {strain[k]:.3g} it is stiffer ({most:.6g}) than its modulus")
    k = int((np.abs(gradient - stress) - 1e-5 * np.abs(stress)).argmax())
    words = f"at strain {strain[k]:.3g} stress is {stress[k]:.6g}, the slope of the energy {gradient[k]:.6g}"
    must(abs(gradient[k] - stress[k]) <= 1e-5 * abs(stress[k]), words)
    words = f"the largest slope of the stress is {most:.6g} at strains up to 5 %, and `modulus` is {modulus:.6g}"
    must(most >= LEAST_SLOPE * modulus, words)


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
    dim, modulus, where = solid.dim, solid.modulus, f"in {solid.dim} dimensions"
    tangent = slopes(solid.stress, np.zeros((dim, dim)), 1e-7)
    along = np.random.default_rng(0).normal(size=(DIRECTIONS, dim))
    along /= np.linalg.norm(along, axis=1)[:, None]
    waves = np.linalg.eigvals(np.einsum("ki,jilm,km->kjl", along, tangent.transpose(2, 3, 0, 1), along)).real
    slowest, fastest = float(waves.min()), float(waves.max())
    must(
        modulus > 0.0 and slowest >= -STABLE * np.abs(waves).max(),
        f"{where} the tangent at rest gives waves of the moduli {slowest:.6g} to {fastest:.6g}, and `wave_modulus` is "
        f"{modulus:.6g}: none may be negative",
    )
    must_vanish(solid.stress(np.zeros((dim, dim))) / modulus, f"a body at rest has stress {where}")
    large = 0.05 if solid.stored_in is None else ELASTIC
    gradient = large * uneven(dim, dim)
    stress, slope = solid.stress(gradient), slopes(solid.energy, gradient, 2e-5 * large)
    k = int(np.argmax(np.abs(slope - stress)))
    here, there = stress.flat[k], slope.flat[k]
    words = f"{where} the stress is {here:.6g} and the slope of the energy {there:.6g}"
    must(abs(there - here) <= 1e-7 * modulus, words)
    turn = TURN[:dim, :dim]
    turned = solid.stress(turn @ (np.eye(dim) + gradient) - np.eye(dim)) - turn @ stress
    of_small_strain = stress - solid.stress(0.5 * (gradient + gradient.T))
    wrong = min(np.abs(turned).max(), np.abs(of_small_strain).max())
    must_vanish(wrong / modulus, f"{where} the stress does not turn with the body")
    words = f"{where} the fastest waves have the modulus {fastest:.6g}, `wave_modulus` is {modulus:.6g}"
    must(0.99 * modulus <= fastest <= modulus * (1.0 + 1e-5), words)


@demand("materials")
def check_solid_state(subject: Subject) -> None:
    """State variables turn with the body, and energy is accounted for.

    Along a path of strain stress and energies are the same if the body turns at the same time. The dissipated energy
    never falls, and the work of the stress is the energy that is stored and dissipated. A call of the kernel leaves
    `before` alone, and the kernel remembers no other call. Unloading is elastic: it dissipates nothing, and gives
    back what is stored. Closed cycles of strain that dissipate nothing leave the stress as it was: what 1 000 of them
    change counts ten times.
    """
    solids = [
        (solid, material) for _, material in subject.made() for solid in solid_kernels(material) if material.state
    ]
    if not solids:
        raise NotApplicable("none of its examples has state variables in bodies other than bars")
    for solid, material in solids:
        _check_path(solid, material)


def _check_path(solid: SolidKernels, material: Any) -> None:
    dim, identity, dissipated = solid.dim, np.eye(solid.dim), material.dissipated_in
    still, moving = solid, solid._replace(points=solid.points._replace(before=solid.points.before.copy()))
    moving = moving._replace(points=moving.points._replace(after=moving.points.after.copy()))
    turn = step_of_turn = TURN[:dim, :dim]
    work, most, last, before, earlier = 0.0, 0.0, np.zeros((dim, dim)), identity, identity
    for k in range(PATH):
        deformed = identity + 0.2 * np.sin(3.0 * np.pi * (k + 1) / PATH) * uneven(dim, dim)
        kept = still.points.before.copy()
        still.stress(2.0 * deformed - before - identity)  # a trial
        stress, turned = still.stress(deformed - identity), moving.stress(turn @ deformed - identity)
        must(np.array_equal(kept, still.points.before), "the kernel writes to the state before the step")
        must_vanish(np.abs(turned - turn @ stress).max() / solid.modulus, "stress does not turn with the body")
        energies = [points.after[0, [material.stored_in, *([dissipated] if dissipated is not None else [])]]
                    for points in (still.points, moving.points)]  # fmt: skip
        must_vanish(np.abs(energies[0] - energies[1]).max() / solid.modulus, "energies change as the body turns")
        state = still.points.after.copy()
        same = np.array_equal(still.stress(deformed - identity), stress) and np.array_equal(still.points.after, state)
        must(same, "the kernel gives another stress or state if it is asked again")
        if dissipated is not None:
            grown = still.points.after[0, dissipated] - kept[0, dissipated]
            must(grown >= 0.0, f"the dissipated energy falls by {-grown:.3g}")
        work += float((0.5 * (stress + last) * (deformed - before)).sum())
        most = max(most, abs(work))
        last, before, earlier, turn = stress, deformed, before, step_of_turn @ turn
        for one in (still, moving):
            one.points.before[:] = one.points.after
    must(np.isfinite(still.points.after).all(), "a state variable is not finite")
    total = float(energies[0].sum())
    words = f"the work of the stress is {work:.6g}, and the energies are {total:.6g} together"
    must(dissipated is None or abs(work - total) <= 0.01 * most, words)
    _check_unloading(still, material, before, (earlier - before) / np.abs(earlier - before).max())


def _check_unloading(solid: SolidKernels, material: Any, deformed: Floats, back: Floats) -> None:
    """Raise `CheckFailed` unless unloading from a state is elastic, and cycles of elastic strain leave it as it is."""
    dim, identity, (before, after) = solid.dim, np.eye(solid.dim), solid.points[1:]
    start, dissipated = before.copy(), material.dissipated_in

    def went(size: float) -> tuple[Floats, float]:
        """Return the stress after a cycle of a size about a state unloaded by it, and what was dissipated so far."""
        for way in (back, back + 0.3 * uneven(dim, dim), back + 0.3 * SHEARED[:dim, :dim]):
            stress = solid.stress(deformed + size * way - identity)
            before[:] = after
        return stress, 0.0 if dissipated is None else float(after[0, dissipated] - start[0, dissipated])

    loaded = solid.stress(deformed - identity)
    unloaded = solid.stress(deformed + ELASTIC * back - identity)
    work = float((0.5 * (loaded + unloaded) * ELASTIC * back).sum())
    freed = work - float(after[0, material.stored_in] - start[0, material.stored_in])
    size, least = ELASTIC, 1e-9 * solid.modulus * ELASTIC**2
    if dissipated is not None:
        lost = float(after[0, dissipated] - start[0, dissipated])
        must(lost <= least, f"unloading by a strain of {ELASTIC:g} dissipates {lost:.3g}")
        must(abs(freed) <= 1e-3 * abs(work), f"in unloading the work is {work:.6g}, of which {freed:.3g} is not stored")
        for larger in CYCLE_SIZES:
            before[:] = start
            if went(larger)[1] <= least:
                size = larger
                break
    before[:] = start
    first, _ = went(size)
    for _ in range(CYCLES):
        last, _ = went(size)
    drift = COUNTED * float(np.abs(last - first).max()) / solid.modulus
    must_vanish(drift, f"{COUNTED * CYCLES} elastic cycles change the stress by {drift:.3g} of the modulus")


# --------------------------------------------------------------------------------------------------- elements


def bodies_of(subject: Subject, *, solid: bool | None = None) -> Iterator[BodyKernels]:
    """Yield a body of unlike cells for each example of an element; along a line one in one to three dimensions each.

    Raises
    ------
    NotApplicable
        If `solid` asks for an element of solids, or for one along a line, and it is another.
    """
    if solid and not all(is_solid(element) for _, element in subject.made()):
        raise NotApplicable("it is an element along a line, or sees the strain of single points")
    elastic: Any = subject.registry.get("materials", DEFAULTS["materials"])
    for _, element in subject.made():
        if is_solid(element) and solid is not False:
            material = elastic(young=2.0, density=3.0, poisson=0.3)
            yield BodyKernels(element, material, patch(element.cell, subject.registry))
        else:
            subject.along_line()
            yield from (BodyKernels(element, elastic(**elastic.examples[0]), line(5, dim)) for dim in (1, 2, 3))


@demand("elements")
def check_force_and_energy(subject: Subject) -> None:
    """Force is minus the slope of the energy.

    The internal force is minus the gradient of the energy. It has no resultant and does not change with a
    translation. This holds for any run of consecutive elements, in one to three dimensions. Otherwise the bulk
    loses momentum or energy. For small strains the force is that of `axial_stiffness`, and each element obtains from
    its material the modulus times its own strain, which a result shows as its stress.
    """
    for kernels in bodies_of(subject, solid=False):
        kernels.checked_force()
        _check_stretched(kernels)


def _check_stretched(kernels: BodyKernels) -> None:
    """Raise `CheckFailed` if an element at small uniform strain has another end force, or another stress."""
    body, mesh, modulus = kernels.body, kernels.body.mesh, kernels.material.modulus
    stiffness = answer(kernels.element, "axial_stiffness", body, modulus)
    for strain in (1e-8, -1e-8, 1e-5, -1e-5):
        for number, nodes in enumerate(cells_of(mesh)):
            displacement = strain * (mesh.nodes[nodes] - mesh.nodes[nodes[0]])
            stress = float(kernels.probe.stresses(np.array([number]), displacement[None, None])[0, 0])
            must(
                abs(stress - modulus * strain) <= 1e-4 * modulus * abs(strain),
                f"stretched by {strain:g} of its length in {mesh.direction.size} dimensions, element {number} has the "
                f"stress {stress:.6g}, expected {modulus * strain:.6g}",
            )
            force = kernels.probe.force(number, displacement)
            pull = float(force[: mesh.direction.size] @ mesh.direction)
            expected = float(stiffness[number] * strain * mesh.lengths[number])
            must(
                abs(pull - expected) <= 1e-4 * abs(expected),
                f"stretched by {strain:g} element {number} pulls its first node along the line by {pull:.6g}, and its "
                f"`axial_stiffness` gives {expected:.6g}",
            )


@demand("elements")
def check_cells(subject: Subject) -> None:
    """A cell keeps its mass and its centre, and its kind tells how many nodes it has.

    The shares of mass of the nodes are positive, add up to 1, and keep the centre of mass of the cell. The volumes
    of its quadrature points add up to the volume of the cell. Two-node elements have none of this.
    """
    for kernels in bodies_of(subject, solid=False):
        element, body = kernels.element, kernels.body
        if not has_cells(element):
            raise NotApplicable("it is a two-node element, with one point and half of its mass at each node")
        places, shares = np.asarray(element.reference_nodes()), np.asarray(element.mass_shares(body))
        right = shares.shape == places.shape and (shares > 0).all() and abs(shares.sum() - 1.0) <= EXACT
        must(right, f"its {places.size} nodes have the shares {shares} of its mass")
        kind = "line" if places.size == 2 else f"line{places.size}"
        must(element.cell == kind, f"`cell` is {element.cell!r}, and it has {places.size} nodes")
        centre = float(shares @ places)
        must_vanish(centre - 0.5, f"the centre of mass of a cell is at {centre:.6g} of its length", EXACT)
        whole = body.section * body.mesh.lengths
        found = np.asarray(element.volumes(body)).sum(axis=1)
        words = "the volumes of the quadrature points of a cell do not add up to its volume"
        must_vanish((found - whole) / whole.max(), words, EXACT)


@demand("elements", "materials")
def check_linear(subject: Subject) -> None:
    """What is declared linear is linear.

    Force or stress is proportional to displacement or strain of any size. Exact solutions, certificates and energy
    guarantees apply only to bodies whose element and material both declare `linear = True`.
    """
    if not subject.component.linear:  # type: ignore[attr-defined]
        raise NotApplicable("it does not declare `linear = True`")
    if subject.family == "materials":
        proportional = all(_proportional_stress(material) for _, material in subject.made())
    else:
        proportional = all(_proportional(kernels.force, kernels.motion.shape) for kernels in bodies_of(subject))
    must(proportional, "it declares `linear = True`, and its answer is not proportional to its input")


def _proportional_stress(material: Material) -> bool:
    """Return whether the stress of a material is `modulus` times the strain at strains of 1e-6 to 10 of either sign.

    Of bodies that are no bars it is whether the stress of a sum of gradients is the sum of their stresses.
    """
    if not all(_proportional(solid.stress, (solid.dim, solid.dim)) for solid in solid_kernels(material)):
        return False
    if material.state or material.stress is None:
        return not material.state
    parameters = np.array(material.parameters(), dtype=float)
    strains = np.outer(np.geomspace(1e-6, 10.0, 15), (1.0, -1.0)).ravel()
    stresses = np.array([material.stress(parameters, strain) for strain in strains])
    return bool(np.allclose(stresses, material.modulus * strains, rtol=EXACT, atol=0.0))


def _proportional(of: Callable[[Floats], Floats], shape: tuple[int, ...]) -> bool:
    """Return whether the force or the stress of a sum of displacements or gradients of any size is the sum of them."""
    first, second = uneven(*shape), np.sin(np.arange(math.prod(shape)) ** 2.0).reshape(shape)
    for size in (1e-6, 1e-3, 1.0):
        found = [of(each) for each in (size * first, -3.0 * size * second, size * first - 3.0 * size * second)]
        if np.abs(found[0] + found[1] - found[2]).max() > EXACT * np.abs(found).max():
            return False
    return True


@demand("elements")
def check_frequency(subject: Subject) -> None:
    """The highest frequency is a close bound.

    `highest_frequency` is a close upper bound of the frequency of each element with its share of the lumped mass.
    It gives the time step: every run is unstable if it is too low, and Courant numbers lose their meaning if it is
    too high.
    """
    for kernels in bodies_of(subject, solid=False):
        element, material, body = kernels.element, kernels.material, kernels.body
        upper_bound = answer(element, "highest_frequency", body, float(np.sqrt(material.modulus / material.rho)))
        for bound, exact in zip(upper_bound, frequencies_of_cells(element, material, body), strict=True):
            close = exact * (1.0 - 1e-6) <= bound <= 1.5 * exact
            must(close, f"it gives the frequency {bound:.6g} for an element with {exact:.6g}")


@demand("elements")
def check_solid_forces(subject: Subject) -> None:
    """Forces have an energy, rigid bodies none.

    Internal forces have no resultant and are minus the slope of the energy, with Hooke's law and with a material of
    finite strain. Translations and rotations of a body of uneven cells give no force: small rotations if the element is
    linear, else large ones with the latter material. A uniform strain leaves a node inside without force. Bodies of
    revolution move along their axis alone, and their uniform strain is the same in both directions across it.
    """
    for kernels in bodies_of(subject, solid=True):
        element, x = kernels.element, kernels.body.mesh.nodes
        size = np.abs(kernels.checked_force()).max()
        finite = BodyKernels(element, FiniteStrain(), kernels.mesh)
        finite.checked_force()
        finite.check_large_strains()
        dim = x.shape[1]
        uniform = kernels.force(1e-3 * x @ (np.diag([1.0, 0.5]) if kernels.about_axis else SHEARED[:dim, :dim]))
        words = "a uniform strain gives a force on a node inside: it fails the patch test"
        must_vanish(uniform[len(x) // 2] / np.abs(uniform).max(), words)
        if kernels.about_axis:
            continue
        rotation = 1e-3 * x @ SPIN[:dim, :dim] if element.linear else x @ TURN[:dim, :dim].T - x
        turned = (kernels if element.linear else finite).force(rotation)
        must_vanish(turned / size, "a rotation of the body gives a force")


@demand("elements")
def check_finite_rotation(subject: Subject) -> None:
    """Forces turn with a body that turns far.

    With a material of finite strain a large rotation gives no force, and the forces of a body turn with it if its
    strains are small, and if they are large. An element for small strains that cannot meet this declares it in
    `expected_failures`.
    """
    for kernels in bodies_of(subject, solid=True):
        element, x = kernels.element, kernels.body.mesh.nodes
        if kernels.about_axis:
            raise NotApplicable("a body of revolution does not turn")
        finite, turn = BodyKernels(element, FiniteStrain(), kernels.mesh), TURN[: x.shape[1], : x.shape[1]]
        small = finite.motion
        for strained, like in ((0.0 * x, small), (small, small), (LARGE * small, LARGE * small)):
            size = np.abs(finite.force(like)).max()
            turned = finite.force((x + strained) @ turn.T - x) - finite.force(strained) @ turn.T
            must_vanish(turned / size, "the forces do not turn with the body")


@demand("elements")
def check_hourglass(subject: Subject) -> None:
    """A cell holds each of its modes, also where it is deformed.

    At rest and stretched by a third each motion of the nodes of a cell has a stiffness, but for rigid ones. Without
    it a mode grows that no stress holds.
    """
    for kernels in bodies_of(subject, solid=True):
        finite, x = BodyKernels(kernels.element, FiniteStrain(), kernels.mesh), kernels.body.mesh.nodes
        dim = x.shape[1]
        places = x[cells_of(kernels.body.mesh)[0]]
        stretched = np.diag([0.3, 0.35, 0.25][:dim]) + 0.1 * SHEARED[:dim, :dim].T
        moves = 1 if kernels.about_axis else dim  # a ring with one point may turn in its section
        states = (
            ("at rest", 0.0 * places, moves + dim * (dim - 1) // 2),
            ("that is deformed", places @ stretched.T, moves),
        )
        for words, u, rigid in states:  # a deformed cell turns with its forces, which is a stiffness
            stiffness = slopes(partial(finite.probe.force, 0), u.ravel(), 1e-5)
            values = np.linalg.svd(stiffness, compute_uv=False)
            loose = int((values < HELD * values[0]).sum()) - rigid
            must(loose <= 0, f"a cell {words} has {loose} motions without a stiffness, beside those of a rigid body")


@demand("elements")
def check_inside_out(subject: Subject) -> None:
    """A cell that is turned inside out has no force.

    With a material of finite strain the force is nan where a whole cell is turned inside out, and of a cell with as
    many points as corners where one corner is pushed through it, although its volume is positive. So percuss ends the
    run; an element that hides it goes on with nonsense.
    """
    for kernels in bodies_of(subject, solid=True):
        element, mesh = kernels.element, kernels.body.mesh
        finite = BodyKernels(element, FiniteStrain(), kernels.mesh)
        nodes = cells_of(mesh)[0]
        places = mesh.nodes[nodes]
        points = volumes_of(element, kernels.body).shape[1] - getattr(element, "hourglass_points", 0)
        flipped, pushed = np.zeros(places.shape), np.zeros(places.shape)
        flipped[:, -1] = -2.0 * places[:, -1]
        pushed[0] = 1.6 * (places.mean(axis=0) - places[0])
        asked = [("turned inside out", flipped)]
        asked += [("with a corner pushed through it", pushed)] if points >= len(nodes) else []
        for words, u in asked:
            force = finite.probe.force(0, u.ravel())
            must(np.isnan(force).any(), f"a cell {words} has the force {force}, and no material of finite strain knows")


@demand("elements")
def check_solid_masses(subject: Subject) -> None:
    """Masses are right and bound frequencies.

    Each node has some of the mass of the body, which is density times volume. No frequency of a body whose nodes move
    by thousandths of a cell is above the highest of a cell by itself at rest, from which the time step follows.
    """
    for kernels in bodies_of(subject, solid=True):
        element, body, density = kernels.element, kernels.body, kernels.material.rho
        dim = body.mesh.nodes.shape[1]
        wide, *others = np.ptp(body.mesh.nodes, axis=0)  # the patch is a block, whose axis of revolution is at x = 0
        across = np.pi * wide**2 if kernels.about_axis else wide * (body.section if dim == 2 else 1.0)
        total = density * float(np.prod([across, *others]))
        nodal = lumping_of(element, body).at_nodes(element_masses(element, body, density))
        right = (nodal > 0).all() and abs(nodal.sum() - total) <= ROUND_OFF * total
        must(right, f"the nodes have the masses {nodal} of a body of {total:.6g}")
        root = np.sqrt(np.repeat(nodal, dim))
        stiffness = -slopes(kernels.force, np.zeros_like(kernels.motion), 1e-3).reshape(root.size, root.size)
        highest = np.sqrt(np.linalg.eigvals(stiffness / root / root[:, None]).real.max())
        bound = float(frequencies_of_cells(element, kernels.material, body).max())
        words = f"the body has the frequency {highest:.6g}, and no cell at rest one above {bound:.6g}"
        must(highest <= bound * (1.0 + 1e-3), words)


# ----------------------------------------------------------------------------------------------------- masses


@demand("masses")
def check_total_mass(subject: Subject) -> None:
    """Nodal masses keep mass and centre.

    Nodal masses are positive, keep mass and centre of mass, are the same if counted from the other end, and in
    proportion to the masses of the elements. Mass that is added or lost, above all at an end in contact, changes every
    impact. Only an end in contact may be without mass, because its end element holds it. A threshold that bars of equal
    elements meet exactly depends on the unit of mass unless it has a tolerance.
    """
    for _, mass in subject.made():
        for elements in (UNLIKE, UNLIKE[:1], UNLIKE[:2], *EVEN):
            _check_nodal(mass, elements, _three_nodes(elements.size), None, f"{elements.size} elements of three nodes")
            for words, nodes in TOUCHING.items():
                in_contact = np.zeros(elements.size + 1, dtype=bool)
                in_contact[nodes] = True
                where = f"{elements.size} elements with {words} node in contact"
                _check_nodal(mass, elements, Lumping.of_line(elements.size), in_contact, where)


def _check_nodal(
    mass: Mass, elements: Floats, lumping: Lumping, in_contact: NDArray[np.bool] | None, where: str
) -> None:
    """Raise `CheckFailed` unless nodal masses keep the total, are positive, mirrored, and in any unit the same."""

    def nodal_of(masses: Floats, way: int) -> Floats:
        touching = () if in_contact is None else (in_contact[::way],)
        method = "nodal" if in_contact is None else "nodal_in_contact"
        return np.asarray(answer(mass, method, masses[::way], lumping, *touching), dtype=float)[::way]

    nodal, total = nodal_of(elements, 1), elements.sum()
    without = np.zeros(nodal.size, bool) if in_contact is None else in_contact  # nodes that need no mass
    must((nodal >= 0).all() and (nodal[~without] > 0).all(), f"{where} give nodal masses {nodal}")
    must_vanish(nodal.sum() / total - 1.0, f"{where} have the mass {nodal.sum():.6g}, expected {total:.6g}", EXACT)
    mirrored = np.allclose(nodal, nodal_of(elements, -1), rtol=1e-8)
    must(mirrored, f"{where} have other masses if counted from the other end")
    for factor in UNITS_OF_MASS:
        alike = np.allclose(nodal, nodal_of(factor * elements, 1) / factor, rtol=EXACT, atol=EXACT * nodal.max())
        must(alike, f"{where} have other masses in a unit of 1/{factor:g}")


def _three_nodes(count: int) -> Lumping:
    """Return how a line of elements of three nodes shares its mass."""
    first = 2 * np.arange(count)
    shares = np.tile(np.array([1.0, 1.0, 4.0]) / 6.0, (count, 1))
    return Lumping(shares, np.stack([first, first + 2, first + 1], axis=1), 2 * count + 1)
