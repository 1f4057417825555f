"""Loads that follow the motion of an end: their forces, from the kernels of their classes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from percuss.contact.features import Feature
from percuss.methods.slots import follow
from percuss.record_arrays import Records, Row, record_array
from percuss.step.actions import AFTER_STEP, BEFORE_SUPPORTS, LOADS_OF_A_STAGE, Action
from percuss.step.loads import work_along
from percuss.step.part import Part, Setting
from percuss.step.records import Loads

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.mesh.loads import Follower
    from percuss.methods.interfaces import Floats

# The force of a load that follows the motion of a node along `axes` from index `axis` on.
FOLLOWER = np.dtype(
    [
        ("place", "i8"),
        ("axis", "i8"),
        ("inverse_mass", "f8"),
        ("column", "i8"),
        ("start", "f8"),  # time at which the load is switched on, from which it counts its own
        ("stop", "f8"),  # time at which it is switched off
        ("displacement", "f8"),  # of the node along the axis
        ("velocity", "f8"),  # of the node along the axis, as it is without this force
        ("response", "f8"),  # change of that velocity by a force of 1
        ("share", "f8"),  # fraction of the step in which the load is on
        ("force", "f8"),
        ("impulse", "f8"),  # sum over the steps of a leap-frog scheme
    ]
)
DOUBLINGS = 60
HALVINGS = 200
ROUND_OFF = 1e-15
# Of the samples by which a force is found to be a spring and a dashpot.
MOTIONS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 3.0), (2e-6, -5e-3), (-4e3, -7e4), (1e-9, 2e3))  # displacement, velocity
SHARES_OF_THE_RUN = (0.0, 0.13, 0.31, 0.77, 1.0)
TOLERANCE = 1e-9  # relative to the largest term of the sum


class Following(NamedTuple):
    """All loads of a run that follow the motion of an end."""

    followers: Records  # FOLLOWER
    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    loads: Loads
    totals: Records  # percuss.step.records.TOTAL
    now: Records  # percuss.step.records.NOW
    velocities: Floats  # (stages,) c, as in `percuss.methods.interfaces.Stages`


class FollowingLoad(NamedTuple):
    """One of these loads: what its kernel reads, and its record."""

    numbers: tuple[float, ...]
    followers: Any  # FOLLOWER, a single record
    now: Records  # percuss.step.records.NOW


class Followers(Part[Following]):
    """The part of a step with loads that follow the motion of an end."""

    def __init__(self, setting: Setting, data: Following) -> None:
        super().__init__(data)
        self.loads, self.multistage = setting.model.loads.followers, setting.model.multistage

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where no load follows the motion of an end."""
        model, step, rows = setting.model, setting.step, []
        if not model.loads.followers:
            return None
        first = step.loads.axes.size // model.dim - len(model.loads.followers)  # their axes are the last ones
        for i, follower in enumerate(model.loads.followers, start=first):
            place, mobility = setting.place[follower.node], model.bodies.mobility(follower.node)
            times = follower.switched_on, follower.load.stop
            rows.append((place, i * model.dim, mobility, follower.column, *times, *([0.0] * 6)))
        followers = record_array(rows, FOLLOWER)
        if before is not None:
            followers["impulse"] = before.data.followers["impulse"]
        velocities = np.array(model.stages.velocity or [0.0] * len(model.stages.times) if model.stages else ())
        return cls(setting, Following(followers, step.boundary, step.loads, step.totals, step.now, velocities))

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step or of a stage: see the motion, compute the forces, push."""
        place = LOADS_OF_A_STAGE if self.multistage else BEFORE_SUPPORTS
        yield Action(place, see_in_stage if self.multistage else see_ends, self.data)
        for i, follower in enumerate(self.loads):
            data = FollowingLoad(follower.numbers, self.data.followers[i : i + 1], self.data.now)
            load, slots = follower.load.load, {follow: follower.kernel}
            name = f"load {load.name}"
            yield Action(place, find_force, data, slots, of_plugin=True, allocates=load.allocates, name=name)
        yield Action(place, push_in_stage if self.multistage else push_ends, self.data)
        yield Action(AFTER_STEP, add_work, self.data)

    def impulse(self) -> Floats | None:
        """Return the impulse of the loads so far, (dim,)."""
        impulses = zip(self.loads, self.data.followers, strict=True)
        return np.asarray(sum(record.impulse * follower.force for follower, record in impulses))

    def changing_arrays(self) -> list[Any]:
        """Return the records of the loads."""
        return [self.data.followers]


def feature(model: Model) -> Feature | None:
    """Return what is to know of loads that follow the motion of an end; None where there is none."""
    if not model.loads.followers:
        return None
    return Feature(
        name="loads that follow the motion of an end",
        forces=model.loads.followers,
        springs=_springs,
        reasons={"linear laws": _why_beyond_linear_laws, "certificate": _why_unknown},
    )


def _stiffness_and_damping(follower: Follower, end: float) -> tuple[float, float] | None:
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


def _why_unknown(model: Model) -> str:
    """Return why no certificate covers the loads that follow the motion; empty if one does."""
    end = model.steps * model.dt
    for follower in model.loads.followers:
        name = f"load '{follower.load.name}' follows the motion of an end"
        if follower.load.start > 0 or follower.load.stop < end:
            return f"{name} during only a part of the run"
        if _stiffness_and_damping(follower, end) is None:
            return f"{name}, and its force is no sum of a spring and a dashpot"
    return ""


def _why_beyond_linear_laws(model: Model) -> str:
    """Return why the linear laws do not cover a load that follows the motion; empty if it covers all of them.

    Under a leap-frog scheme the velocity of such a load is centred in the step: its dashpot takes energy at any step,
    and its spring adds to the stiffness of the end.
    """
    touched = set(model.contact_points.node.tolist())
    for follower in model.loads.followers:
        name = f"load '{follower.load.name}' follows the motion of an end"
        found = _stiffness_and_damping(follower, model.steps * model.dt)
        along = abs(float(follower.force @ model.bodies.at(follower.node).mesh.direction))
        if found is None or min(found) < 0.0:
            return f"{name} otherwise than a spring and a dashpot"
        if model.multistage:
            return f"{name} at the stages of {model.case.method.integrator.name}"
        if follower.node in touched:
            return f"{name} in contact"
        if not math.isclose(along, 1.0, rel_tol=1e-9):
            return f"{name} across its bar"
    return ""


def _springs(model: Model) -> dict[int, float]:
    """Return the stiffness of the springs at the ends of bars, by node."""
    end = model.steps * model.dt
    springs: dict[int, float] = {}
    for follower in model.loads.followers:
        stiffness, _ = _stiffness_and_damping(follower, end) or (0.0, 0.0)
        along = float(follower.force @ model.bodies.at(follower.node).mesh.direction)
        springs[follower.node] = stiffness * along**2
    return springs


# ------------------------------------------------------------------------------------------------- leap-frog schemes


def see_ends(data: Following, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set displacement and velocity of the ends, those at t_n."""
    now, axes = data.now[0], data.loads.axes
    for i in range(data.followers.size):
        follower = data.followers[i]
        displacement = 0.0
        velocity = 0.0
        for d in range(now.dim):
            q = data.boundary[follower.place + d]
            displacement += axes[follower.axis + d] * q.old_u
            velocity += axes[follower.axis + d] * 0.5 * (q.old_v + q.new_v)
        follower.displacement = displacement
        follower.velocity = velocity
        follower.response = 0.5 * now.dt * follower.inverse_mass
        follower.share = data.loads.amplitudes[follower.column]


def push_ends(data: Following, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the velocity change by the forces; the amplitude of a load becomes its force."""
    now, axes = data.now[0], data.loads.axes
    for i in range(data.followers.size):
        follower = data.followers[i]
        follower.impulse += now.dt * follower.force
        data.loads.amplitudes[follower.column] = follower.force
        scale = now.dt * follower.inverse_mass * follower.force
        for d in range(now.dim):
            q = data.boundary[follower.place + d]
            q.load += follower.force * axes[follower.axis + d]
            q.new_v += scale * axes[follower.axis + d]


def add_work(data: Following, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the work of the forces."""
    data.totals[0].work_of_parts += work_along(data.followers, data.loads, data.boundary, data.now[0])


# ----------------------------------------------------------------------------------------------- multi-stage schemes


def see_in_stage(data: Following, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set displacement and velocity of the ends in stage n, and what a force adds to the velocity.

    The forces act at the velocity ``v + c a`` of the stage, to which each of them adds ``c / m`` of its own.
    """
    ahead, axes, dim = data.velocities[n], data.loads.axes, data.now[0].dim
    for i in range(data.followers.size):
        follower = data.followers[i]
        displacement = 0.0
        velocity = 0.0
        acceleration = 0.0
        for d in range(dim):
            dof = data.boundary[follower.place + d].dof
            displacement += axes[follower.axis + d] * u[dof]
            velocity += axes[follower.axis + d] * v[dof]
            acceleration += axes[follower.axis + d] * a[dof]
        follower.displacement = displacement
        follower.velocity = velocity
        follower.response = 0.0
        if ahead > 0.0:
            follower.velocity += ahead * acceleration
            follower.response = ahead * follower.inverse_mass
        follower.share = data.loads.amplitudes[follower.column]


def push_in_stage(data: Following, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the accelerations by the forces; the amplitude of a load becomes its force."""
    axes, dim = data.loads.axes, data.now[0].dim
    for i in range(data.followers.size):
        follower = data.followers[i]
        data.loads.amplitudes[follower.column] = follower.force
        for d in range(dim):
            dof = data.boundary[follower.place + d].dof
            a[dof] += follower.inverse_mass * follower.force * axes[follower.axis + d]


# ------------------------------------------------------------------------------------------------------------- forces


def find_force(load: FollowingLoad, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set the force of one load, for the motion in its record."""
    follower = load.followers[0]
    clock = min(max(load.now[0].time, follower.start), follower.stop) - follower.start
    follower.force = force_of(load.numbers, clock, follower)


def residual(numbers: object, clock: float, follower: Row, force: float) -> float:
    """Return the force of the kernel at the velocity that `force` causes, minus `force`."""
    velocity = follower.velocity + follower.response * force
    wanted: float = follower.share * follow(numbers, clock, follower.displacement, velocity) - force
    return wanted


def force_of(numbers: object, clock: float, follower: Row) -> float:
    """Return the force that is that of the kernel at the velocity that the force itself causes; nan if none is found.

    A force that does not grow with the velocity lies between zero and that of the velocity without it, so that
    bisection finds it. Where it jumps, as friction does at rest, the result is the force between both sides of the
    jump that keeps the velocity there.
    """
    low, at_low = 0.0, residual(numbers, clock, follower, 0.0)
    if follower.response == 0.0 or at_low == 0.0:
        return at_low
    scale = abs(at_low)
    high, at_high = at_low, residual(numbers, clock, follower, at_low)
    for _ in range(DOUBLINGS):
        if at_low * at_high <= 0.0:
            break
        low, at_low, high = high, at_high, 2.0 * high
        at_high = residual(numbers, clock, follower, high)
    if not at_low * at_high <= 0.0:
        return np.nan
    for k in range(HALVINGS):
        if abs(at_high) <= ROUND_OFF * (scale + abs(high)) or abs(high - low) <= ROUND_OFF * (abs(low) + abs(high)):
            return high
        # The secant is exact for a linear kernel; every third time the bracket is halved.
        force = 0.5 * (low + high) if k % 3 == 2 else high - at_high * (high - low) / (at_high - at_low)
        at_force = residual(numbers, clock, follower, force)
        if at_low * at_force > 0.0:
            low, at_low = high, at_high
        high, at_high = force, at_force
    return high
