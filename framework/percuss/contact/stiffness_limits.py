"""The largest contact stiffness for which central difference is stable, from the bodies behind each end."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.mesh.eigenvalues import as_bands

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from percuss.contact.contact_point import ContactPoint
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats

# Limits are computed for at most this Courant number of a body: above it central difference leaves
# almost no stiffness for a penalty without mass.
LARGEST_COURANT = 0.99


def stiffness_limits(
    bodies: Iterable[Body], contact_points: Sequence[ContactPoint], moved: Sequence[Collection[int]], dt: float
) -> Floats:
    """Return `ContactPoints.stiffness_limit` of all contact points for a time step `dt`, (P,) [force/length].

    With B = (4/dt^2) M - K of a body and its end displacements u_a and u_b, ``u^T B u`` is at least
    ``r_a u_a^2 + r_b u_b^2``; both r follow from the inverse of B at the end nodes (`end_reserves`). A closed
    contact of stiffness eps_s subtracts ``eps_s (u_a - u_b)^2``, which is not larger than that if
    ``eps_s (1/r_a + 1/r_b) <= 1``. Contacts that share an end share its r equally.

    Parameters
    ----------
    bodies, contact_points
        Bodies and contact points of a model.
    moved
        Nodes of each contact point that its force moves at some time of the run; the others are fixed or driven.
    dt
        Time step.
    """
    uses = Counter(node for contact_point in contact_points for node in contact_point.nodes)
    reserve: dict[int, float] = {}
    of_alike: dict[Any, list[float]] = {}  # bodies of the same mass and stiffness are looked at once
    for body in bodies:
        ends = [node for node in (body.start, body.stop - 1) if node in uses]
        if ends:
            step = min(dt, LARGEST_COURANT * 2.0 / body.highest_frequency)
            stiffness = body.stiffness if not body.of_cells else body.axial_stiffness.data
            inverse = body.mass if body.inverse is None else body.inverse.data
            arrays = [array.tobytes() for array in (body.mass, inverse, stiffness)]
            alike = (step, *(node - body.start for node in ends), *arrays)
            if alike not in of_alike:
                of_alike[alike] = list(end_reserves(body, step, ends).values())
            reserve.update(zip(ends, of_alike[alike], strict=True))
    with np.errstate(divide="ignore"):
        softness = [sum(uses[node] / np.float64(reserve[node]) for node in nodes) for nodes in moved]
        return 1.0 / np.array(softness, dtype=float)


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
    if (inverse := body.inverse) is not None:
        matrix = as_bands(4.0 / dt**2 * inverse - inverse @ body.axial_stiffness @ inverse)
        return _reserves(matrix, [node - body.start for node in ends], ends, lower=True, coupling=inverse)
    banded = np.zeros((2, body.mass.size))
    if body.of_cells:
        banded = -as_bands(body.axial_stiffness)
        banded[0] += 4.0 / dt**2 * body.mass
    else:
        banded[0, 1:] = body.stiffness
        banded[1] = 4.0 / dt**2 * body.mass
        banded[1, :-1] -= body.stiffness
        banded[1, 1:] -= body.stiffness
    lower = body.of_cells
    # Only ends of two-node elements are without mass, and carried by the node beside them.
    first, last = (int(body.carrier(node) != node) for node in (body.start, body.stop - 1))
    reserves = dict.fromkeys(ends, np.inf)
    if rest := [node for node in ends if body.carrier(node) == node]:
        places = [node - body.start - first for node in rest]
        reserves |= _reserves(banded[:, first : banded.shape[1] - last], places, rest, lower=lower)
    return reserves


def _reserves(
    banded: Floats, places: Sequence[int], ends: Sequence[int], *, lower: bool, coupling: Any = None
) -> dict[int, float]:
    """Return `end_reserves` at the nodes `ends`, which are the rows `places` of a banded matrix.

    Where the mass couples nodes, that matrix is ``C ((4/dt^2) M - K) C`` with C = M^-1, which is `coupling`.
    """
    from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

    try:
        factor = cholesky_banded(banded, lower=lower, check_finite=False)
    except LinAlgError:  # with nodal masses other than lumped ones the free body may be unstable at this step
        return dict.fromkeys(ends, 0.0)
    unit = np.zeros((banded.shape[1], len(ends)))
    unit[places, np.arange(len(ends))] = 1.0
    if coupling is not None:
        compliance = coupling @ cho_solve_banded((factor, lower), coupling @ unit)
    else:
        compliance = cho_solve_banded((factor, lower), unit)
    stiffness = np.linalg.inv(compliance[list(places)])
    diagonal = np.diag(stiffness)
    if len(ends) == 2:
        # The matrix [[a, c], [c, b]] minus (1 - |c| / sqrt(a b)) times its diagonal is positive semi-definite, so
        # that this fraction of the diagonal is a safe lower bound.
        diagonal = diagonal * (1.0 - abs(stiffness[0, 1]) / np.sqrt(stiffness[0, 0] * stiffness[1, 1]))
    return {node: float(r) for node, r in zip(ends, diagonal, strict=True)}
