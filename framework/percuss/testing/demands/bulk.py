"""Demands on shapes, elements, materials and masses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percuss.case.defaults import DEFAULTS
from percuss.mesh.cell_stiffness import frequencies_of_cells
from percuss.mesh.cells import cells_of, has_cells, is_solid
from percuss.methods.interfaces import Floats, Lumping, Mass, Material
from percuss.methods.plugin_calls import answer
from percuss.testing.bodies import BodyKernels, line, patch, solid_kernels
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, demand

CLOSE = 1e-10
UNITS_OF_MASS = tuple(k / 10.0 for k in range(1, 31))  # powers of two leave all results the same to the last bit
STEP = 1e-6  # relative step of a difference quotient
CYCLE_STEPS = 400  # steps of each quarter of a cycle of strain
UNACCOUNTED = 1e-2  # share of the work along a cycle of strain that may be neither stored nor dissipated
UNLIKE = np.array([2.0, 1.0, 4.0, 0.5, 3.0])  # masses of the elements of a line
EVEN = [np.ones(count) for count in range(1, 13)]
TOUCHING = {"no": [], "the first": [0], "the last": [-1], "the first and the last": [0, -1]}  # nodes in contact
LEAST_SLOPE = 0.9  # share of the modulus that the slope of the stress must reach at some strain


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
            material = elastic(subject, young=2.0, density=3.0, poisson=0.3)
            yield BodyKernels(element, material, patch(element.cell, subject.registry))
        else:
            subject.along_line()
            yield from (BodyKernels(element, elastic(subject), line(5, dim)) for dim in (1, 2, 3))


def _bars(subject: Subject) -> Iterator[BodyKernels]:
    """Yield the bodies of an element along a line."""
    subject.along_line()
    yield from bodies_of(subject)


@demand("elements")
def check_force_and_energy(subject: Subject) -> None:
    """Force is minus the slope of the energy.

    The internal force is minus the gradient of the energy. It has no resultant and does not change with a
    translation. This holds for any run of consecutive elements, in one to three dimensions. Otherwise the bulk
    loses momentum or energy. For small strains the force is that of `axial_stiffness`, and each element obtains from
    its material the modulus times its own strain, which a result shows as its stress.
    """
    for kernels in _bars(subject):
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
            if not abs(stress - modulus * strain) <= 1e-4 * modulus * abs(strain):
                raise CheckFailed(
                    f"stretched by {strain:g} of its length in {mesh.direction.size} dimensions, element {number} has "
                    f"the stress {stress:.6g}, expected {modulus * strain:.6g}"
                )
            force = kernels.probe.force(number, displacement)
            pull = float(force[: mesh.direction.size] @ mesh.direction)
            expected = float(stiffness[number] * strain * mesh.lengths[number])
            if abs(pull - expected) > 1e-4 * abs(expected):
                raise CheckFailed(
                    f"stretched by {strain:g} element {number} pulls its first node along the line by {pull:.6g}, and "
                    f"its `axial_stiffness` gives {expected:.6g}"
                )


@demand("elements")
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


@demand("elements", "materials")
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


@demand("elements")
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
        even = np.asarray(mass.nodal(np.ones(6), Lumping.of_line(6)), dtype=float)
        if abs(even @ np.arange(7.0) - 18.0) > CLOSE * 18.0:
            raise CheckFailed("the centre of mass of a uniform line is not in its middle")


def _check_nodal(
    mass: Mass, elements: Floats, lumping: Lumping, in_contact: NDArray[np.bool] | None, where: str
) -> None:
    """Raise `CheckFailed` unless nodal masses keep the total, are positive, mirrored, and in any unit the same."""

    def nodal_of(masses: Floats, way: int) -> Floats:
        touching = () if in_contact is None else (in_contact[::way],)
        method = "nodal" if in_contact is None else "nodal_in_contact"
        return np.asarray(answer(mass, method, masses[::way], lumping, *touching), dtype=float)[::way]

    nodal, total = nodal_of(elements, 1), elements.sum()
    may_be_zero = np.zeros(nodal.size, bool) if in_contact is None else in_contact
    if not (nodal >= 0).all() or not (nodal[~may_be_zero] > 0).all():
        raise CheckFailed(f"{where} give nodal masses {nodal}")
    if abs(nodal.sum() - total) > CLOSE * total:
        raise CheckFailed(f"{where} have the mass {nodal.sum():.6g}, expected {total:.6g}")
    if not np.allclose(nodal, nodal_of(elements, -1), rtol=1e-8):
        raise CheckFailed(f"{where} have other masses if counted from the other end")
    for factor in UNITS_OF_MASS:
        if not np.allclose(nodal, nodal_of(factor * elements, 1) / factor, rtol=CLOSE, atol=CLOSE * nodal.max()):
            raise CheckFailed(f"{where} have other masses in a unit of 1/{factor:g}")


def _three_nodes(count: int) -> Lumping:
    """Return how a line of elements of three nodes shares its mass."""
    first = 2 * np.arange(count)
    shares = np.tile(np.array([1.0, 1.0, 4.0]) / 6.0, (count, 1))
    return Lumping(shares, np.stack([first, first + 2, first + 1], axis=1), 2 * count + 1)


@demand("masses")
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
            for words, other in (("counted from the other end", mirrored[::-1, ::-1]), ("transposed", inverse.T)):
                if not np.allclose(inverse, other, rtol=1e-8, atol=1e-12):
                    raise CheckFailed(f"{where}: the inverse is another if {words}")
            if np.linalg.eigvalsh(inverse).min() <= 0.0:
                raise CheckFailed(f"{where} give an inverse that is not positive definite")
            ones = inverse @ np.asarray(mass.nodal(element_mass.copy(), lumping), dtype=float)
            if np.abs(ones - 1.0).max() > CLOSE:
                raise CheckFailed(f"{where}: M^-1 m is {ones[np.argmax(np.abs(ones - 1.0))]:.6g} at a node, not 1")
