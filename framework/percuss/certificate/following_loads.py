"""Loads that follow the motion of an end, as the certificate knows them: by stiffness and damping, from samples."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from percuss.march.model import Model
    from percuss.mesh.loads import Follower

MOTIONS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 3.0), (2e-6, -5e-3), (-4e3, -7e4), (1e-9, 2e3))  # displacement, velocity
SHARES_OF_THE_RUN = (0.0, 0.13, 0.31, 0.77, 1.0)
TOLERANCE = 1e-9  # relative to the largest term of the sum


def stiffness_and_damping(follower: Follower, end: float) -> tuple[float, float] | None:
    """Return k and c of a load whose kernel returns ``-k u - c u'``, None for any other, judged by samples.

    Parameters
    ----------
    follower
        The load.
    end
        End of the run.
    """
    try:
        k, c = (-follower.kernel(follower.numbers, 0.0, *motion) for motion in MOTIONS[:2])
        for share in SHARES_OF_THE_RUN:
            for displacement, velocity in MOTIONS:
                force = follower.kernel(follower.numbers, share * end, displacement, velocity)
                size = abs(k * displacement) + abs(c * velocity)
                if not abs(force + k * displacement + c * velocity) <= TOLERANCE * size:
                    return None
    except Exception:  # noqa: BLE001  A kernel need not be made for motions as large as these.
        return None
    return float(k), float(c)


def why_unknown(model: Model) -> str:
    """Return why no certificate covers the loads that follow the motion; empty if one does, or if there is none."""
    end = model.steps * model.dt
    for follower in model.followers:
        name = f"load '{follower.load.name}' follows the motion of an end"
        if follower.load.start > 0 or follower.load.stop < end:
            return f"{name} during a part of the run alone"
        if stiffness_and_damping(follower, end) is None:
            return f"{name}, and its force is no sum of a spring and a dashpot"
    return ""


def why_beyond_pencil(model: Model) -> str:
    """Return why the pencil does not cover a load that follows the motion; empty if it covers all of them.

    Under a leap-frog scheme the velocity of such a load is centred in the step: its dashpot takes energy at any step,
    and its spring adds to the stiffness of the end.
    """
    touched = {node for contact_point in model.contact_points for node in contact_point.nodes}
    for follower in model.followers:
        name = f"load '{follower.load.name}' follows the motion of an end"
        found = stiffness_and_damping(follower, model.steps * model.dt)
        along = abs(float(follower.force @ model.body_of(follower.node).mesh.direction))
        if found is None or min(found) < 0.0:
            return f"{name} otherwise than a spring and a dashpot"
        if model.multistage:
            return f"{name} at the stages of {model.case.method.integrator.name}"
        if follower.node in touched:
            return f"{name} in contact"
        if not math.isclose(along, 1.0, rel_tol=1e-9):
            return f"{name} across its bar"
    return ""


def end_stiffness(model: Model) -> dict[int, float]:
    """Return the stiffness of the springs at the ends of bars, by node."""
    end = model.steps * model.dt
    springs: dict[int, float] = {}
    for follower in model.followers:
        stiffness, _ = stiffness_and_damping(follower, end) or (0.0, 0.0)
        along = float(follower.force @ model.body_of(follower.node).mesh.direction)
        springs[follower.node] = stiffness * along**2
    return springs


def directions(model: Model) -> Any:
    """Return the directions of the loads that follow the motion, (loads, nodes * dim)."""
    out = np.zeros((len(model.followers), model.n_nodes * model.dim))
    for row, follower in zip(out, model.followers, strict=True):
        row[follower.node * model.dim : (follower.node + 1) * model.dim] = follower.force
    return out
