"""Checks of shapes, elements, materials and masses."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.errors import RunError
from percuss.methods.interfaces import BodyMesh, Mesh, Region
from percuss.solver.bodies import PROBING_STRAIN, ElementProbe
from percuss.solver.compiler.specialise import Specialiser
from percuss.testing.draws import bar_chains, for_all
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check

CLOSE = 1e-10
STEP = 1e-6  # relative step of a difference quotient
LEAST_SLOPE = 0.9  # share of the modulus that the slope of the stress must reach at some strain


def line(count: int, dim: int = 1) -> Mesh:
    """Return a line mesh of unlike elements, along an oblique direction in two and three dimensions."""
    direction = np.array([1.0, 2.0, -2.0][:dim])
    direction /= np.linalg.norm(direction)
    lengths = 0.1 * (1.0 + 0.2 * np.cos(np.arange(count)))
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    regions = {"left": Region((0,), -direction), "right": Region((count,), direction)}
    return Mesh(along[:, None] * direction, lengths, direction, regions)


# ----------------------------------------------------------------------------------------------------- shapes


@check("shapes")
def check_mesh(subject: Subject) -> None:
    """A mesh is a straight line of elements with consistent lengths, nodes, unit direction and unit outward normals.

    `refine` multiplies the number of elements without moving the regions, and the body starts where the case places it.
    """
    for options in subject.examples:
        shape = subject.make(options)
        dim = shape.dimension() or 2
        start = np.array([1.5, -2.0, 0.25][:dim])
        meshes = [shape.mesh(start.copy(), refine) for refine in (1, 3)]
        for mesh in meshes:
            _check_line(subject, mesh, dim)
        coarse, fine = meshes
        if fine.lengths.size != 3 * coarse.lengths.size:
            raise CheckFailed(f"refine 3 makes {fine.lengths.size} elements of {coarse.lengths.size}")
        for name, region in coarse.regions.items():
            nodes, fine_nodes = coarse.nodes[list(region.nodes)], fine.nodes[list(fine.regions[name].nodes)]
            if not np.allclose(nodes, fine_nodes, rtol=1e-12, atol=1e-12):
                raise CheckFailed(f"refinement moves the region '{name}'")
        shifted = shape.mesh(start + 1.0, 1)
        if not np.allclose(shifted.nodes - coarse.nodes, 1.0, rtol=0.0, atol=1e-12):
            raise CheckFailed("the body does not begin where the case says")


def _check_line(subject: Subject, mesh: Mesh, dim: int) -> None:
    """Raise `CheckFailed` unless a mesh is a straight line with the regions that the shape declares."""
    count = mesh.lengths.size
    if mesh.nodes.shape != (count + 1, dim) or mesh.direction.shape != (dim,):
        raise CheckFailed(f"{count} elements have nodes of shape {mesh.nodes.shape}, direction {mesh.direction.shape}")
    if not (mesh.lengths > 0).all():
        raise CheckFailed("an element has no length")
    if abs(np.linalg.norm(mesh.direction) - 1.0) > 1e-12:
        raise CheckFailed(f"`direction` is {mesh.direction}, expected a unit vector")
    steps = np.diff(mesh.nodes, axis=0)
    if not np.allclose(steps, mesh.lengths[:, None] * mesh.direction, rtol=1e-9, atol=1e-12 * mesh.lengths.sum()):
        raise CheckFailed("nodes, lengths and direction do not fit together")
    if set(mesh.regions) != set(subject.component.regions):  # type: ignore[attr-defined]
        raise CheckFailed(f"regions are {sorted(mesh.regions)}, and the class says {subject.component.regions}")  # type: ignore[attr-defined]
    for name, region in mesh.regions.items():
        if not all(0 <= node <= count for node in region.nodes) or not region.nodes:
            raise CheckFailed(f"region '{name}' has the nodes {region.nodes} of {count + 1}")
        if abs(abs(float(region.outward @ mesh.direction)) - 1.0) > 1e-12:
            raise CheckFailed(f"the outward normal of region '{name}' is {region.outward}")


# -------------------------------------------------------------------------------------------------- materials


def _kernels(element: Any, material: Any) -> tuple[Any, Any]:
    """Return the kernels of internal force and energy of an element with a material, in plain Python."""
    from percuss.methods import slots

    material_kernels: dict[Any, Any] = {slots.stress: material.stress, slots.energy_density: material.energy_density}
    specialiser = Specialiser(material_kernels, jit=False)
    return specialiser.bind(element.internal_force), specialiser.bind(element.energy)


@check("materials")
def check_stress_and_energy(subject: Subject) -> None:
    """Stress is the derivative of the energy density, zero at zero strain, and has the sign of the strain.

    `modulus` is the largest slope of the stress at strains up to 5 %, neither less nor much more, because wave speed,
    critical step and penalty scales are taken from it; the energy ledger is taken from the energy density.
    """
    cls: Any = subject.component
    for options in subject.examples:
        material = subject.make(options)
        parameters = np.array(material.parameters(), dtype=float)
        if not (material.rho > 0 and material.modulus > 0):
            raise CheckFailed(f"density {material.rho} and modulus {material.modulus} must be positive")
        if cls.stress(parameters, 0.0) != 0.0 or cls.energy_density(parameters, 0.0, 0.0) != 0.0:
            raise CheckFailed("there is stress or energy without strain")
        _check_slopes(cls, parameters, material.modulus)
        for strain in np.concatenate([-np.geomspace(1e-4, 0.05, 8), np.geomspace(1e-4, 0.05, 8)]):
            step = STEP * abs(strain)
            ends = strain - step, strain + step
            slope = (cls.stress(parameters, ends[1]) - cls.stress(parameters, ends[0])) / (2.0 * step)
            if slope > material.modulus * (1.0 + 1e-6):
                raise CheckFailed(f"at strain {strain:.3g} it is stiffer ({slope:.6g}) than its modulus")
            density = [cls.energy_density(parameters, end, end) for end in ends]
            stress, gradient = cls.stress(parameters, strain), (density[1] - density[0]) / (2.0 * step)
            if abs(gradient - stress) > 1e-5 * abs(stress):
                raise CheckFailed(
                    f"at strain {strain:.3g} stress is {stress:.6g}, the slope of the energy {gradient:.6g}"
                )


def _check_slopes(cls: Any, parameters: Any, modulus: float) -> None:
    """Raise `CheckFailed` if the stress has the wrong sign at some strain, or `modulus` is not its largest slope."""
    steepest = -np.inf
    for size in np.geomspace(1e-10, 0.05, 18):
        for strain in (size, -size):
            stress = cls.stress(parameters, strain)
            if not stress * strain >= 0.0:
                raise CheckFailed(f"at strain {strain:.3g} the stress is {stress:.6g}: tension is positive")
            if abs(stress) > modulus * size * (1.0 + 1e-6):
                raise CheckFailed(
                    f"at strain {strain:.3g} the stress is {stress:.6g}, and `modulus` times strain is "
                    f"{modulus * strain:.6g}"
                )
            ends = [cls.stress(parameters, strain * factor) for factor in (1.0 - STEP, 1.0 + STEP)]
            steepest = max(steepest, (ends[1] - ends[0]) / (2.0 * STEP * strain))
    if steepest < LEAST_SLOPE * modulus:
        raise CheckFailed(
            f"the largest slope of the stress is {steepest:.6g} at strains up to 5 %, and `modulus` says {modulus:.6g}"
        )


# --------------------------------------------------------------------------------------------------- elements


@check("elements")
def check_force_and_energy(subject: Subject) -> None:
    """The internal force is minus the gradient of the energy, has no resultant, and does not change with translation.

    This holds for any run of consecutive elements and in one to three dimensions; otherwise momentum or energy is lost
    in the bulk.
    """
    material = _default(subject, "materials")
    for options in subject.examples:
        element = subject.make(options)
        force_of, energy_of = _kernels(element, material)
        parameters = np.array(material.parameters(), dtype=float)
        for dim in (1, 2, 3):
            mesh = line(5, dim)
            bound = element.bind(BodyMesh(mesh, 1.3))
            u = 1e-3 * np.cos(np.arange(6 * dim) ** 2.0)
            force = np.full(u.size, np.nan)
            force_of(bound, parameters, 0, dim, u, force)
            if np.isnan(force).any():
                raise CheckFailed("`internal_force` leaves an entry unset: it sets them, it does not add to them")
            _check_gradient(energy_of, bound, parameters, dim, u, force)
            size = float(np.abs(force).max())
            if np.abs(force.reshape(-1, dim).sum(axis=0)).max() > CLOSE * size:
                raise CheckFailed(f"internal forces do not add up to nothing in {dim} dimensions")
            translation = np.tile(np.arange(1.0, dim + 1.0), 6)
            translated = np.zeros(u.size)
            force_of(bound, parameters, 0, dim, u + translation, translated)
            if np.abs(translated - force).max() > 1e-6 * size:
                raise CheckFailed("moving the body as a whole changes its internal force")
            _check_stretched(element, force_of, mesh, material)
            part = np.zeros(3 * dim)
            force_of(bound, parameters, 2, dim, u[2 * dim : 5 * dim], part)
            if np.abs(part[dim : 2 * dim] - force[3 * dim : 4 * dim]).max() > CLOSE * size:
                raise CheckFailed("a run of elements from `first` on gives another force than the whole body")


@check("elements", "materials")
def check_linear(subject: Subject) -> None:
    """A component declared linear is linear: force or stress is proportional to displacement or strain of any size.

    Exact solutions, certificates and energy guarantees apply only to a body whose element and material both declare
    `linear = True`.
    """
    if subject.family == "materials":
        proportional = all(_proportional_stress(subject.make(options)) for options in subject.examples)
    else:
        material = _default(subject, "materials")
        proportional = all(_proportional_force(subject.make(options), material) for options in subject.examples)
    if not subject.component.linear:  # type: ignore[attr-defined]
        hint = "; yet it is linear: with `linear = True` its bodies get exact solutions and certificates"
        raise NotApplicable(f"it does not declare `linear = True`{hint if proportional else ''}")
    if not proportional:
        raise CheckFailed("it declares `linear = True`, and its answer is not proportional to what it is given")


def _proportional_stress(material: Any) -> bool:
    """Return whether the stress of a material is `modulus` times the strain at strains of 1e-6 to 10 of either sign."""
    parameters = np.array(material.parameters(), dtype=float)
    sizes = np.geomspace(1e-6, 10.0, 15)
    strains = np.concatenate([-sizes, sizes])
    stresses = np.array([material.stress(parameters, strain) for strain in strains])
    return bool(np.allclose(stresses, material.modulus * strains, rtol=CLOSE, atol=0.0))


def _proportional_force(element: Any, material: Any) -> bool:
    """Return whether the force of a sum of displacements is the sum of their forces in one to three dimensions."""
    force_of, _ = _kernels(element, material)
    parameters = np.array(material.parameters(), dtype=float)
    for dim in (1, 2, 3):
        bound = element.bind(BodyMesh(line(5, dim), 1.3))
        first, second = np.cos(np.arange(6 * dim) ** 2.0), np.sin(np.arange(6 * dim) ** 2.0)
        for size in (1e-6, 1e-3, 1.0):
            forces = []
            for displacement in (size * first, -3.0 * size * second, size * first - 3.0 * size * second):
                forces.append(np.zeros(displacement.size))
                force_of(bound, parameters, 0, dim, displacement, forces[-1])
            if np.abs(forces[0] + forces[1] - forces[2]).max() > CLOSE * np.abs(forces).max():
                return False
    return True


@check("elements")
def check_stress_in_the_element(subject: Subject) -> None:
    """For small strains the stress that each element obtains from its material is modulus times its own strain.

    A result shows, as the stress of an element, the value that `stress` returned when its force was computed.
    """
    material = _default(subject, "materials")
    for options in subject.examples:
        element = subject.make(options)
        for dim in (1, 2, 3):
            mesh = line(5, dim)
            probe = ElementProbe(element, material, BodyMesh(mesh, 1.3))
            for number in range(5):
                stretch = PROBING_STRAIN * mesh.lengths[number] * mesh.direction
                stress = probe.stress(number, np.concatenate([np.zeros(dim), stretch]))
                expected = material.modulus * PROBING_STRAIN
                if not abs(stress - expected) <= 1e-4 * expected:
                    raise CheckFailed(
                        f"stretched by {PROBING_STRAIN:g} of its length in {dim} dimensions, element {number} has the "
                        f"stress {stress:.6g}, expected {expected:.6g}"
                    )


def _check_stretched(element: Any, force_of: Any, mesh: Mesh, material: Any) -> None:
    """Raise `CheckFailed` if the end force at small uniform strain is not that of `axial_stiffness`."""
    body, dim = BodyMesh(mesh, 1.3), mesh.direction.size
    bound, parameters = element.bind(body), np.array(material.parameters(), dtype=float)
    stiffness = np.asarray(element.axial_stiffness(body, material.modulus), dtype=float)
    for strain in (1e-8, -1e-8, 1e-5, -1e-5):
        u = (strain * np.concatenate([[0.0], np.cumsum(mesh.lengths)]))[:, None] * mesh.direction
        force = np.zeros(u.size)
        force_of(bound, parameters, 0, dim, u.ravel(), force)
        pull, expected = float(force[:dim] @ mesh.direction), float(stiffness[0] * strain * mesh.lengths[0])
        if abs(pull - expected) > 1e-4 * abs(expected):
            raise CheckFailed(
                f"stretched by {strain:g} an element pulls its first node along the line by {pull:.6g}, and its "
                f"`axial_stiffness` says {expected:.6g}"
            )


def _check_gradient(energy_of: Any, bound: Any, parameters: Any, dim: int, u: Any, force: Any) -> None:
    """Raise `CheckFailed` if an entry of the force differs from minus the difference quotient of the energy."""
    no_velocity, size = np.zeros(u.size), float(np.abs(force).max())
    for i in range(u.size):
        ends = []
        for step in (-1e-7, 1e-7):
            displaced = u.copy()
            displaced[i] += step
            ends.append(energy_of(bound, parameters, 0, dim, displaced, no_velocity, 0.0))
        slope = (ends[1] - ends[0]) / 2e-7
        if abs(force[i] + slope) > 1e-5 * size:
            raise CheckFailed(f"entry {i} of the force is {force[i]:.6g}, minus the slope of the energy {-slope:.6g}")


@check("elements")
def check_frequency(subject: Subject) -> None:
    """`highest_frequency` is a close upper bound of the frequency of each element with its share of the lumped mass.

    The time step is taken from it: every run is unstable if it is too low, and Courant numbers lose their meaning if it
    is too high.
    """
    material, mass = _default(subject, "materials"), _default(subject, "masses")
    for options in subject.examples:
        element = subject.make(options)
        force_of, _ = _kernels(element, material)
        parameters = np.array(material.parameters(), dtype=float)
        mesh = line(4)
        body = BodyMesh(mesh, 1.3)
        upper_bound = element.highest_frequency(body, float(np.sqrt(material.modulus / material.rho)))
        if upper_bound.shape != (4,) or element.axial_stiffness(body, material.modulus).shape != (4,):
            raise CheckFailed("`highest_frequency` and `axial_stiffness` give one value an element")
        for e in range(4):
            alone = BodyMesh(line(1)._replace(lengths=mesh.lengths[e : e + 1]), 1.3)
            columns = []
            for k in range(2):
                force = np.zeros(2)
                force_of(element.bind(alone), parameters, 0, 1, 1e-6 * np.eye(2)[k], force)
                columns.append(-force / 1e-6)
            stiffness = np.array(columns)
            nodal = mass.nodal(material.rho * 1.3 * mesh.lengths[e : e + 1])
            exact = float(np.sqrt(np.linalg.eigvals(stiffness / nodal[:, None]).real.max()))
            if not exact * (1.0 - 1e-6) <= upper_bound[e] <= 1.5 * exact:
                raise CheckFailed(f"it tells a frequency of {upper_bound[e]:.6g} for an element of {exact:.6g}")
            axial = float(element.axial_stiffness(body, material.modulus)[e])
            if abs(axial - stiffness[0, 0]) > 1e-5 * axial:
                raise CheckFailed(f"it tells a stiffness of {axial:.6g} for an element of {stiffness[0, 0]:.6g}")


def _default(subject: Subject, family: str) -> Any:
    """Return an instance of the linear elastic material or of the lumped mass, to be combined with the subject.

    Raises
    ------
    NotApplicable
        If it is not registered.
    """
    name = {"materials": "elastic", "masses": "lumped"}[family]
    cls = subject.registry.components.get((family, name))
    if cls is None:
        raise NotApplicable(f"there is no '{name}' to go with it")
    return Subject.of(cls, subject.registry).make(dict(cls.examples[0]))


# ----------------------------------------------------------------------------------------------------- masses


@check("masses")
def check_total_mass(subject: Subject) -> None:
    """Nodal masses are positive, preserve mass and centre of mass, and are the same if counted from the other end.

    Mass that is added or lost, above all at an end in contact, changes every impact.
    """
    unlike = np.array([2.0, 1.0, 4.0, 0.5])
    for options in subject.examples:
        mass = subject.make(options)
        for element_mass in (unlike, unlike[:1], np.ones(7)):
            locked = element_mass.copy()
            locked.flags.writeable = False
            nodal = np.asarray(mass.nodal(locked), dtype=float)
            if nodal.shape != (element_mass.size + 1,) or not (nodal > 0).all():
                raise CheckFailed(f"{element_mass.size} elements give nodal masses {nodal}")
            if abs(nodal.sum() - element_mass.sum()) > CLOSE * element_mass.sum():
                raise CheckFailed(f"elements of {element_mass.sum():.6g} together give nodes of {nodal.sum():.6g}")
            reverse = np.asarray(mass.nodal(element_mass[::-1].copy()), dtype=float)[::-1]
            if not np.allclose(nodal, reverse, rtol=CLOSE):
                raise CheckFailed("seen from the other end the masses are others")
        even = np.asarray(mass.nodal(np.ones(6)), dtype=float)
        if abs(even @ np.arange(7.0) - 18.0) > CLOSE * 18.0:
            raise CheckFailed("the centre of mass of a uniform line is not in its middle")


@check("elements", "materials", "masses", "shapes")
def check_runs(subject: Subject) -> None:
    """In drawn chains of bars momentum is balanced to round-off, and so is energy if the component is linear."""

    def check_ledgers(case: dict[str, Any]) -> None:
        for options in subject.examples:
            full_case = subject.placed(case if subject.family != "shapes" else _one_body(case), options)
            try:
                result = subject.run(full_case)
            except RunError as stopped:
                raise NotApplicable(str(stopped)) from None
            # masses and shapes do not declare `linear`, and leave the bodies linear
            linear = getattr(subject.component, "linear", True)
            if result.summary["momentum"]["error"] > 1e-11:
                raise CheckFailed(f"momentum is off by {result.summary['momentum']['error']:.2g} with {options}")
            if linear and result.summary["energy"]["ledger_error"] > 1e-11:
                raise CheckFailed(f"energy is off by {result.summary['energy']['ledger_error']:.2g} with {options}")

    for_all(subject, bar_chains(), check_ledgers)


def _one_body(case: dict[str, Any]) -> dict[str, Any]:
    """Return a case with its first body alone, without contacts and loads, because a shape names its ends itself."""
    name, body = next(iter(case["bodies"].items()))
    return {**case, "bodies": {name: body}, "contacts": {}, "loads": {}, "record": {"probes": []}}
