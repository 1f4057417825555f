"""The largest contact stiffness for which central difference is stable, for any set of closed contacts."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.mesh.eigenvalues import as_bands, highest_value

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from percuss.contact.points import PointArrays, Rows
    from percuss.mesh.bodies import Bodies
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers

# Limits are computed for at most this Courant number of a body: above it central difference leaves
# almost no stiffness for a penalty without mass.
LARGEST_COURANT = 0.99
# Relative errors of conjugate gradients and of the largest eigenvalue of the compliance of at most so many motions, and
# of more motions, for which a stiffness that is 1 % lower costs far less.
FEW_MOTIONS, TO_ALL_DIGITS, ROUGHLY = 10_000, (1e-12, 1e-9), (1e-5, 1e-2)


def stiffness_limits(bodies: Bodies, points: PointArrays, over_the_run: Iterable[Rows]) -> Callable[[float], Floats]:
    """Return the function that gives `ContactPoints.stiffness_limit` of all points for a time step, (P,).

    Parameters
    ----------
    bodies, points
        Those of a model.
    over_the_run
        The rows of the points while each set of supports and drives of the run acts. A node that no force moves at any
        time is fixed or driven.
    """
    moved = []
    for rows in over_the_run:
        # Round-off may be left of the direction of a drive that is oblique to the axes.
        moves = (rows.beside >= 0) | (np.vecdot(rows.normal, rows.response) * bodies.mass[rows.node] > 1e-12)
        moved.append(np.stack([rows.point[moves], rows.node[moves]]))
    point, node = np.unique(np.concatenate(moved, axis=1), axis=1)
    if bodies.of_lines:
        return partial(_limits_of_ends, list(bodies.values()), points, point, node)
    return _SurfaceLimits(bodies, points, node).at


# ------------------------------------------------------------------------------------------------------- ends of bars


def _limits_of_ends(bodies: Iterable[Body], points: PointArrays, point: Integers, node: Integers, dt: float) -> Floats:
    """Return the limits of the ends of bars for a time step `dt`, (P,) [force/length].

    With B = (4/dt^2) M - K of a body and its end displacements u_a and u_b, ``u^T B u`` is at least
    ``r_a u_a^2 + r_b u_b^2``; both r follow from the inverse of B at the end nodes (`end_reserves`). A closed
    contact of stiffness eps_s subtracts ``eps_s (u_a - u_b)^2``, which is not larger than that if
    ``eps_s (1/r_a + 1/r_b) <= 1``. Contacts that share an end share its r equally. The nodes `node` of the points
    `point` are those that move.
    """
    uses = np.bincount(points.node)
    reserve = np.full(uses.size, np.nan)
    of_alike: dict[Any, list[float]] = {}  # bodies of the same mass and stiffness are looked at once
    for body in bodies:
        ends = [end for end in (body.start, body.stop - 1) if end < uses.size and uses[end] > 0]
        if ends:
            step = min(dt, LARGEST_COURANT * 2.0 / body.highest_frequency)
            stiffness = body.axial_stiffness.data if body.of_cells else body.stiffness
            inverse = body.mass if body.inverse is None else body.inverse.data
            arrays = [array.tobytes() for array in (body.mass, inverse, stiffness)]
            alike = (step, *(end - body.start for end in ends), *arrays)
            if alike not in of_alike:
                of_alike[alike] = list(end_reserves(body, step, ends).values())
            reserve[ends] = of_alike[alike]
    with np.errstate(divide="ignore"):
        limits: Floats = 1.0 / np.bincount(point, uses[node] / reserve[node], len(points))
    return limits


def end_reserves(body: Body, dt: float, ends: Sequence[int]) -> dict[int, float]:
    """Return the largest contact stiffness r at each end for which central difference is stable [force/length].

    For every displacement u of the body ``u^T ((4/dt^2) M - K) u >= sum of r u_end^2`` over the given ends. Where the
    step is unstable for the body by itself, r is 0. At an end without mass r is infinite: behind its end element a
    contact is never stiffer than that, and the reserve of the other end allows for a rigid one.

    Parameters
    ----------
    body
        The body without its supports, which makes r smaller and thus safe.
    dt
        Time step.
    ends
        The end nodes in contact, one or both.
    """
    from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

    reserves = dict.fromkeys(ends, np.inf)
    heavy = [node for node in ends if body.carrier(node) == node]
    if not heavy:
        return reserves
    # Only ends of two-node elements are without mass, and carried by the node beside them.
    first, last = (int(body.carrier(node) != node) for node in (body.start, body.stop - 1))
    if (coupling := body.inverse) is not None:  # C B C with C = M^-1, which has few diagonals
        banded = as_bands(4.0 / dt**2 * coupling - coupling @ body.axial_stiffness @ coupling)
    elif body.of_cells:
        banded = -as_bands(body.axial_stiffness)
        banded[0] += 4.0 / dt**2 * body.mass
    else:
        banded = np.stack([np.append(0.0, body.stiffness), 4.0 / dt**2 * body.mass])
        banded[1, :-1] -= body.stiffness
        banded[1, 1:] -= body.stiffness
    lower = body.of_cells or coupling is not None
    banded = banded[:, first : banded.shape[1] - last]
    try:
        factor = cholesky_banded(banded, lower=lower, check_finite=False)
    except LinAlgError:  # with nodal masses other than lumped ones the free body may be unstable at this step
        return reserves | dict.fromkeys(heavy, 0.0)
    places, unit = [node - body.start - first for node in heavy], np.zeros((banded.shape[1], len(heavy)))
    unit[places, np.arange(len(heavy))] = 1.0
    if coupling is not None:
        compliance = coupling @ cho_solve_banded((factor, lower), coupling @ unit)
    else:
        compliance = cho_solve_banded((factor, lower), unit)
    stiffness = np.linalg.inv(compliance[places])
    diagonal = np.diag(stiffness)
    if len(heavy) == 2:
        # The matrix [[a, c], [c, b]] minus (1 - |c| / sqrt(a b)) times its diagonal is positive semi-definite, so
        # that this fraction of the diagonal is a safe lower bound.
        diagonal = diagonal * (1.0 - abs(stiffness[0, 1]) / np.sqrt(stiffness[0, 0] * stiffness[1, 1]))
    return reserves | dict(zip(heavy, diagonal.tolist(), strict=True))


# ----------------------------------------------------------------------------------------------- surfaces of solids


class _SurfaceLimits:
    """The `ContactPoints.stiffness_limit` of all contact points of bodies that are no bars, for any time step.

    With B = (4/dt^2) M - K of all bodies without supports, closed contacts of the stiffness D are stable where
    ``B - N D N^T`` is positive semi-definite: where the largest eigenvalue of ``D^1/2 N^T B^-1 N D^1/2`` is at most 1.
    The limits are in proportion to the stiffness of the points, ``M w/h``, so that they hold for all sets of points.

    The eigenvalue is that of an iteration, in which conjugate gradients solve for B^-1. They need few products, as the
    numbers of ``M^-1 B`` lie between those of B at the highest frequency and at rest. Each product reaches the next
    neighbours of the contact points, so that of large bodies only what lies near their surfaces is looked at.

    Parameters
    ----------
    bodies, points
        Bodies and contact points of a model.
    moved
        Nodes that the force of a point moves at some time of the run; the others are fixed or driven.
    """

    def __init__(self, bodies: Bodies, points: PointArrays, moved: Integers) -> None:
        self._bodies, self._points, self._moved = bodies, points, moved

    @cached_property
    def _longest_step(self) -> float:
        root = 1.0 / np.sqrt(self._bodies.mass_of_dofs)
        highest = highest_value(lambda u: root * self._bodies.stiffness_times(root * u), root.size)
        return float(LARGEST_COURANT * 2.0 / np.sqrt(highest))

    def at(self, dt: float) -> Floats:
        """Return the limits for a time step `dt`, (P,) [force/length]."""
        from scipy.sparse import csr_array, diags_array
        from scipy.sparse.linalg import LinearOperator, cg

        bodies, points = self._bodies, self._points
        solved_to, iterated_to = TO_ALL_DIGITS if bodies.nodes.size <= FEW_MOTIONS else ROUGHLY
        # No frequency is above that of the fastest cell.
        fits = dt * bodies.omega <= 2.0 * LARGEST_COURANT
        step = dt if fits else min(dt, self._longest_step)
        times: Callable[[Floats], Floats] = bodies.stiffness_times
        near = np.arange(bodies.n_nodes)
        if bodies.nodes.size > FEW_MOTIONS and not any(body.is_bar for body in bodies.values()):
            near, times = _near(bodies, self._moved, _products(0.5 * dt * bodies.omega if fits else LARGEST_COURANT))
        dofs = (near[:, None] * bodies.dim + np.arange(bodies.dim)).ravel()
        root, moves = 1.0 / np.sqrt(bodies.mass_of_dofs[dofs]), np.repeat(np.isin(near, self._moved), bodies.dim)
        of_points = points.matrix(bodies.n_nodes)[dofs] @ diags_array(np.sqrt(points.stiffness))
        rows = csr_array(diags_array(root * moves) @ of_points)  # M^-1/2 N D^1/2
        reserve = LinearOperator(2 * (dofs.size,), lambda u: 4.0 / step**2 * u - root * times(root * u), dtype=float)

        def compliance(force: Floats) -> Floats:
            moved, _ = cg(reserve, rows @ force, rtol=solved_to)
            answer: Floats = rows.T @ moved
            return answer

        # The residual bounds what is missing to the eigenvalue.
        largest = highest_value(compliance, len(points), iterated_to) * (1.0 + iterated_to)
        limits: Floats = points.stiffness / largest
        return limits


def _products(share: float) -> int:
    """Return the number of products by which conjugate gradients solve for B^-1 roughly.

    `share` is the time step over the longest one for which B is positive definite.
    """
    root = math.sqrt(1.0 - share**2)  # 1 / root^2 is the condition number of M^-1 B
    return math.ceil(0.5 * math.log(2.0 / root / ROUGHLY[0]) / math.log((1.0 + root) / share))


def _near(bodies: Bodies, nodes: Integers, steps: int) -> tuple[Integers, Callable[[Floats], Floats]]:
    """Return the nodes of solids that are at most so many neighbours away from `nodes`, and K u of these alone.

    Where they are most of all nodes, all are taken.
    """
    near = []
    for body in bodies.values():
        own = nodes[(nodes >= body.start) & (nodes < body.stop)] - body.start
        near.append(body.stiffness_rows.near(own, steps))
    found = np.concatenate([body.start + one for body, one in zip(bodies.values(), near, strict=True)])
    if 2 * found.size > bodies.n_nodes:
        return np.arange(bodies.n_nodes), bodies.stiffness_times
    parts = [body.stiffness_rows.among(one) for body, one in zip(bodies.values(), near, strict=True)]
    rest = np.zeros(bodies.dim)
    ends = np.cumsum([one.size * bodies.dim for one in near])[:-1]

    def times(motion: Floats) -> Floats:
        held = []
        for rows, of_body in zip(parts, np.split(motion, ends), strict=True):
            with_rest = np.append(of_body, rest)
            held.append(np.zeros_like(with_rest))
            rows.hold(with_rest, held[-1])
        return np.concatenate([force[: -rest.size] for force in held])

    return found, times
