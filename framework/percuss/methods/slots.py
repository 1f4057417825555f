"""Functions that kernels may call: slots, which the solver fills, and gaps coupled by contacts at the same end.

A slot is a function without a body of its own; the compiler of the solver replaces it by the kernel of a method.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

from percuss.jit import apart, merged, reduction

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Trial


def coupled_push(trial: Trial, multiplier: Floats, p: int) -> float:
    """Return the gap acceleration of point p that all contacts at its ends cause, its own included.

    It is ``sum over q of S_pq lambda_q`` with the present `multiplier`.
    """
    push = trial.delassus[p] * multiplier[p]
    for k in range(trial.first_neighbour[p], trial.first_neighbour[p + 1]):
        push += trial.coupling[k] * multiplier[trial.neighbour[k]]
    return push  # type: ignore[no-any-return]


def coupled_gap(trial: Trial, multiplier: Floats, p: int) -> float:
    """Return the predicted gap of point p, including the forces of all contacts at its ends."""
    return trial.predicted_gap[p] + trial.gap_response * coupled_push(trial, multiplier, p)  # type: ignore[no-any-return]


def coupled_rate(trial: Trial, multiplier: Floats, p: int) -> float:
    """Return the predicted gap rate of point p, including the forces of all contacts at its ends."""
    return trial.predicted_rate[p] + trial.rate_response * coupled_push(trial, multiplier, p)  # type: ignore[no-any-return]


def unbound() -> NoReturn:
    """Raise NotImplementedError; the body of a slot that no kernel is bound to."""
    raise NotImplementedError("a slot is called before a kernel is bound to it")


@apart
def stress(material: object, point: int, strain: float) -> float:
    """Return the stress of a point of a body at `strain`; a slot for the body's material.

    `material` is what the kernel of the element receives, and `point` the number of its element in the bound arrays.
    """
    unbound()


def energy_density(material: object, point: int, before: float, after: float) -> float:
    """Return the staggered strain-energy density of a point of a body; a slot for the body's material.

    `material` is what the kernel of the element receives, and `point` the number of its element in the bound arrays.
    """
    unbound()


@apart
def stress_2d(material: object, point: int, gradient: tuple[float, ...]) -> tuple[float, ...]:
    """Return the stress of a point of a body in two dimensions; a slot for the body's material.

    Gradient of the displacement and stress are (xx, xy, yx, yy), as of `percuss.SolidMaterial.stress_2d`.
    """
    unbound()


@apart
def stress_3d(material: object, point: int, gradient: tuple[float, ...]) -> tuple[float, ...]:
    """Return the stress of a point of a body in three dimensions; a slot for the body's material.

    Gradient of the displacement and stress are (xx, xy, xz, yx, ..., zz), as of `percuss.SolidMaterial.stress_3d`.
    """
    unbound()


def accelerations(system: object, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to the accelerations in a stage of the step; a slot that the time loop fills."""
    unbound()


def internal(system: object, stage: int, u: Floats, f: Floats) -> None:
    """Set `f` to ``M^-1 f_int(u)`` at a stage, without loads and contact; a slot that the time loop fills."""
    unbound()


# Slots for the kernels of an element, whose arguments are those of `percuss.methods.interfaces.Element`.


def internal_force(*arguments: object) -> None:
    """Set the internal force of consecutive elements; a slot for the kernel of the body's element."""
    unbound()


@reduction
def energy(*arguments: object) -> float:
    """Return the staggered strain energy of consecutive elements; a slot for the kernel of the body's element."""
    unbound()


@merged
def cell_force(*arguments: object) -> None:
    """Set the forces of one cell on its nodes; a slot for `percuss.methods.interfaces.CellElement.force`."""
    unbound()


def follow(numbers: object, time: float, displacement: float, velocity: float) -> float:
    """Return the force of a load that follows the motion of an end; a slot for the kernel of the load."""
    unbound()
