"""Bars of equal elements in one dimension, whose step needs one number in the place of arrays.

All inner nodes of such a bar have the same mass and all elements the same stiffness: a step without contact is
``v += rate ((u_{i+1} - u_i) - (u_i - u_{i-1}))``, then ``u += dt v``. Plain Python rounds the products before it adds
them and differs by round-off.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.marks import fused

if TYPE_CHECKING:
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


def advance_whole(bars: Any, u: Floats, v: Floats, dt: float) -> None:
    """Advance all nodes of all bars, records `UNIFORM_BAR`, by a step, as if nothing acted on the ends.

    Beyond an end of half the mass of an inner node, an element with the opposite elongation would have the same effect.
    """
    for b in range(bars.size):
        bar = bars[b]
        first = bar.start
        stop = bar.stop
        behind = -bar.left * (u[first + 1] - u[first])
        ahead = -bar.right * (u[stop - 1] - u[stop - 2])
        advance_row(u[first:stop], v[first:stop], behind, ahead, bar.rate, dt)


def energies(bars: Any, u: Floats, v: Floats, dt: float) -> tuple[float, float]:
    """Return the kinetic energy of all bars and their staggered strain energy, ``u_n K u_{n+1} / 2``."""
    kinetic = 0.0
    elastic = 0.0
    for b in range(bars.size):
        bar = bars[b]
        first = bar.start
        last = bar.stop - 1
        kinetic += bar.mass * sum_of_squares(v[first + 1 : last])
        kinetic += bar.first_mass * v[first] * v[first] + bar.last_mass * v[last] * v[last]
        elastic += bar.stiffness * sum_of_elongations(u[first : last + 1], v[first : last + 1], dt)
    return 0.5 * kinetic, 0.5 * elastic


def sum_of_squares(v: Floats) -> float:
    """Return the sum of the squares of velocities."""
    total = 0.0
    for i in range(v.size):
        total += v[i] * v[i]
    return total


sum_of_squares.reduction = True  # type: ignore[attr-defined]


def sum_of_elongations(u: Floats, v: Floats, dt: float) -> float:
    """Return the sum over the elements of a bar of the product of their elongations after and before the step."""
    total = 0.0
    for i in range(u.size - 1):
        after = u[i + 1] - u[i]
        total += after * (after - dt * (v[i + 1] - v[i]))
    return total


sum_of_elongations.reduction = True  # type: ignore[attr-defined]


@fused
def advance_row(u: Floats, v: Floats, behind: float, ahead: float, rate: float, dt: float) -> None:
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
