"""The growth rate of steady sliding: flutter of the equations of motion, whatever the time step.

A point that slides has the force ``lambda (N - mu T d)`` on its nodes, with d the unit vector of its slip. With
``lambda = -(D g + D_m g'')`` of closed contacts, ``B = N - mu T d`` and ``g = N^T u``

    (M + B D_m N^T) u'' + (K + B D N^T) u = 0 .

These matrices are not symmetric, so that some omega^2 may be complex: such a motion grows as exp(|Im omega| t). Where a
law has no compliance the gap stays closed, ``N^T u = 0``. The force follows from ``N^T u'' = 0``, which leaves
``u'' = -P M^-1 K u`` with the oblique projection ``P = I - M^-1 B (N^T M^-1 B)^-1 N^T``. It maps onto the motions with
``N^T u = 0``, and A = P M^-1 K is taken on these alone.

Central difference with forces from the current gap, or with gaps held closed, maps each omega^2 to
``z + 1/z = 2 - dt^2 omega^2``. A force from the gap at the end of the step damps a motion by a share of the step, which
vanishes as the step falls. So no smaller step ends the growth.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.blas import one_blas_thread
from percuss.certificate.matrices import motions_without, operator_of
from percuss.contact.frictions import frictional, frictions_of, tangents_of, with_stick
from percuss.march.starting_state import initial_velocity

if TYPE_CHECKING:
    from collections.abc import Iterator

    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats

MOST_MOTIONS = 2000  # nodes times dimensions up to which all frequencies are found, in about 7 s a direction
SMALL = 1e-9  # share of the largest one below which a slip, or what supports leave of a row, is round-off
NO_STEP = "no smaller step cures that"


class Flutter(NamedTuple):
    """The fastest growth while points with friction slide, as the equations of motion have it.

    Attributes
    ----------
    rate
        Growth rate; 0 where it is below round-off, None where it is not known [1/time].
    frequency
        Angular frequency of the motion that grows [1/time].
    told
        The same in words.
    """

    rate: float | None
    frequency: float | None
    told: str


@one_blas_thread()
@np.errstate(all="ignore")
def flutter_of(model: Model) -> Flutter | None:
    """Return the fastest growth while all points with friction slide, None without friction.

    Of each contact those points are closed that are at most a facet farther apart than its closest one. They slide
    along their slip at the start; contacts without any are tried along each axis of space, and the worst counts.
    Contacts without friction are closed. Supports and drives hold that act throughout the run. mu is the bound of a
    friction at a normal force of 1 and the slip rate of the start: how it changes with the rate does not count.
    """
    if not frictional(model):
        return None
    if not (why := _why_unknown(model)):
        try:
            return _fastest_of_all(model)
        except np.linalg.LinAlgError as error:
            why = str(error)
    return Flutter(None, None, f"what the equations do while points slide is not known: {why}")


def _why_unknown(model: Model) -> str:
    """Return why the growth is not known, in words; empty if it can be found."""
    if model.bodies.mass_of_dofs.size > MOST_MOTIONS:
        return f"{model.bodies.mass_of_dofs.size} degrees of freedom are more than {MOST_MOTIONS}"
    for one in model.laws:
        if one.linear is None:
            return f"{one.law.name} has a kernel of its own"
        if np.any(one.linear.rate) and np.any(one.linear.sigma):
            return f"{one.law.name} weighs the gap rate"
    return model.bodies.why_not_linear or model.why("linear laws")


def _fastest_of_all(model: Model) -> Flutter:
    """Return the fastest growth in all directions of slip that are tried."""
    points, held = model.contact_points, with_stick(model)
    count, operator = len(points), operator_of(held)
    scale = 1.0 / np.sqrt(operator.mass.diagonal())
    stiffness, mass = (scale[:, None] * one.toarray() * scale for one in (operator.stiffness, operator.mass))
    rows = scale[:, None] * operator.rows.toarray()
    sizes = np.linalg.norm(rows[:, :count], axis=0)
    first = np.array([points.gap[points.contact == k].min() for k in points.contact])
    closed = (points.gap - first <= points.facet) & (sizes > SMALL * sizes.max())  # supports and ties leave no others
    closed[list(model.inactive_points(0.5 * model.dt))] = False
    lines, found = np.zeros((3, count)), []
    for one in model.laws:
        linear: Any = one.linear
        inertia = linear.acceleration if linear.at == "explicit" else 0.0
        lines[:, list(one.where)] = np.broadcast_arrays(linear.sigma, linear.gap, inertia)
    for along, forces in _directions(model, held):
        pushed = rows[:, :count] + rows[:, count:] @ forces
        rate, frequency, floor = _fastest(
            stiffness, mass, rows[:, :count][:, closed], pushed[:, closed], lines[:, closed]
        )
        found.append((rate, frequency, floor, along))
    rate, frequency, floor, along = max(found)
    sliding = np.concatenate([one.where for one in frictions_of(model)])
    number = int(closed[sliding].sum())
    which = f"all {number}" if number == sliding.size else f"the {number} of {sliding.size} closest"
    while_ = f"while {which} points slide {along}, the equations"
    if rate <= floor:
        return Flutter(0.0, None, f"{while_} show no flutter above a rate of {floor:.1g}")
    growth = f"at a rate of {rate:.3g} (e-fold in {1.0 / rate:.3g}) with omega = {frequency:.3g}"
    return Flutter(rate, frequency, f"{while_} themselves flutter {growth}: {NO_STEP}")


def _directions(model: Model, held: Model) -> Iterator[tuple[str, Floats]]:
    """Yield each direction in which the first sides are tried to slide, in words, with its -mu d: (rows of T, P)."""
    points, dim, contacts = model.contact_points, model.dim, list(model.case.contacts)
    own = [np.flatnonzero(points.contact == contacts.index(name)) for name in frictional(model)]
    point = np.concatenate([np.tile(where, dim - 1) for where in own])  # of each row of T, as `with_stick` has them
    axis = np.concatenate([np.repeat(np.arange(dim - 1), where.size) for where in own])
    slip = (held.contact_points.matrix(model.bodies.n_nodes).T @ initial_velocity(model).ravel())[len(points) :]
    rate = np.sqrt(np.bincount(point, slip**2, len(points)))
    slip[rate[point] <= SMALL * rate.max()] = 0.0
    slides = np.bincount(points.contact[point], slip**2, len(contacts))[points.contact[point]] > 0.0
    mu = np.zeros(len(points))
    for one in frictions_of(model):
        bound, state = type(one.friction).bound, np.zeros(one.friction.state)
        mu[one.where] = [bound(one.data, j, 1.0, rate[p], state) for j, p in enumerate(one.where.tolist())]
    for k, sign in itertools.product(range(dim), (1.0, -1.0)):
        across = -sign * tangents_of(points.normal)[point, axis, k]
        direction = np.where(slides, slip, across)
        length = np.sqrt(np.bincount(point, direction**2, len(points)))[point]
        unit = np.divide(direction, length, out=np.zeros(point.size), where=length > SMALL * length.max())
        forces = np.zeros((point.size, len(points)))
        forces[np.arange(point.size), point] = -mu[point] * unit
        if slides.all():
            yield "along their slip at the start", forces
            return
        if np.abs(across).max() > SMALL:
            yield f"along {'-' if sign < 0.0 else ''}{'xyz'[k]}", forces


def _fastest(
    stiffness: Floats, mass: Floats, rows: Floats, pushed: Floats, lines: Floats
) -> tuple[float, float, float]:
    """Return rate and frequency of the fastest growth, and the rate below which growth is round-off.

    QR finds the eigenvalues of A + E, |E| <= n eps |A|. That moves a double omega^2 by sqrt(n eps |A|) omega at most,
    and one at 0 by n eps |A|: both change omega by less than sqrt(n eps |A|).

    Raises
    ------
    LinAlgError
        If gaps that are held closed follow from one another, or numbers are not finite.
    """
    from scipy.linalg import eigvals

    sigma, gap, acceleration = lines
    soft = sigma > 0.0
    seen, exact = pushed[:, soft] / sigma[soft], rows[:, ~soft]
    mass = mass + (seen * acceleration[soft]) @ rows[:, soft].T
    matrix = np.linalg.solve(mass, stiffness + (seen * gap[soft]) @ rows[:, soft].T)
    if exact.size:
        left = motions_without(exact.T)
        if left.shape[1] != exact.shape[0] - exact.shape[1]:
            raise np.linalg.LinAlgError("more points are held closed exactly than the bodies can follow")
        moved = np.linalg.solve(mass, pushed[:, ~soft])
        matrix -= moved @ np.linalg.solve(exact.T @ moved, exact.T @ matrix)
        matrix = left.T @ (matrix @ left)
    if not np.isfinite(matrix).all():
        raise np.linalg.LinAlgError("the numbers of its matrices are not finite")
    omega = np.sqrt(eigvals(matrix, check_finite=False).astype(complex))
    fastest = omega[np.abs(omega.imag).argmax()]
    floor = math.sqrt(len(matrix) * np.finfo(float).eps * float(np.linalg.norm(matrix)))
    return float(abs(fastest.imag)), float(abs(fastest.real)), floor
