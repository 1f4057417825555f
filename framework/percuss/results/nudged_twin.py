"""The nudged twin of a run, which shows whether its answer depends on round-off."""

from __future__ import annotations

import numpy as np

from percuss.case.case import Case
from percuss.methods.interfaces import Floats
from percuss.results.result import Result

NUDGE_OF_AREA = 1e-12  # relative
FRAGILE_DIFFERENCE = 1e-4  # relative, in L2


def nudged(case: Case, courant: float) -> Case:
    """Return the case with the area of its first body increased by `NUDGE_OF_AREA`, at the same Courant number."""
    name, body = next(iter(case.bodies.items()))
    fixed_courant = {"time.courant": courant} if case.time.courant == "auto" else {}
    return case.with_overrides({f"bodies.{name}.area": body.area * (1.0 + NUDGE_OF_AREA), **fixed_courant})


def is_fragile(result: Result, twin: Result) -> bool:
    """Return whether a run and its nudged twin differ: in their contact forces, or in displacements without contact."""
    compared = "contact_force" if result.arrays["contact_force"].size else "displacement"
    return differs(result.arrays[compared], twin.arrays[compared])


def differs(values: Floats, twin_values: Floats) -> bool:
    """Return whether histories differ by more than `FRAGILE_DIFFERENCE` in L2."""
    size = float(np.linalg.norm(values))
    return bool(values.shape != twin_values.shape or np.linalg.norm(values - twin_values) > FRAGILE_DIFFERENCE * size)
