"""What cures a step that is not stable: the cheapest changes of the case, with their numbers."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from percuss.certificate.criteria import PencilCriterion, RunCriterion
from percuss.solver.model import Model


def no_step(model: Model, free: float) -> str:
    """Return the cure where no step is stable: of the integrator, if it is unstable without contact too."""
    name = model.case.method.integrator.name
    if free == 0.0:
        return f"take another integrator: {name} is unstable at any step, without contact too"
    return "take another law: with this one no step is stable"


def cure_of(judge: RunCriterion, critical: float) -> str:
    """Return the cheapest cures of an unstable step, with their numbers."""
    model = judge.model
    cures = []
    if critical > 0:
        cures.append(f"lower the step to {down(critical)} (Courant number {down(0.5 * critical * model.omega)})")
    for entry in model.laws:
        law = entry["law"]
        for option in law.stiffening:
            value = getattr(law, option, None)
            if isinstance(value, float) and judge.by == PencilCriterion.by:
                found = option_at_most(judge, law, option, value)
                if found is not None:
                    cures.append(f"set {option} of {law.name} to at most {down(found)}")
    return ", or ".join(cures) or no_step(model, judge.free)


def capital(sentence: str) -> str:
    """Return a sentence that begins with a capital letter."""
    return sentence[:1].upper() + sentence[1:]


def down(value: float) -> str:
    """Return a number in six digits, rounded down: what is told as a cure must be one."""
    digit = 10.0 ** (np.floor(np.log10(value)) - 5)
    return f"{np.floor(value * (1.0 - 1e-9) / digit) * digit:.6g}"


def option_at_most(judge: RunCriterion, law: Any, option: str, value: float) -> float | None:
    """Return the largest value of a law's option below the present one with which the step is stable."""
    models = [stretch.model for stretch in judge.stretches]
    kept = [model.laws for model in models]

    def holds(candidate: float) -> bool:
        other = dataclasses.replace(law, **{option: candidate})
        for model, laws in zip(models, kept, strict=True):
            model.laws = [{**entry, "law": other} if entry["law"] is law else entry for entry in laws]
        try:
            return judge.judge(judge.model.dt).stable
        finally:
            for model, laws in zip(models, kept, strict=True):
                model.laws = laws

    if not holds(value * 1e-9):
        return None
    lo, hi = value * 1e-9, value
    for _ in range(60):
        middle = float(np.sqrt(lo * hi))
        lo, hi = (middle, hi) if holds(middle) else (lo, middle)
    return lo
