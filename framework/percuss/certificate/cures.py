"""Cures of an unstable step: the cheapest changes of the case, with their numbers."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.certificate.criteria import RunCriterion, operator_criterion
from percuss.certificate.search import largest_step

if TYPE_CHECKING:
    from percuss.march.model import Model

# Relative tolerance of the option that is named as a cure, far below the digits that are printed.
CURE_TOLERANCE = 1e-10


def no_step(model: Model, free: float, critical: float, *, searched: bool = True) -> str:
    """Return the cure where no step is known to be stable.

    It is another integrator if that holds without contact, a shorter step if the critical one is not known (nan), as it
    was searched in vain or not at all, else another law.
    """
    name = model.case.method.integrator.name
    if free == 0.0:
        return f"take another integrator: {name} is unstable at any step, without contact too"
    if not searched:
        return "lower the step: `percuss check` searches how far"
    if np.isnan(critical):
        return "lower the step; how far is not known, as its critical value was not found"
    return "take another law: with this one no step is stable"


def cure_of(criterion: RunCriterion, critical: float, *, searched: bool = True) -> str:
    """Return the cheapest cures of an unstable step, with their numbers."""
    model = criterion.model
    cures = []
    if critical > 0:
        courant = round_down(0.5 * critical * model.bodies.omega)
        cures.append(f"lower the step to {round_down(critical)} (Courant number {courant})")
    for law in (bound_law.law for bound_law in model.laws):
        for option in law.stiffening:
            value = getattr(law, option, None)
            if isinstance(value, float) and criterion.kind is operator_criterion:
                limit = largest_stable_value(criterion, law, option, value)
                if limit is not None:
                    cures.append(f"set {option} of {law.name} to at most {round_down(limit)}")
    if np.isnan(critical) and model.why("cure"):
        cures.append(model.why("cure"))
    elif np.isnan(critical) or not cures:
        cures.append(no_step(model, criterion.free, critical, searched=searched))
    return ", or ".join(cures)


def capitalised(sentence: str) -> str:
    """Return a sentence with a capital first letter."""
    return sentence[:1].upper() + sentence[1:]


def round_down(value: float) -> str:
    """Return a number in six digits, rounded down, so that the step or option named as a cure is really stable."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 5)
    return f"{np.floor(value * (1.0 - 1e-9) / digit) * digit:.6g}"


def largest_stable_value(criterion: RunCriterion, law: Any, option: str, value: float) -> float | None:
    """Return the largest value of a law's option, below its present `value`, with which the step is stable.

    None if the step is unstable with a thousand-millionth of the present value, too.
    """
    model = criterion.model

    def excess(candidate: float) -> float:
        changed = model.with_laws({law: dataclasses.replace(law, **{option: candidate})})
        return -1.0 if RunCriterion(changed, operator_criterion).assess_step(model.dt).stable else 1.0

    if excess(value * 1e-9) > 0.0:
        return None
    return min(value, largest_step(excess, value, CURE_TOLERANCE))
