"""Checks of bodies, loads and contact laws with an implicit scheme (`percuss.march.implicit`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from percuss.errors import Problem, RefusedPair

if TYPE_CHECKING:
    from percuss.contact.model_arrays import ModelArrays
    from percuss.methods.interfaces import LinearLaw


def refusals(model: ModelArrays) -> Iterator[Problem | RefusedPair]:
    """Yield bodies, loads and laws that an implicit scheme does not know.

    These are bodies that are not linear, ends without mass, loads that prescribe or follow a motion, and laws that are
    no line in the gap, and no tie of rates.
    """
    if not model.implicit:
        return
    case, name = model.case, model.case.method.integrator.name
    if model.why_not_linear:
        message = f"expected linear bodies with the implicit {name}, found that {model.why_not_linear}"
        yield case.problem(("method", "integrator"), message, "Take an explicit integrator.")
    moving = [constraint.load for constraint in model.constraints if constraint.load is not None]
    for load in (*moving, *(follower.load for follower in model.followers)):
        message = f"expected supports and forces with the implicit {name}, found a load that says how an end moves"
        yield case.problem(("loads", load.name), message, "Take an explicit integrator.")
    for bound_law in model.laws:
        reason = _why_not_solved(bound_law.linear)
        if model.points_without_mass[list(bound_law.where)].any():
            reason = "ends without mass are balanced with their contact explicitly"
        if reason:
            sentence = f"{name} solves for contact at the end of a step: {reason}"
            yield RefusedPair(name, bound_law.law.name, sentence, name)


def _why_not_solved(linear: LinearLaw | None) -> str:
    """Return why the law of a contact is not solved for at the end of an implicit step; empty if it is."""
    if linear is None:
        return "the law has a kernel, which takes the state as given"
    if np.any(linear.acceleration):
        return "the law weighs the gap acceleration"
    if np.any(linear.rate) and (np.any(linear.gap) or np.any(linear.sigma) or linear.sign != "free"):
        return "the law weighs the gap rate"
    if not np.all(np.asarray(linear.gap) + np.asarray(linear.rate) > 0.0):
        return "the law does not weigh the gap"
    if linear.at == "end" and linear.active != "all":
        return "the law acts where a gap that is predicted without it is closed, and no gap is predicted so"
    return ""
