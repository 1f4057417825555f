"""What is to know of an implicit scheme (`percuss.march.implicit`), and what does not go with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from percuss.contact.features import Feature
from percuss.errors import Problem, RefusedPair
from percuss.methods.interfaces import Implicit
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from percuss.contact.features import Verdict
    from percuss.contact.model_arrays import ModelArrays
    from percuss.methods.interfaces import LinearLaw


@dataclass(frozen=True, kw_only=True)
class ImplicitSteps(Feature):
    """The facts about an implicit scheme, and the scheme itself."""

    scheme: Implicit


def feature(model: ModelArrays) -> ImplicitSteps | None:
    """Return what is to know of an implicit scheme; None of an explicit one."""
    name, scheme = model.case.method.integrator.name, answer(model.case.method.integrator, "bind", model.dt)
    if not isinstance(scheme, Implicit):
        return None
    return ImplicitSteps(
        name="implicit scheme",
        scheme=scheme,
        goes_without={"coupled masses": "an implicit scheme"},
        no_row_kernel=True,
        built_for_bars=True,
        keeps_constraints=True,
        solves_contact="solved at the end of the step with N^T K_eff^-1 N of the whole bodies, which adds to sigma",
        not_compiled=f"{name} is an implicit reference in NumPy and SciPy",
        sums_internal_work=True,
        dissipates=True,
        not_guaranteed=(
            "a multiplier solved for at the end of a step gives and takes energy as its contact closes or opens"
        ),
        of_all_laws=True,
        no_springs=f"{name} solves for its contacts at the end of a step, together with the bodies",
        unlike_plain_bars=f"{name} is implicit",
        no_critical_step=f"{name} is implicit: it has no critical step",
        no_choice_of_step=("an explicit integrator, found", f"the implicit {name}", "No step is critical: give one."),
        verdict=partial(_verdict, model, scheme),
        explained=scheme.in_words,
    )


def _verdict(model: ModelArrays, scheme: Implicit) -> tuple[Verdict, str]:
    """Return the stability of any step, and the reason for it, from what is known of Newmark's family.

    Without contact it is unconditionally stable for ``gamma = 1/2 - alpha``, ``beta >= (1 - alpha)^2 / 4`` and alpha
    from -1/3 to 0. For alpha = 0 a closed contact with a compliance adds to the stiffness, and a tie of rates takes
    motions away: both leave the step stable. A contact with a compliance may open and close, though, and by that add
    energy again and again. A gap that is held closed without a compliance has no velocity in the mean, but its velocity
    changes its sign in every step and the multiplier grows with each, without bound.
    """
    beta, gamma, alpha = scheme
    tolerance = 1e-12
    known = abs(gamma - (0.5 - alpha)) <= tolerance and beta >= (1.0 - alpha) ** 2 / 4.0 - tolerance
    if not known or alpha < -1.0 / 3.0 - tolerance:
        return "unknown", f"with beta {beta:.6g}, gamma {gamma:.6g} and alpha {alpha:.6g} nothing is known of its steps"
    without_contact = "without contact every step is stable"
    if not model.contact_points:
        return "yes", without_contact
    if alpha < 0.0:
        name = model.case.method.integrator.name
        return (
            "unknown",
            f"{without_contact}; {name} lags internal forces and not those of contact, which is not examined",
        )
    for bound in model.laws:
        if bound.linear is not None and np.any(bound.linear.gap) and not np.all(bound.linear.sigma):
            return "unknown", (
                f"{without_contact}; held closed by {bound.law.name}, a gap turns its velocity around in every step, "
                "and its multiplier grows in proportion to their number: a compliance or alpha below 0 prevents that"
            )
    return "yes", (
        "every step is stable, as a closed contact adds to the stiffness; those that open and close may add energy "
        "again and again"
    )


def refusals(model: ModelArrays) -> Iterator[Problem | RefusedPair]:
    """Yield bodies, loads and laws that an implicit scheme does not know.

    These are bodies that are not linear, ends without mass, loads that prescribe or follow a motion, and laws that are
    no line in the gap, and no tie of rates.
    """
    if not any(isinstance(feature, ImplicitSteps) for feature in model.features):
        return
    case, name = model.case, model.case.method.integrator.name
    if model.bodies.why_not_linear:
        message = f"expected linear bodies with the implicit {name}, found that {model.bodies.why_not_linear}"
        yield case.problem(("method", "integrator"), message, "Take an explicit integrator.")
    moving = [constraint.load for constraint in model.loads.constraints if constraint.load is not None]
    for load in (*moving, *(force.load for force in model.facts.forces)):
        message = f"expected supports and forces with the implicit {name}, found a load that says how an end moves"
        yield case.problem(("loads", load.name), message, "Take an explicit integrator.")
    for bound_law in model.laws:
        reason = _why_not_solved(bound_law.linear)
        if model.balanced[list(bound_law.where)].any():
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
