"""Masses that couple neighbouring nodes.

The bulk update advances all bodies with their nodal masses m, which changes the velocities by ``dt diag(m)^-1 f``. With
``M^-1 diag(m)``, whose rows have the sum 1, this becomes ``dt M^-1 f``; body forces, which accelerate all nodes alike,
are left as they are. What acts on an end moves the nodes beside it too: `carry_to_neighbours`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from percuss.contact.features import EVERY_STEP, Feature
from percuss.mesh.eigenvalues import as_bands
from percuss.record_arrays import Records, record_array
from percuss.step.actions import (
    AFTER_FORCES,
    AFTER_SUPPORTS,
    BEFORE_CONTACT,
    BEFORE_LOADS,
    BEFORE_SUPPORTS,
    BULK,
    KINETIC_ENERGY,
    Action,
)
from percuss.step.bulk import add_kinetic_energy
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.errors import Problem
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats

# A node beside an end on which a load, a support or a drive acts, one record for each direction.
NEIGHBOUR = np.dtype(
    [
        ("place", "i8"),  # index of its boundary degree of freedom
        ("end", "i8"),  # that of the end
        ("share", "f8"),  # of the change of velocity of the end by a force there
    ]
)


class Coupling(NamedTuple):
    """What couples the nodes, and what the part keeps within a step."""

    coupling: Floats  # (2 k + 1, nodes * dim) M^-1 diag(m) - I
    factor: Floats  # (k + 1, nodes * dim) 1/D and L of M^-1 = L D L^T
    correction: Floats  # (nodes * dim,) work space
    before: Floats  # (nodes * dim,) displacements before the step
    change: Floats  # (nodes * dim,) change of the velocities that nodal masses alone would give
    mass: Floats  # (nodes * dim,) nodal masses
    neighbours: Records  # NEIGHBOUR
    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    totals: Records  # percuss.step.records.TOTAL
    dim: int
    dt: float
    sums_work: bool  # whether the internal work is summed up


class CoupledMasses(Part[Coupling]):
    """The part of a step with masses that couple nodes."""

    def __init__(self, data: Coupling, *, multistage: bool) -> None:
        super().__init__(data)
        self.multistage = multistage

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where all masses are diagonal."""
        model, step = setting.model, setting.step
        if not model.bodies.couples_nodes:
            return None
        rows = [
            (setting.place[node] + d, setting.place[end] + d, value / response[end])
            for end in dict.fromkeys(model.loads.acted_nodes)
            for response in (model.bodies.at(end).response(end),)
            for node, value in response.items()
            if node != end
            for d in range(model.dim)
        ]
        neighbours, sums_work = record_array(rows, NEIGHBOUR), model.sums_internal_work
        if before is not None:
            data = before.data._replace(boundary=step.boundary, totals=step.totals, neighbours=neighbours)
            return cls(data, multistage=model.multistage)
        coupling, factor = arrays_for_the_loop(model.bodies.values(), model.dim)
        correction, former, change = (np.zeros(coupling.shape[1]) for _ in range(3))
        data = Coupling(
            coupling, factor, correction, former, change, model.bodies.mass_of_dofs, neighbours, step.boundary,
            step.totals, model.dim, model.dt, sums_work,
        )  # fmt: skip
        return cls(data, multistage=model.multistage)

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step or of a stage."""
        if self.multistage:
            yield Action(AFTER_FORCES, couple_accelerations, self.data)
            yield Action(BEFORE_LOADS, keep_ends, self.data)
            yield Action(AFTER_SUPPORTS, move_neighbours, self.data)
        else:
            yield Action(BULK, keep_state, self.data, order=-1)
            yield Action(BULK, couple_nodes, self.data, order=1)
            yield Action(BEFORE_SUPPORTS, tell_change, self.data)
            yield Action(BEFORE_CONTACT, carry_to_neighbours, self.data)
        yield Action(KINETIC_ENERGY, add_coupled_kinetic_energy, self.data)

    def kinetic_energy(self, v: Floats) -> float | None:
        """Return the kinetic energy ``v M v / 2``."""
        return coupled_kinetic(self.data.factor, v, self.data.dim, np.empty_like(v))

    def changed(self, action: Action) -> Action | None:
        """Return any action but that of the kinetic energy of nodal masses, which this part has of its own."""
        return None if action.kernel is add_kinetic_energy else action


def arrays_for_the_loop(bodies: Iterable[Body], dim: int) -> tuple[Floats, Floats]:
    """Return ``M^-1 diag(m) - I`` of all bodies, and D and L of ``M^-1 = L D L^T``, which the loop reads.

    Both have one column for each degree of freedom. The former has 2 k + 1 rows, the entry of row i and column i + d in
    place [k + d, i]; the latter k + 1, 1/D and then the off-diagonals of L, the entry of column j in place j. A
    diagonal mass matrix among others has zeros there.
    """
    from scipy.linalg import cholesky_banded

    bodies = list(bodies)
    inverses = [as_bands(body.inverse) if body.inverse is not None else 1.0 / body.mass[None] for body in bodies]
    width = max(map(len, inverses)) - 1
    couplings, factors = [], []
    for body, bands in zip(bodies, inverses, strict=True):
        size = body.mass.size
        band = np.zeros((width + 1, size))
        band[: len(bands)] = bands
        coupling = np.zeros((2 * width + 1, size))
        for d in range(1, min(width + 1, size)):
            coupling[width + d, : size - d] = band[d, : size - d] * body.mass[d:]
            coupling[width - d, d:] = band[d, : size - d] * body.mass[: size - d]
        coupling[width] = -coupling.sum(axis=0)  # rows of M^-1 diag(m) have the sum 1
        factor = cholesky_banded(band, lower=True)
        factor[1:] /= factor[0]
        factor[0] **= -2
        couplings.append(coupling)
        factors.append(factor)
    coupling, factor = np.concatenate(couplings, axis=1), np.concatenate(factors, axis=1)
    return np.repeat(coupling, dim, axis=1), np.repeat(factor, dim, axis=1)


# ------------------------------------------------------------------------------------------------- leap-frog schemes


def keep_state(data: Coupling, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Keep displacements and velocities before the bulk update."""
    for i in range(data.change.size):
        data.change[i] = v[i]
        data.before[i] = u[i]


def couple_nodes(data: Coupling, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Turn the bulk update with nodal masses into that with M, in place; `change` is its change of velocity."""
    change = data.change
    for i in range(change.size):
        change[i] = v[i] - change[i]
    set_correction(data)
    # Displacements are made anew: a correction of them would round twice, to one side.
    correct(data.correction, data.before, u, v, data.dt)
    if data.sums_work:  # body forces do no work on corrections, which leave the momentum as it is
        for i in range(change.size):
            data.totals[0].internal_work -= 0.5 * data.mass[i] * change[i] * data.correction[i]


def set_correction(data: Coupling) -> None:
    """Set `correction` to ``(M^-1 diag(m) - I)`` times `change`, one diagonal after the other."""
    change, coupling, correction = data.change, data.coupling, data.correction
    size = change.size
    reach = coupling.shape[0] // 2
    for i in range(size):
        correction[i] = coupling[reach, i] * change[i]
    for k in range(1, reach + 1):
        offset = min(k * data.dim, size)
        add_products(coupling[reach + k, : size - offset], change[offset:], correction[: size - offset])
        add_products(coupling[reach - k, offset:], change[: size - offset], correction[offset:])


def add_products(coefficients: Floats, values: Floats, sums: Floats) -> None:
    """Add the products of coefficients and values to sums."""
    for i in range(sums.size):
        sums[i] += coefficients[i] * values[i]


def correct(correction: Floats, before: Floats, u: Floats, v: Floats, dt: float) -> None:
    """Add a correction to the velocities, and make the displacements from them."""
    for i in range(v.size):
        v[i] += correction[i]
        u[i] = before[i] + dt * v[i]


def tell_change(data: Coupling, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Tell the boundary the changes of velocity that nodal masses alone would have given, without the coupling."""
    for i in range(data.boundary.size):
        q = data.boundary[i]
        q.change = data.change[q.dof]


def carry_to_neighbours(data: Coupling, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Change the velocities beside ends on which loads, supports and drives act: that of the end has been changed."""
    for i in range(data.neighbours.size):
        neighbour = data.neighbours[i]
        q = data.boundary[neighbour.end]
        data.boundary[neighbour.place].new_v += neighbour.share * (q.new_v - q.bulk_v)


# ----------------------------------------------------------------------------------------------- multi-stage schemes


def couple_accelerations(data: Coupling, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Turn the accelerations of nodal masses, ``diag(m)^-1 f``, into ``M^-1 f``, in place."""
    for i in range(data.change.size):
        data.change[i] = a[i]
    set_correction(data)
    for i in range(data.change.size):
        a[i] += data.correction[i]


def keep_ends(data: Coupling, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Keep the accelerations of the ends on which loads, supports and drives are about to act."""
    for i in range(data.neighbours.size):
        q = data.boundary[data.neighbours[i].end]
        q.bulk_v = a[q.dof]


def move_neighbours(data: Coupling, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Change the accelerations beside the ends where they have changed since `keep_ends`."""
    for i in range(data.neighbours.size):
        neighbour = data.neighbours[i]
        q = data.boundary[neighbour.end]
        a[data.boundary[neighbour.place].dof] += neighbour.share * (a[q.dof] - q.bulk_v)


# ------------------------------------------------------------------------------------------------------------ energy


def add_coupled_kinetic_energy(data: Coupling, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the kinetic energy ``v M v / 2``."""
    data.totals[0].kinetic_energy += coupled_kinetic(data.factor, v[: data.mass.size], data.dim, data.correction)


def coupled_kinetic(factor: Floats, v: Floats, dim: int, work_space: Floats) -> float:
    """Return the kinetic energy ``v M v / 2`` by forward substitution, with ``M^-1 = L D L^T``.

    It is ``y D^-1 y / 2`` of ``y = L^-1 v``, which is left in `work_space`.
    """
    bands = factor.shape[0]
    total = 0.0
    for i in range(v.size):
        value = v[i]
        for k in range(1, bands):
            j = i - k * dim
            if j >= 0:
                value -= factor[k, j] * work_space[j]
        work_space[i] = value
        total += factor[0, i] * value * value
    return 0.5 * total


# ------------------------------------------------------------------------------------------------ facts and refusals


def feature(model: Model) -> Feature | None:
    """Return what is to know of masses that couple nodes; None where all are diagonal."""
    if not model.bodies.couples_nodes:
        return None
    mass = model.case.method.mass.name
    return Feature(
        name=mass,
        no_row_kernel=True,
        reasons={
            "waves": f"waves are measured with diagonal masses; the mass {mass} couples nodes",
            "black box": f"the mass {mass}, which couples nodes, is examined only with linear laws",
        },
    )


def refusals(model: Model) -> Iterator[Problem]:
    """Yield a problem for a scheme for which such masses are not built, and for ends that they couple to each other.

    A support, a drive or a load on an end whose motion the mass couples to the other end of its body has no neighbours
    of its own.
    """
    if not model.bodies.couples_nodes:
        return
    mass, case = model.case.method.mass.name, model.case
    if why := model.why_altered(EVERY_STEP):
        integrator = case.method.integrator.name
        message = f"expected a diagonal mass with {integrator}, found {mass}, which couples nodes"
        advice = f"A mass that couples nodes needs {EVERY_STEP}, and {why}: take lumped, or central-difference."
        yield case.problem(("method", "mass"), message, advice)
    for body in model.bodies.values():
        reach, count = 0 if body.inverse is None else len(as_bands(body.inverse)) - 1, body.count
        if count <= reach and not {body.start, body.stop - 1}.isdisjoint(model.loads.acted_nodes):
            message = f"expected more than {reach} elements in body '{body.name}', found {count}"
            advice = (
                f"The mass {mass} couples both of its ends, and a support, a drive or a load acts on one: take more."
            )
            yield case.problem(("bodies", body.name), message, advice)
