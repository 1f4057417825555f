"""Models whose contact points find in each step what they meet: what is known of their steps, and what is refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.sliding import renews, slides, sliding
from percuss.contact.walls import round_or_moving
from percuss.errors import Problem
from percuss.mesh.loads import directions_at_nodes

if TYPE_CHECKING:
    from percuss.case.specs import ContactSpec
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats


def with_rows_that_stay(model: Model) -> Model:
    """Return a model whose points keep the rows of the start."""
    points = model.contact_points
    points = dataclasses.replace(points, slides=np.zeros_like(points.slides))
    features = tuple(one for one in model.features if one.held is None)
    return dataclasses.replace(model, contact_points=points, features=features)


def complementary(model: Model) -> bool:
    """Return whether the law of each point that slides is a complementarity problem at the end of the step."""
    names, slide = model.contact_points.names, sliding(model.case)
    of_points = [one.linear for one in model.laws if any(names[p] in slide for p in one.where)]
    predicted = model.tables[-1].explicit.gap == "predicted"
    return all(
        one is not None and one.active == "all" and one.sign == ">= 0" and (one.at == "end" or predicted)
        for one in of_points
    )


def stiffness_of_points(model: Model) -> Floats:
    """Return the stiffness of each closed point under a law at the current or predicted gap, (P,); 0 under others."""
    found = np.zeros(len(model.contact_points))
    for one in model.laws:
        if one.linear is not None and one.linear.active != "all" and one.linear.at != "end":
            found[list(one.where)] = 1.0 / one.linear.sigma
    return found


def of_every_step(model: Model) -> str:
    """Return in words what is known of each step by itself, wherever the surfaces are."""
    points = model.contact_points
    if any(one.linear is None and points.slides[list(one.where)].any() for one in model.laws):
        return "of a law with a kernel no bound at every position is known"
    per_area = stiffness_of_points(model) / points.weight
    bound = sum(model.largest_response(name) * per_area[points.of_contact(name)].max() for name in sliding(model.case))
    if bound == 0.0:
        return "each step by itself is as stable at every position as its bodies are without contact"
    share = share_of_limit(model, bound)
    if share is None:
        return "of a law with inertia no bound at every position is known"
    shown = "each step by itself is stable" if share <= 1.0 else "no step by itself is shown to be stable"
    renewed = any(renews(spec, model.dim) for spec in sliding(model.case).values())
    covered = " at which facets are covered as a whole" if renewed else ""
    return f"{shown} at every position{covered}: its bound is {share:.4g} of what the step allows"


def share_of_limit(model: Model, bound: float) -> float | None:
    """Return a bound of what closed contacts add to a squared frequency, over what the step allows.

    That is ``theta = dt^2 b / (1 + tau b)`` of laws at the predicted gap, ``(omega^2 + b) dt^2 / 4`` of laws without
    inertia at the current one, omega the highest frequency of the cells; None where none is known, or none adds any.
    """
    moves = model.contact_points.slides
    linear = [one.linear for one in model.laws if one.linear is not None and moves[list(one.where)].any()]
    inertia = max((float(np.max(one.acceleration)) for one in linear), default=0.0)
    if bound == 0.0:
        return None
    if model.tables[-1].explicit.gap == "predicted":
        return model.dt**2 * bound / (1.0 + inertia * bound)
    return None if inertia > 0.0 else 0.25 * model.dt**2 * (model.bodies.omega**2 + bound)


def mobilities(model: Model, place: Mapping[int, int], midpoint: float) -> Floats:
    """Return M^-1 of each of some nodes, and zeros of each wall that is round or moves, (n, dim, dim).

    No node moves in a direction in which a constraint holds it.

    Parameters
    ----------
    model
        The model.
    place
        The nodes, in their order.
    midpoint
        Time at which the constraints act.
    """
    nodes = list(place)
    acting = (model.loads.constraints[k] for k in model.active_constraints(midpoint))
    mass = (model.bodies.mass * model.slowing)[nodes][:, None, None]
    found: Floats = np.eye(model.dim) * np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0.0)
    number = {node: k for k, node in enumerate(nodes)}
    for node, directions in directions_at_nodes(acting).items():
        for direction in directions:
            found[number[node]] -= np.outer(direction, direction @ found[number[node]])
    return np.concatenate([found, np.zeros((len(round_or_moving(model.case)), model.dim, model.dim))])


def refusals(model: Model) -> Iterator[Problem]:
    """Yield what does not go with surfaces that slide far."""
    case = model.case
    for name, spec in case.contacts.items():
        path = ("contacts", name)
        if (slides(spec) or spec.sliding == "large") and (found := _why_small(model, spec)):
            message, advice = found
            yield case.problem((*path, "sliding" if spec.wall is None else "wall"), message, advice)
        if spec.overlap != "refuse" and not slides(spec):
            message = f"expected an overlap of surfaces that slide, found overlap: {spec.overlap} with rows that stay"
            advice = "Add `sliding: large`, or move the bodies apart." if spec.wall is None else "Move it off the wall."
            yield case.problem((*path, "overlap"), message, advice)


def _why_small(model: Model, spec: ContactSpec) -> tuple[str, str] | None:
    """Return why the surfaces of a contact cannot slide far, and what to do; None if they can."""
    if not slides(spec):
        return None
    bodies = [model.bodies[side.body] for side in spec.sides]
    own = model.contact_points.of_contact(spec.name)
    pairing: Any = spec.pairing
    found = (
        (
            len(bodies) > 1 and bodies[0] is bodies[1],
            "two bodies, found one that meets itself",
            "Such a contact is not built.",
        ),
        (
            len(bodies) > 1 and any(body.view.plane == "axisymmetric" for body in bodies),
            "bodies in the plane or in space, found bodies of revolution",
            "Take `sliding: small`.",
        ),
        (
            model.multistage,
            f"a leap-frog scheme, found {model.case.method.integrator.name}",
            "Take central-difference, or `sliding: small`." if spec.wall is None else "Take central-difference.",
        ),
        (model.bodies.couples_nodes, "a mass of each node, found one that couples nodes", "Take the lumped mass."),
        (
            any(one.bonds for one in model.laws if own[list(one.where)].any()),
            f"a law that lets bodies part, found {spec.law.name}",
            "A bond does not slide: drop `sliding`." if spec.wall is None else "Take a plane at rest.",
        ),
        (
            renews(spec, model.dim) and any(one.linear is None for one in model.laws if own[list(one.where)].any()),
            f"a linear law with {pairing.name}, whose areas change from step to step, found {spec.law.name}",
            "Take node-to-segment or gauss-points.",
        ),
    )
    return next(((f"expected {words}", advice) for holds, words, advice in found if holds), None)
