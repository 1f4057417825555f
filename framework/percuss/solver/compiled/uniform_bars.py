"""Bars of equal elements in one dimension, which advance by several steps at a time.

All inner nodes of such a bar have the same mass and all elements the same stiffness, so that a step needs one number in
the place of arrays: ``v += rate ((u_{i+1} - u_i) - (u_i - u_{i-1}))``, then ``u += dt v``. Contacts, loads and supports
act on the end nodes alone, and what happens there reaches one node more in every step. The loop therefore advances the
inside of the bars by several steps first, each step on one node less at either end, and then, step by step, the end
nodes with the nodes that were left out. Tile by tile, the inside stays in the first-level cache for all these steps.

Every node is advanced by the same operations on the same numbers, whatever the number of steps at a time: the results
are equal bit for bit. Plain Python rounds the products before it adds them and differs by round-off.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.solver.compiled.marks import apart, fused

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats

LINE = 8  # numbers in a line of the cache

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


class UniformBars(NamedTuple):
    """All bodies of a model, if each is a bar of equal elements; no bars if one is not."""

    bars: Any  # UNIFORM_BAR
    steps: int  # largest number of steps at a time
    tile: int  # nodes of a tile
    left: Floats  # (bars, steps) elongation, before each step, of the element left of those that advance inside
    right: Floats  # (bars, steps) the same of the element right of them
    between: Floats  # (steps,) the same of the element between two tiles


def advance_whole(uniform: UniformBars, u: Floats, v: Floats, dt: float) -> None:
    """Advance all nodes of all bars by a step, as if nothing acted on the ends.

    Beyond an end of half the mass of an inner node, an element with the opposite elongation would have the same effect.
    """
    for b in range(uniform.bars.size):
        bar = uniform.bars[b]
        first = bar.start
        stop = bar.stop
        behind = -bar.left * (u[first + 1] - u[first])
        ahead = -bar.right * (u[stop - 1] - u[stop - 2])
        advance_row(u, v, first, stop, behind, ahead, bar.rate, dt)


@apart
def advance_inside(uniform: UniformBars, u: Floats, v: Floats, steps: int, dt: float) -> None:
    """Advance the inside of all bars by `steps` steps, in step k all nodes but k + 1 at either end.

    A tile makes all its steps before the next one begins. As the node right of it is not ahead yet, it ends further
    left in every step, by a whole line of the cache: all tiles but the first begin with a line in every step.
    """
    between = uniform.between
    for b in range(uniform.bars.size):
        bar = uniform.bars[b]
        left, right = uniform.left[b], uniform.right[b]
        first = bar.start + 1
        stop = bar.stop - 1
        tile = first
        while tile < stop:
            # The first tile does not begin with a line: it is as short as its ends, which approach each other, allow.
            size = uniform.tile if tile > first else (LINE + 1) * steps
            following = (tile + size + LINE - 1) // LINE * LINE
            for k in range(steps):
                lo = tile - LINE * k
                hi = following - LINE * k if following < stop else stop - k
                if tile == first:
                    lo = first + k
                    left[k] = between[k] = u[lo] - u[lo - 1]
                between[k] = advance_tile(u[lo : hi + 1], v[lo:hi], between[k], bar.rate, dt)
            tile = following
        for k in range(steps):
            right[k] = between[k]


def advance_ends(uniform: UniformBars, u: Floats, v: Floats, k: int, dt: float) -> None:
    """Advance by a step the nodes that `advance_inside` has left out in step k, as if nothing acted on the ends."""
    for b in range(uniform.bars.size):
        bar = uniform.bars[b]
        first = bar.start
        stop = bar.stop
        inner = uniform.left[b, k]
        outer = u[first + 1] - u[first] if k > 0 else inner
        advance_row(u, v, first, first + k + 1, -bar.left * outer, inner, bar.rate, dt)
        inner = uniform.right[b, k]
        outer = u[stop - 1] - u[stop - 2] if k > 0 else inner
        advance_row(u, v, stop - k - 1, stop, inner, -bar.right * outer, bar.rate, dt)


def energies(uniform: UniformBars, u: Floats, v: Floats, dt: float) -> tuple[float, float]:
    """Return the kinetic energy of all bars and their staggered strain energy, ``u_n K u_{n+1} / 2``."""
    kinetic = 0.0
    elastic = 0.0
    for b in range(uniform.bars.size):
        bar = uniform.bars[b]
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
def advance_row(
    u: Floats, v: Floats, first: int, stop: int, behind: float, ahead: float, rate: float, dt: float
) -> None:
    """Advance the nodes from `first` to `stop` by a step between elements with elongations `behind` and `ahead`."""
    last = stop - 1
    behind = advance_tile(u[first:stop], v[first:last], behind, rate, dt)
    v[last] += rate * (ahead - behind)
    u[last] += dt * v[last]


@fused
def advance_tile(u: Floats, v: Floats, behind: float, rate: float, dt: float) -> float:
    """Advance the nodes of `v` by a step, in place; `u` has one node more on the right, which stays.

    Parameters
    ----------
    u, v
        Displacements and velocities.
    behind
        Elongation, before the step, of the element left of these nodes.
    rate, dt
        That of the bar, and the time step.

    Returns
    -------
    float
        The elongation, before the step, of the element right of these nodes.
    """
    for i in range(v.size):
        elongation = u[i + 1] - u[i]
        v[i] += rate * (elongation - behind)
        u[i] += dt * v[i]
        behind = elongation
    return behind
