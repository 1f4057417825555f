"""Checks of shapes, elements, materials and masses."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percuss.case.defaults import DEFAULTS
from percuss.errors import RunError
from percuss.jsonable import Entries
from percuss.mesh.cell_stiffness import frequencies_of_cells
from percuss.mesh.cells import PROBING_STRAIN, cells_of, has_cells, is_solid
from percuss.methods.interfaces import Floats, Lumping, Mass, Material, Mesh
from percuss.methods.plugin_calls import answer
from percuss.testing.bodies import BodyKernels, line, patch, solid_kernels
from percuss.testing.draws import must_balance, on_chains
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check

CLOSE = 1e-10
UNITS_OF_MASS = tuple(k / 10.0 for k in range(1, 31))  # powers of two leave all results the same to the last bit
STEP = 1e-6  # relative step of a difference quotient
CYCLE_STEPS = 400  # steps of each quarter of a cycle of strain
UNACCOUNTED = 1e-2  # share of the work along a cycle of strain that may be neither stored nor dissipated
UNLIKE = np.array([2.0, 1.0, 4.0, 0.5, 3.0])  # masses of the elements of a line
TOUCHING = {"no": [], "the first": [0], "the last": [-1], "the first and the last": [0, -1]}  # nodes in contact
LEAST_SLOPE = 0.9  # share of the modulus that the slope of the stress must reach at some strain


# ----------------------------------------------------------------------------------------------------- shapes


@check("shapes")
def check_mesh(subject: Subject) -> None:
    """The mesh is a straight line of elements.

    Lengths, nodes, unit direction and unit outward normals are consistent. `refine`, above 1 or below, multiplies
    the number of elements and moves no region. The body starts where the case places it.
    """
    subject.along_line()
    for _, shape in subject.made():
        dim = shape.dimension() or 2
        start = np.array([1.5, -2.0, 0.25][:dim])
        meshes = [answer(shape, "mesh", start, refine) for refine in (1, 3, 0.3)]
        for mesh in meshes:
            _check_line(subject, mesh)
        usual, fine, coarse = meshes
        if fine.lengths.size != 3 * usual.lengths.size:
            raise CheckFailed(f"refine 3 makes {fine.lengths.size} elements of {usual.lengths.size}")
        for name, other in ((name, other) for name in usual.regions for other in (fine, coarse)):
            before, after = (mesh.nodes[list(mesh.regions[name].nodes)] for mesh in (usual, other))
            if not np.allclose(before, after, rtol=1e-12, atol=1e-12):
                raise CheckFailed(f"refinement moves the region '{name}'")
        shifted = shape.mesh(start + 1.0, 1)
        if not np.allclose(shifted.nodes - usual.nodes, 1.0, rtol=0.0, atol=1e-12):
            raise CheckFailed("the body does not start where the case places it")


def _check_line(subject: Subject, mesh: Mesh) -> None:
    """Raise `CheckFailed` unless a mesh is a straight line with the regions that the shape declares."""
    count = mesh.lengths.size
    if not (mesh.lengths > 0).all():
        raise CheckFailed("an element has no length")
    if abs(np.linalg.norm(mesh.direction) - 1.0) > 1e-12:
        raise CheckFailed(f"`direction` is {mesh.direction}, expected a unit vector")
    steps = np.diff(mesh.nodes, axis=0)
    if not np.allclose(steps, mesh.lengths[:, None] * mesh.direction, rtol=1e-9, atol=1e-12 * mesh.lengths.sum()):
        raise CheckFailed("nodes, lengths and direction contradict each other")
    if set(mesh.regions) != set(subject.component.regions):  # type: ignore[attr-defined]
        raise CheckFailed(f"regions are {sorted(mesh.regions)}, the class declares {subject.component.regions}")  # type: ignore[attr-defined]
    for name, region in mesh.regions.items():
        if not all(0 <= node <= count for node in region.nodes) or not region.nodes:
            raise CheckFailed(f"region '{name}' has the nodes {region.nodes} of {count + 1}")
        for kind, facets in region.facets.items():
            if not set(np.ravel(facets).tolist()) <= set(region.nodes):
                raise CheckFailed(f"a facet of the kind {kind} of region '{name}' has a node outside of the region")
        if abs(abs(float(region.outward @ mesh.direction)) - 1.0) > 1e-12:
            raise CheckFailed(f"the outward normal of region '{name}' is {region.outward}")


# -------------------------------------------------------------------------------------------------- materials


@check("materials")
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
        parameters = np.array(material.parameters(), dtype=float)
        if not (material.rho > 0 and material.modulus > 0):
            raise CheckFailed(f"density {material.rho} and modulus {material.modulus} must be positive")
        if cls.state:
            _check_cycle(cls, parameters, material.modulus)
            continue
        if cls.stress(parameters, 0.0) != 0.0 or cls.energy_density(parameters, 0.0, 0.0) != 0.0:
            raise CheckFailed("there is stress or energy without strain")
        _check_slopes(cls, parameters, material.modulus)


def _check_cycle(cls: Any, parameters: Floats, modulus: float) -> None:
    """Raise `CheckFailed` if along a cycle of strain the stress is too steep, or its work is not accounted for."""
    before, after = np.zeros(cls.state), np.zeros(cls.state)
    if cls.stress(parameters, 0.0, before, after) != 0.0 or after[cls.stored_in] != 0.0:
        raise CheckFailed("there is stress or energy without strain")
    strain, stress, work, dissipated = 0.0, 0.0, 0.0, 0.0
    largest = 0.0
    for amplitude in (1e-4, 2e-3, 0.05):
        for end in (amplitude, -amplitude, amplitude, 0.0):
            for following in np.linspace(strain, end, CYCLE_STEPS + 1)[1:]:
                after = before.copy()
                stress_after = cls.stress(parameters, following, before, after)
                if abs(stress_after - stress) > modulus * abs(following - strain) * (1.0 + 1e-6) + 1e-12 * modulus:
                    raise CheckFailed(f"at strain {following:.3g} it is stiffer than its modulus")
                work += 0.5 * (stress + stress_after) * (following - strain)
                largest = max(largest, work)
                if cls.dissipated_in is not None:
                    if after[cls.dissipated_in] < dissipated - 1e-12 * largest:
                        raise CheckFailed(f"at strain {following:.3g} the energy that it has dissipated decreases")
                    dissipated = after[cls.dissipated_in]
                before, strain, stress = after, following, stress_after
    missing = work - before[cls.stored_in] - dissipated
    if missing < -UNACCOUNTED * largest or (cls.dissipated_in is not None and missing > UNACCOUNTED * largest):
        raise CheckFailed(
            f"along a cycle of strain the work of the stress is {work:.6g}, it stores {before[cls.stored_in]:.6g} and "
            f"has dissipated {dissipated:.6g}"
        )


def _check_slopes(cls: type[Material], parameters: Floats, modulus: float) -> None:
    """Raise `CheckFailed` unless stress is the slope of the energy, and `modulus` the largest slope of the stress."""
    steepest = -np.inf
    for strain in np.outer(np.geomspace(1e-10, 0.05, 18), (1.0, -1.0)).flat:
        stress, step = cls.stress(parameters, strain), STEP * abs(strain)
        if not stress * strain >= 0.0:
            raise CheckFailed(f"at strain {strain:.3g} the stress is {stress:.6g}: tension is positive")
        ends = strain - step, strain + step
        slope, gradient = (
            (after - before) / (2.0 * step)
            for before, after in (
                [cls.stress(parameters, end) for end in ends],
                [cls.energy_density(parameters, end, end) for end in ends],
            )
        )
        steepest = max(steepest, slope, stress / strain)
        if steepest > modulus * (1.0 + 1e-6):
            raise CheckFailed(f"at strain {strain:.3g} it is stiffer ({steepest:.6g}) than its modulus")
        if abs(gradient - stress) > 1e-5 * abs(stress):
            raise CheckFailed(f"at strain {strain:.3g} stress is {stress:.6g}, the slope of the energy {gradient:.6g}")
    if steepest < LEAST_SLOPE * modulus:
        raise CheckFailed(
            f"the largest slope of the stress is {steepest:.6g} at strains up to 5 %, and `modulus` is {modulus:.6g}"
        )


# --------------------------------------------------------------------------------------------------- elements


def elastic(subject: Subject, **options: float) -> Any:
    """Return the linear elastic material, by default of its first example, to be combined with an element.

    Raises
    ------
    NotApplicable
        If it is not registered.
    """
    cls = subject.registry.components.get(("materials", DEFAULTS["materials"]))
    if cls is None:
        raise NotApplicable(f"'{DEFAULTS['materials']}' is not registered, and the check needs it")
    return Subject.of(cls, subject.registry).make(options or cls.examples[0])


def bodies_of(subject: Subject) -> Iterator[BodyKernels]:
    """Yield a body of unlike cells for each example of an element; along a line one in one to three dimensions each."""
    for _, element in subject.made():
        if is_solid(element):
            yield BodyKernels(element, elastic(subject, young=2.0, density=3.0, poisson=0.3), patch(element.cell))
        else:
            subject.along_line()
            yield from (BodyKernels(element, elastic(subject), line(5, dim)) for dim in (1, 2, 3))


def _bars(subject: Subject) -> Iterator[BodyKernels]:
    """Yield the bodies of an element along a line."""
    subject.along_line()
    yield from bodies_of(subject)


@check("elements")
def check_force_and_energy(subject: Subject) -> None:
    """Force is minus the slope of the energy.

    The internal force is minus the gradient of the energy. It has no resultant and does not change with a
    translation. This holds for any run of consecutive elements, in one to three dimensions. Otherwise the bulk
    loses momentum or energy.
    """
    for kernels in _bars(subject):
        kernels.checked_force()
        _check_stretched(kernels)


def _check_stretched(kernels: BodyKernels) -> None:
    """Raise `CheckFailed` if the end force of an element at small uniform strain is not that of `axial_stiffness`."""
    body, mesh = kernels.body, kernels.body.mesh
    stiffness = answer(kernels.element, "axial_stiffness", body, kernels.material.modulus)
    for strain in (1e-8, -1e-8, 1e-5, -1e-5):
        for number, nodes in enumerate(cells_of(mesh)):
            force = kernels.probe.force(number, strain * (mesh.nodes[nodes] - mesh.nodes[nodes[0]]).ravel())
            pull = float(force[: mesh.direction.size] @ mesh.direction)
            expected = float(stiffness[number] * strain * mesh.lengths[number])
            if abs(pull - expected) > 1e-4 * abs(expected):
                raise CheckFailed(
                    f"stretched by {strain:g} element {number} pulls its first node along the line by {pull:.6g}, and "
                    f"its `axial_stiffness` gives {expected:.6g}"
                )


@check("elements")
def check_cells(subject: Subject) -> None:
    """A cell keeps its mass and its centre.

    The shares of mass of the nodes are positive, add up to 1, and keep the centre of mass of the cell. The volumes
    of its quadrature points add up to the volume of the cell. Two-node elements have none of this.
    """
    for kernels in _bars(subject):
        element, body = kernels.element, kernels.body
        if not has_cells(element):
            raise NotApplicable("it is a two-node element, with one point and half of its mass at each node")
        places, shares = np.asarray(element.reference_nodes()), np.asarray(element.mass_shares(body))
        if shares.shape != places.shape or not (shares > 0).all() or abs(shares.sum() - 1.0) > CLOSE:
            raise CheckFailed(f"its {places.size} nodes have the shares {shares} of its mass")
        if abs(float(shares @ places) - 0.5) > CLOSE:
            raise CheckFailed(f"the centre of mass of a cell is at {float(shares @ places):.6g} of its length")
        missing = np.asarray(element.volumes(body)).sum(axis=1) - body.section * body.mesh.lengths
        if np.abs(missing).max() > CLOSE * body.section * body.mesh.lengths.max():
            raise CheckFailed("the volumes of the quadrature points of a cell do not add up to its volume")


@check("elements", "materials")
def check_linear(subject: Subject) -> None:
    """What is declared linear is linear.

    Force or stress is proportional to displacement or strain of any size. Exact solutions, certificates and energy
    guarantees apply only to bodies whose element and material both declare `linear = True`.
    """
    if subject.family == "materials":
        proportional = all(_proportional_stress(material) for _, material in subject.made())
    else:
        proportional = all(_proportional(kernels.force, kernels.motion.shape) for kernels in bodies_of(subject))
    if not subject.component.linear:  # type: ignore[attr-defined]
        hint = "; yet it is linear: with `linear = True` its bodies get exact solutions and certificates"
        raise NotApplicable(f"it does not declare `linear = True`{hint if proportional else ''}")
    if not proportional:
        raise CheckFailed("it declares `linear = True`, and its answer is not proportional to its input")


def _proportional_stress(material: Material) -> bool:
    """Return whether the stress of a material is `modulus` times the strain at strains of 1e-6 to 10 of either sign.

    Of bodies that are no bars it is whether the stress of a sum of gradients is the sum of their stresses.
    """
    if not all(_proportional(solid.stress, (solid.dim, solid.dim)) for solid in solid_kernels(material)):
        return False
    if material.state or material.stress is None:
        return not material.state
    parameters = np.array(material.parameters(), dtype=float)
    sizes = np.geomspace(1e-6, 10.0, 15)
    strains = np.concatenate([-sizes, sizes])
    stresses = np.array([material.stress(parameters, strain) for strain in strains])
    return bool(np.allclose(stresses, material.modulus * strains, rtol=CLOSE, atol=0.0))


def _proportional(of: Callable[[Floats], Floats], shape: tuple[int, ...]) -> bool:
    """Return whether the force or the stress of a sum of displacements or gradients of any size is the sum of them."""
    numbers = np.arange(math.prod(shape)).reshape(shape)
    first, second = np.cos(numbers**2.0), np.sin(numbers**2.0)
    for size in (1e-6, 1e-3, 1.0):
        found = [of(each) for each in (size * first, -3.0 * size * second, size * first - 3.0 * size * second)]
        if np.abs(found[0] + found[1] - found[2]).max() > CLOSE * np.abs(found).max():
            return False
    return True


@check("elements")
def check_stress_in_the_element(subject: Subject) -> None:
    """Stress is modulus times the own strain.

    For small strains each element obtains from its material the modulus times its own strain. A result shows this
    value as the stress of the element.
    """
    for kernels in _bars(subject):
        mesh, expected = kernels.body.mesh, kernels.material.modulus * PROBING_STRAIN
        for number, nodes in enumerate(cells_of(mesh)):
            stretched = PROBING_STRAIN * (mesh.nodes[nodes] - mesh.nodes[nodes[0]])
            stress = float(kernels.probe.stresses(np.array([number]), stretched[None, None])[0, 0])
            if not abs(stress - expected) <= 1e-4 * expected:
                raise CheckFailed(
                    f"stretched by {PROBING_STRAIN:g} of its length in {mesh.direction.size} dimensions, element "
                    f"{number} has the stress {stress:.6g}, expected {expected:.6g}"
                )


@check("elements")
def check_frequency(subject: Subject) -> None:
    """The highest frequency is a close bound.

    `highest_frequency` is a close upper bound of the frequency of each element with its share of the lumped mass.
    It gives the time step: every run is unstable if it is too low, and Courant numbers lose their meaning if it is
    too high.
    """
    for kernels in _bars(subject):
        element, material, body = kernels.element, kernels.material, kernels.body
        upper_bound = answer(element, "highest_frequency", body, float(np.sqrt(material.modulus / material.rho)))
        for bound, exact in zip(upper_bound, frequencies_of_cells(element, material, body), strict=True):
            if not exact * (1.0 - 1e-6) <= bound <= 1.5 * exact:
                raise CheckFailed(f"it gives the frequency {bound:.6g} for an element with {exact:.6g}")


# ----------------------------------------------------------------------------------------------------- masses


@check("masses")
def check_total_mass(subject: Subject) -> None:
    """Nodal masses keep mass and centre.

    Nodal masses are positive, keep mass and centre of mass, and are the same if counted from the other end. Mass
    that is added or lost, above all at an end in contact, changes every impact.
    """
    for _, mass in subject.made():
        for elements, three_nodes in itertools.product((UNLIKE, UNLIKE[:1], np.ones(7)), (False, True)):
            lumping = _lumping(elements.size, three_nodes=three_nodes)
            untouched = np.zeros(lumping.nodes, dtype=bool)
            _check_nodal(mass, elements, lumping, untouched, elements.sum(), f"{elements.size} elements")
        even = np.asarray(mass.nodal(np.ones(6), Lumping.of_line(6)), dtype=float)
        if abs(even @ np.arange(7.0) - 18.0) > CLOSE * 18.0:
            raise CheckFailed("the centre of mass of a uniform line is not in its middle")


def _check_nodal(
    mass: Mass, elements: Floats, lumping: Lumping, in_contact: NDArray[np.bool], total: float, where: str
) -> None:
    """Raise `CheckFailed` unless nodal masses have a total, and are positive and the same from the other end."""
    both = []
    for way in (1, -1):
        touching = (in_contact[::way],) if in_contact.any() else ()
        nodal = answer(mass, "nodal_in_contact" if touching else "nodal", elements[::way], lumping, *touching)
        both.append(np.asarray(nodal, dtype=float)[::way])
    nodal, reverse = both
    if not (nodal >= 0).all() or not (nodal[~in_contact] > 0).all():
        raise CheckFailed(f"{where} give nodal masses {nodal}")
    if abs(nodal.sum() - total) > CLOSE * total:
        raise CheckFailed(f"{where} have the mass {nodal.sum():.6g}, expected {total:.6g}")
    if not np.allclose(nodal, reverse, rtol=1e-8):
        raise CheckFailed(f"{where} have other masses if counted from the other end")


def _with_ends_in_contact(*lines: Floats) -> Iterator[tuple[Floats, Lumping, NDArray[np.bool], str]]:
    """Yield masses of elements and their lumping, with a mask of the nodes in contact, and both in words."""
    for elements, (words, nodes) in itertools.product(lines, TOUCHING.items()):
        in_contact = np.zeros(elements.size + 1, dtype=bool)
        in_contact[nodes] = True
        where = f"{elements.size} elements with {words} node in contact"
        yield elements, Lumping.of_line(elements.size), in_contact, where


def _lumping(count: int, *, three_nodes: bool) -> Lumping:
    """Return how a line of elements of two nodes, or of three, shares its mass."""
    if not three_nodes:
        return Lumping.of_line(count)
    first = 2 * np.arange(count)
    shares = np.tile(np.array([1.0, 1.0, 4.0]) / 6.0, (count, 1))
    return Lumping(shares, np.stack([first, first + 2, first + 1], axis=1), 2 * count + 1)


@check("masses")
def check_masses_in_contact(subject: Subject) -> None:
    """Ends in contact keep the total mass.

    Nodal masses keep the total mass, whichever ends are in contact. They are the same if counted from the other
    end. Only an end in contact may be without mass, because its end element holds it; nothing moves any other node
    without mass.
    """
    for _, mass in subject.made():
        for elements, lumping, in_contact, where in _with_ends_in_contact(UNLIKE, UNLIKE[:1], UNLIKE[:2], np.ones(9)):
            total = float(np.sum(mass.nodal(elements.copy(), lumping)))
            _check_nodal(mass, elements, lumping, in_contact, total, where)


@check("masses")
@on_chains(steps=100)
def check_balance_in_contact(subject: Subject, case: Entries) -> None:
    """With each law the balances are exact.

    Momentum and energy of drawn chains of bars are balanced to round-off with every law that goes with the mass.
    This applies to masses that treat ends in contact in a way of their own, at ends that come into contact.
    """
    if subject.component.nodal_in_contact is Mass.nodal_in_contact:  # type: ignore[attr-defined]
        raise NotApplicable("ends in contact have the mass of all other ends")
    ran = False
    for name in subject.judges("contacts"):
        law = {"name": name, **subject.registry.components["contacts", name].examples[0]}
        try:
            result = subject.run(subject.placed({**case, "method": {"contact": law}}))
        except (NotApplicable, RunError):
            continue
        ran = True
        must_balance(result, f" with {law}")
        if result.summary["energy_growth"]["kept"] is False:
            raise CheckFailed(f"with {law} energy changed beyond what its certificate guarantees")
    if not ran:
        raise NotApplicable("no law goes with it, or every run was stopped")


@check("masses")
def check_units_of_mass(subject: Subject) -> None:
    """No result depends on the unit of mass.

    Nodal masses are in proportion to the masses of the elements. A threshold that bars of equal elements meet
    exactly depends on round-off unless it has a tolerance.
    """
    lines = [np.ones(count) for count in range(1, 13)]
    for _, mass in subject.made():
        for elements, lumping, in_contact, where in _with_ends_in_contact(UNLIKE, *lines):
            nodal = np.asarray(mass.nodal_in_contact(elements.copy(), lumping, in_contact), dtype=float)
            for factor in UNITS_OF_MASS:
                other = np.asarray(mass.nodal_in_contact(factor * elements, lumping, in_contact), dtype=float) / factor
                if not np.allclose(nodal, other, rtol=CLOSE, atol=CLOSE * nodal.max()):
                    raise CheckFailed(f"{where} have the masses {nodal}, and {other} in a unit of 1/{factor:g}")


@check("masses")
def check_inverse_mass(subject: Subject) -> None:
    """The inverse mass moves whole bodies.

    The inverse of a mass that couples nodes is the same if counted from the other end. It is positive
    definite, and ``M^-1 m = 1`` for the masses m of the nodes.
    """
    if subject.component.inverse is Mass.inverse:  # type: ignore[attr-defined]
        raise NotApplicable("its mass matrix is diagonal")
    for options, mass in subject.made():
        for element_mass in (UNLIKE, UNLIKE[:2], np.ones(9)):
            lumping = Lumping.of_line(element_mass.size)
            found = [answer(mass, "inverse", masses, lumping) for masses in (element_mass, element_mass[::-1])]
            if found == [None, None]:
                continue
            where = f"{element_mass.size} elements with {options}"
            inverse, mirrored = (matrix.toarray() for matrix in found)
            if not np.allclose(inverse, mirrored[::-1, ::-1], rtol=1e-8, atol=1e-12):
                raise CheckFailed(f"{where}: the inverse is another if counted from the other end")
            if np.linalg.eigvalsh(inverse).min() <= 0.0:
                raise CheckFailed(f"{where} give an inverse that is not positive definite")
            ones = inverse @ np.asarray(mass.nodal(element_mass.copy(), lumping), dtype=float)
            if np.abs(ones - 1.0).max() > CLOSE:
                raise CheckFailed(f"{where}: M^-1 m is {ones[np.argmax(np.abs(ones - 1.0))]:.6g} at a node, not 1")
