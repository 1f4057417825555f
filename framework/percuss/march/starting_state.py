"""The starting state of a run: velocities at t = 0, and half a step before for leap-frog schemes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.mesh.loads import amplitude

if TYPE_CHECKING:
    from percuss.case.specs import LoadSpec
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats


def initial_velocity(model: Model) -> Floats:
    """Return the velocity at t = 0, (nodes, dim): that of the bodies, subject to the active supports and drives."""
    velocity = np.empty((model.bodies.n_nodes, model.dim))
    for body in model.bodies.values():
        velocity[body.start : body.stop] = body.nodal_velocity
    _impose_velocities(model, velocity, 0.0)
    return velocity


def starting_velocity(model: Model) -> Floats:
    """Return v_{-1/2} = v_0 - dt/2 M^-1 f_ext(0), (nodes, dim), without contact forces; f_ext has those of damping.

    With this starting velocity the scheme is of second order.
    """
    velocity = initial_velocity(model)
    velocity *= model.slowing[:, None]
    before = velocity.copy()
    for force in model.loads.on_nodes:
        impulse = force.impulse_at_start(_impulse_before_start(force.load, model.dt), velocity[force.node])
        velocity[force.node] -= model.bodies.change_of_velocity(impulse, force.node)
    bodies = list(model.bodies.values())
    for body_force in model.loads.body_forces:
        body = bodies[body_force.body]
        duration = model.dt * model.leaps[body.number]
        fall = _impulse_before_start(body_force.load, duration) * body_force.acceleration
        velocity[body.start : body.stop] -= fall
        before[body.start : body.stop] -= fall
    _impose_velocities(model, velocity, -0.5 * model.dt)
    _carry_to_neighbours(model, velocity, before)
    return velocity


def _carry_to_neighbours(model: Model, velocity: Floats, before: Floats) -> None:
    """Change the velocities beside the ends on which loads, supports and drives act, as `before` has become theirs."""
    for end in dict.fromkeys(model.loads.acted_nodes):
        response = model.bodies.at(end).response(end)
        for node, value in response.items():
            if node != end:
                velocity[node] += value / response[end] * (velocity[end] - before[end])


def _impose_velocities(model: Model, velocity: Floats, time: float) -> None:
    """Set the velocities of the supports and drives that are active in the first step.

    A prescribed velocity is extrapolated linearly to a `time` before t = 0.
    """
    for constraint in model.loads.constraints:
        if constraint.active(0.5 * model.dt):
            prescribed = 0.0
            if constraint.load is not None:
                times = np.array([0.0, 0.5 * model.dt])
                at_start, at_midpoint = amplitude(constraint.load, times, model.dt, average=False)
                prescribed = at_start + (at_midpoint - at_start) * time / (0.5 * model.dt)
            velocity[constraint.node] += (
                prescribed - velocity[constraint.node] @ constraint.direction
            ) * constraint.direction


def _impulse_before_start(spec: LoadSpec, dt: float) -> float:
    """Return the amplitude of a load at t = 0 times its duration within [-dt/2, 0].

    The force of the first step acts over that half step too, so that the starting velocity has to compensate it.
    """
    if spec.start > 0:
        return 0.0
    value = float(amplitude(spec, np.zeros(1), dt, average=False)[0])
    return value * min(max(0.5 * dt + min(spec.stop, 0.0), 0.0), 0.5 * dt)
