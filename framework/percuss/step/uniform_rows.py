"""Rows of equal two-node elements in one dimension, whose step needs one number instead of arrays.

All inner nodes of such a bar have the same mass and all elements the same stiffness: a step without contact is
``v += rate ((u_{i+1} - u_i) - (u_i - u_{i-1}))``, then ``u += dt v``. Plain Python rounds the products before it adds
them and differs by round-off.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.jit import fused, reduction
from percuss.methods.blame import is_foreign
from percuss.record_arrays import Records, record_array

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.contact.model import Model
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats

UNIFORM_BAR = np.dtype(
    [
        ("start", "i8"),  # first node
        ("stop", "i8"),  # the number after the last node
        ("rate", "f8"),  # dt EA/h over the mass of an inner node
        ("left", "f8"),  # mass of an inner node over that of the first node, minus 1
        ("right", "f8"),  # the same for the last node
        ("mass", "f8"),  # of an inner node
        ("first_mass", "f8"),
        ("last_mass", "f8"),
        ("stiffness", "f8"),  # EA/h of an element
    ]
)


class UniformRows(NamedTuple):
    """All bodies of a model that has nothing but bars of equal elements."""

    bars: Records  # UNIFORM_BAR
    totals: Records  # percuss.step.records.TOTAL
    dt: float


def advance_whole(data: UniformRows, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Advance all nodes of all bars by a step, as if nothing acted on the ends.

    Beyond an end of half the mass of an inner node, an element with the opposite elongation would have the same effect.
    """
    for b in range(data.bars.size):
        bar = data.bars[b]
        first = bar.start
        stop = bar.stop
        behind = -bar.left * (u[first + 1] - u[first])
        ahead = -bar.right * (u[stop - 1] - u[stop - 2])
        advance_uniform_row(u[first:stop], v[first:stop], behind, ahead, bar.rate, data.dt)


def add_energies(data: UniformRows, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the kinetic energy of all bars and their staggered strain energy, ``u_n K u_{n+1} / 2``."""
    kinetic = 0.0
    elastic = 0.0
    for b in range(data.bars.size):
        bar = data.bars[b]
        first = bar.start
        last = bar.stop - 1
        kinetic += bar.mass * sum_of_squares(v[first + 1 : last])
        kinetic += bar.first_mass * v[first] * v[first] + bar.last_mass * v[last] * v[last]
        elastic += bar.stiffness * sum_of_elongations(u[first : last + 1], v[first : last + 1], data.dt)
    data.totals[0].kinetic_energy += 0.5 * kinetic
    data.totals[0].elastic_energy += 0.5 * elastic


@reduction
def sum_of_squares(v: Floats) -> float:
    """Return the sum of the squares of velocities."""
    total = 0.0
    for i in range(v.size):
        total += v[i] * v[i]
    return total


@reduction
def sum_of_elongations(u: Floats, v: Floats, dt: float) -> float:
    """Return the sum over the elements of a bar of the product of their elongations after and before the step."""
    total = 0.0
    for i in range(u.size - 1):
        after = u[i + 1] - u[i]
        total += after * (after - dt * (v[i + 1] - v[i]))
    return total


@fused
def advance_uniform_row(u: Floats, v: Floats, behind: float, ahead: float, rate: float, dt: float) -> None:
    """Advance the nodes of a bar by a step, in place.

    Parameters
    ----------
    u, v
        Displacements and velocities.
    behind, ahead
        Elongations, before the step, of the elements left and right of these nodes.
    rate, dt
        That of the bar, and the time step.
    """
    last = v.size - 1
    for i in range(last):
        elongation = u[i + 1] - u[i]
        v[i] += rate * (elongation - behind)
        u[i] += dt * v[i]
        behind = elongation
    v[last] += rate * (ahead - behind)
    u[last] += dt * v[last]


def uniform_bars(model: Model, boundary_nodes: Sequence[int]) -> Any:
    """Return the bodies of a model as records `UNIFORM_BAR`; none if there is a body of another kind.

    Parameters
    ----------
    model
        The model of the run.
    boundary_nodes
        The nodes at which contacts, loads, supports or probes act.
    """
    bodies = list(model.bodies.values()) if model.bodies.of_lines else []
    ends = {node for body in bodies for node in (body.start, body.stop - 1)}
    bars = []
    if (
        bodies
        and model.dim == 1
        and not model.multistage
        and not model.facts.no_row_kernel
        and not model.loads.body_forces
        and ends.issuperset(boundary_nodes)
        and all(map(_is_uniform, bodies))
    ):
        for body in bodies:
            mass, inner = body.mass, body.mass[body.mass.size // 2]
            rate = model.dt * body.stiffness[0] / inner
            shares = inner / mass[0] - 1.0, inner / mass[-1] - 1.0
            bars.append((body.start, body.stop, rate, *shares, inner, mass[0], mass[-1], body.stiffness[0]))
    return record_array(bars, UNIFORM_BAR)


def _is_uniform(body: Body) -> bool:
    """Return whether a body is linear, with two-node elements of one stiffness and inner nodes of one mass.

    The kernels of a third-party plug-in are called in every step, whatever they declare: the run shows what they
    compute.
    """
    if body.of_cells:
        return False
    stiffness, inner_mass = body.stiffness, body.mass[1:-1]
    return not (
        body.why_not_linear
        or any(map(is_foreign, (body.spec.element, body.spec.material)))
        or np.any(stiffness != stiffness[0])
        or np.any(inner_mass != inner_mass[:1])
    )
