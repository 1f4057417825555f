"""Functions that kernels may call: slots, which the solver fills, and what contacts at the same end do to a gap.

A slot is a function without a body of its own; the compiler of the solver binds it to the kernel that a method brings.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Trial


def coupled_push(trial: Trial, multiplier: Floats, p: int) -> float:
    """Return the gap acceleration of point p that all contacts at its ends bring, its own included.

    It is ``sum over q of S_pq lambda_q``, with the `multiplier` of the law's own points as they are at the moment, and
    those of other laws as they were last found in this step.
    """
    push = trial.delassus[p] * multiplier[p] + trial.pushed_by_others[p]
    for k in range(trial.first_neighbour[p], trial.first_neighbour[p + 1]):
        push += trial.coupling[k] * multiplier[trial.neighbour[k]]
    return push  # type: ignore[no-any-return]


def coupled_gap(trial: Trial, multiplier: Floats, p: int) -> float:
    """Return the predicted gap of point p with what all contacts at its ends press."""
    return trial.predicted_gap[p] + trial.gap_response * coupled_push(trial, multiplier, p)  # type: ignore[no-any-return]


def coupled_rate(trial: Trial, multiplier: Floats, p: int) -> float:
    """Return the predicted gap rate of point p with what all contacts at its ends press."""
    return trial.predicted_rate[p] + trial.rate_response * coupled_push(trial, multiplier, p)  # type: ignore[no-any-return]


def unbound() -> NoReturn:
    """Raise, as the body of a slot."""
    raise NotImplementedError("a slot is called before a kernel is bound to it")


def stress(parameters: Floats, strain: float) -> float:
    """Slot: the stress at `strain`; bound to the body's material."""
    unbound()


def energy_density(parameters: Floats, before: float, after: float) -> float:
    """Slot: the staggered strain-energy density; bound to the body's material."""
    unbound()


def accelerations(system: Any, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Slot: set `a` to the accelerations in a stage of the step; the compiled loop fills it."""
    unbound()


def internal_force(
    element: Any,
    parameters: Floats,
    first: int,
    dim: int,
    displacement: Floats,
    force: Floats,
) -> None:
    """Slot: set `force` to the internal force of a run of elements; bound to the body's element."""
    unbound()


def energy(
    element: Any,
    parameters: Floats,
    first: int,
    dim: int,
    displacement: Floats,
    velocity: Floats,
    dt: float,
) -> float:
    """Slot: the staggered strain energy of a run of elements; bound to the body's element."""
    unbound()


# a sum over elements: its terms may be added in any order
energy.reduction = True  # type: ignore[attr-defined]
