"""What does not work together in a case: one table of rules, all of which are told at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from percuss.errors import InputError, Problem, RefusedPair
from percuss.march import parts

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.model import Model

Rule = Callable[["Model"], Iterator[Problem | RefusedPair]]


def pairs_refused(model: Model) -> Iterator[RefusedPair]:
    """Yield each pair of the integrator and a law of which one refuses the other."""
    integrator = model.case.method.integrator
    for law in dict.fromkeys(model.contact_points.laws):
        for reason, refusing in (
            (integrator.refuses(law), integrator.name),
            (law.refuses(integrator), law.name),
        ):
            if reason:
                yield RefusedPair(integrator.name, law.name, reason, refusing)


def not_movable(model: Model) -> Iterator[Problem]:
    """Yield each contact whose sides are all fixed or driven at some time: its force is unknown."""
    told, points = set(), model.contact_points
    lightest = np.full(len(points), np.inf)
    np.minimum.at(lightest, points.point, model.bodies.mass[points.node])
    for start, stop in model.segments(laws=False):
        delassus = model.rows_at((start + 0.5) * model.dt).delassus
        for p in np.flatnonzero((lightest > 0.0) & (delassus * lightest < 1e-12)):
            if (name := points.names[p]) not in told:
                message = "expected a contact that can move, found every side fixed or driven"
                advice = "Free one of the ends, or drop the contact."
                if start > 0 or stop < model.steps:
                    message += f" from {start * model.dt:.6g} to {min(stop, model.steps) * model.dt:.6g}"
                    advice = "Drive one of its ends at a time: without a free end its force is unknown."
                told.add(name)
                yield model.case.problem(("contacts", name), message, advice)


def _is_rigid_early(bound_law: BoundLaw) -> bool:
    """Return whether a law without compliance is evaluated before the end of the step."""
    linear = bound_law.linear
    return linear is not None and linear.at == "explicit" and not np.all(linear.sigma)


def only_with_bars(model: Model) -> Iterator[Problem]:
    """Yield what is built for bars alone, where a body is none."""
    other = next((body.name for body in model.bodies.values() if body.mesh.line is None), "")
    if not other:
        return
    case, method = model.case, model.case.method
    bars = [body.name for body in model.bodies.values() if body.mesh.line is not None]
    about = [body.spec.plane == "axisymmetric" for body in model.bodies.values()]
    if any(about) and not all(about):
        turning, flat = list(model.bodies)[about.index(True)], list(model.bodies)[about.index(False)]
        message = f"expected only bodies of revolution or none, found '{turning}' beside '{flat}'"
        yield case.problem(("bodies", turning, "plane"), message, "Give all bodies the plane axisymmetric.")
    if bars:
        message = f"expected only bars or none, found the bar '{bars[0]}' beside '{other}'"
        yield case.problem(("bodies", bars[0]), message, "Bars and other bodies in one case are not built.")
    if model.facts.built_for_bars:
        message = f"expected another integrator for '{other}', which is no bar, found {method.integrator.name}"
        yield case.problem(("method", "integrator"), message, "It works for bars only: take central-difference.")
    for bound_law in model.laws:
        reason = (
            "its kernel uses the coupling of contacts" if bound_law.linear is None and bound_law.law.uses_coupling else
            "it has no compliance and is not evaluated at the end of the step" if _is_rigid_early(bound_law) else ""
        )  # fmt: skip
        if reason:
            message = f"expected another law for '{other}', which is no bar, found {bound_law.law.name}"
            advice = f"{reason[0].upper()}{reason[1:]}, which works for bars only."
            yield case.problem(("method", "contact"), message, advice)
        rigid = bound_law.linear is not None and not np.all(bound_law.linear.sigma)
        for name in dict.fromkeys(bound_law.points.names) if rigid else ():
            pairing = case.contacts[name].pairing
            if pairing is not None and pairing.more_points_than_nodes:
                message = f"expected a law with a compliance on {pairing.name}, found {bound_law.law.name}"
                advice = "It makes more points than nodes, so that single forces have no meaning: take mortar."
                yield case.problem(("contacts", name), message, advice)


def steps_unknown(model: Model) -> Iterator[Problem]:
    """Yield each material that needs the time step where stages have times of their own."""
    for body in model.bodies.values():
        if model.multistage and getattr(body.spec.material, "needs_step", False):
            found = f"found {model.case.method.integrator.name}"
            message = f"expected a leap-frog scheme with {body.spec.material.name}, which needs the time step, {found}"
            yield model.case.problem(("method", "integrator"), message, "Take central-difference.")


# The rules that need no bound laws, and those that do.
BEFORE_LAWS: Sequence[Rule] = (
    pairs_refused,
    steps_unknown,
    *parts.BEFORE_LAWS,
    not_movable,
)
WITH_LAWS: Sequence[Rule] = (
    only_with_bars,
    *parts.WITH_LAWS,
)


def refuse(model: Model, rules: Sequence[Rule]) -> None:
    """Refuse what some rules refuse in a model, all of it at once.

    Raises
    ------
    RefusedPair
        If the first refusal is that of an integrator and a law; with the places of all problems.
    InputError
        If it is another one.
    """
    found = [refusal for rule in rules for refusal in rule(model)]
    if not found:
        return
    problems = [problem for refusal in found for problem in _problems(model, refusal)]
    first = found[0]
    if isinstance(first, RefusedPair):
        raise RefusedPair(first.integrator, first.contact, first.reason, first.said_by, dict.fromkeys(problems))
    raise InputError(dict.fromkeys(problems))


def _problems(model: Model, refusal: Problem | RefusedPair) -> list[Problem]:
    """Return the problems of a refusal; of an integrator and a law the places of both."""
    if isinstance(refusal, Problem):
        return [refusal]
    points = zip(model.contact_points.names, model.contact_points.laws, strict=True)
    contact = next((name for name, law in points if law.name == refusal.contact), "")
    own, origin = ("contacts", contact, "method"), model.case.origin
    paths = (("method", "integrator"), own if origin.get(own) is not None else ("method", "contact"))
    messages = (refusal.sentence, f"{refusal.contact}, the contact law of that pair")
    return [
        model.case.problem((*path, "name") if origin.get((*path, "name")) is not None else path, message)
        for path, message in zip(paths, messages, strict=True)
    ]
