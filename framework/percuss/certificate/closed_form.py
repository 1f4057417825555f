"""Critical steps of uniform bars in closed form, without a mesh or a matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.certificate.closed_contacts import closed_contacts
from percuss.certificate.lines import held_throughout
from percuss.certificate.search import largest_step_below, signed_distance

if TYPE_CHECKING:
    from percuss.contact.contact_point import ContactPoint
    from percuss.march.model import Model


class NoClosedFormError(Exception):
    """Error for a case without a known closed form; its message gives the reason."""


def unlike_plain_bars(model: Model) -> str:
    """Return what sets a model apart from linear bars of two-node elements under a leap-frog scheme, or nothing."""
    scheme = f"{model.case.method.integrator.name} is no leap-frog scheme" if model.multistage else ""
    cells = (
        f"the cells of body '{body.name}' are of the kind {kind}"
        for body in model.bodies.values()
        for kind in (body.mesh.cells if body.of_cells else ())
    )
    return model.bodies.why_not_linear or scheme or model.why("plain bars") or next(cells, "")


def end_elements(model: Model, contact_point: ContactPoint) -> list[tuple[float, float]]:
    """Return EA/h and 2c/h of the end element of each side of a contact."""
    ends = [(model.bodies.bar_at(node), model.bodies.bar_at(node).end_element(node)) for node in contact_point.nodes]
    return [(float(body.stiffness[i]), float(body.frequency[i])) for body, i in ends]


def _stiffness_of_long_bar(end_stiffness: float, courant: float) -> float:
    """Return the stiffness with which a harmonic that decays into an infinitely long bar holds its end."""
    return float(end_stiffness * 2.0 / courant * np.sqrt(max(1.0 / courant**2 - 1.0, 0.0)))


def step_of_long_bars(model: Model) -> float:
    """Return the critical step of uniform bars, which are taken as infinitely long: no mesh, no matrix.

    It is 2/omega where contact does not lower it. A harmonic that decays into an infinitely long bar of elements h
    holds its end with the stiffness ``(EA/h)(2/C) sqrt(1/C^2 - 1)`` at the step dt = C h/c. Central difference is
    stable as long as the stiffness of both ends in series is at least ``eps_s - 4 eps_m / dt^2``; on a rigid wall this
    gives ``C = sqrt(2 / (1 + sqrt(1 + beta_s^2)))`` for the penalty method. Wu's predictor-corrector is stable for
    ``theta <= 1``.

    Raises
    ------
    NoClosedFormError
        If a body is not linear or a bar not uniform, the mass couples nodes, the integrator is a multi-stage scheme or
        viscous, or an end in contact is fixed, driven or in several contacts.
    """
    if why := unlike_plain_bars(model) or model.why("closed form"):
        raise NoClosedFormError(why)
    for body in model.bodies.values():
        if np.ptp(body.mesh.lengths) > 1e-9 * body.mesh.lengths.mean():
            raise NoClosedFormError(f"the elements of body '{body.name}' are unequal")
    nodes = [node for contact_point in model.contact_points for node in contact_point.nodes]
    if len(set(nodes)) < len(nodes):
        raise NoClosedFormError("an end is in several contacts")
    if {constraint.node for constraint in held_throughout(model)} & set(nodes):
        raise NoClosedFormError("an end in contact is fixed or driven")
    if doubts := closed_contacts(model, model.dt).doubts:
        raise NoClosedFormError("; ".join(doubts))
    free = 2.0 / model.bodies.omega
    ends = [end_elements(model, contact_point) for contact_point in model.contact_points]

    def excess(dt: float) -> float:
        if dt > free:
            return 1.0
        laws, shares = closed_contacts(model, dt), [0.0]  # of what would make a contact unstable
        for p, sides in enumerate(ends):
            stiffness = laws.stiffness[p] - 4.0 * laws.inertia[p] / dt**2
            if laws.predicted[p]:
                # The entry s of the contact in S is the sum of 1/m over its sides, with m = 2 (EA/h) / omega^2.
                s = sum(frequency**2 / (2.0 * end_stiffness) for end_stiffness, frequency in sides)
                shares.append(dt**2 * laws.stiffness[p] * s / (1.0 + laws.inertia[p] * s))
            elif stiffness > 0:
                held = [_stiffness_of_long_bar(one, 0.5 * dt * frequency) for one, frequency in sides]
                shares.append(sum(stiffness / k if k > 0 else np.inf for k in held))
        return signed_distance(*shares)

    return largest_step_below(excess, free)
