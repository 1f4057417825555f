"""The damped spring of Hunt and Crossley."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from percuss import ContactLaw, ContactPoints, Doc, Ge, Gt, Le, Unit
from percuss_methods.contacts._auto import quarter_stiffness, refuse_several

if TYPE_CHECKING:
    from percuss import Floats, Trial


class Spring(NamedTuple):
    """Stiffness, exponent n, overlap r and ``3 (1 - e) / 2`` of each point, (P,) each."""

    stiffness: Floats
    exponent: Floats
    overlap: Floats
    damping: Floats


@dataclass(frozen=True)
class HuntCrossley(ContactLaw):
    """Spring of Hunt and Crossley, whose damping grows with the overlap.

    Formula: ``lambda = eps_s d (d/r)^(n-1) (1 + a d')``, never less than zero; ``a = 3 (1 - e) / (2 d'_0)``, with the
    overlap d = <-g>, its rate d', and the greatest rate d'_0 since the contact closed.

    Rigid bodies that meet at the speed v separate at a speed v_1 that does not depend on eps_s, n or their masses:
    ``a v - log(1 + a v) = -a v_1 - log(1 - a v_1)``. For e near 1 it is e v, as in the paper: 1 - v_1/v differs from
    1 - e by terms of second order. The paper takes for d'_0 the rate at which the contact closed, which of rigid bodies
    is the greatest. Where elastic bodies close slowly and are pressed together afterwards, the damping that follows
    from it has no bound.

    With central difference a closed contact with n = 1 lowers the critical step as a penalty does, and more by its
    damping; with any other n the step depends on the overlap. Because the damping depends on the motion so far, the
    certificate is `no` or `unknown`.

    The dissipated energy is the work of the damping with the mean of the rates before and after the force, which are
    known one step later.
    """

    name = "hunt-crossley"
    summary = "Spring with damping that grows with the overlap; restitution e"
    references = (
        "Hunt, Crossley: Coefficient of restitution interpreted as damping in vibroimpact, Journal of Applied "
        "Mechanics 42 (1975) 440-445, doi 10.1115/1.3423596",
    )
    examples = ({}, {"beta_s": 0.1, "restitution": 0.7}, {"epsilon_s": 5.0, "exponent": 1.5, "at_overlap": 0.01})
    stiffening = ("beta_s", "epsilon_s")
    guarantees = ("never pulls",)
    # greatest rate of the overlap since the contact closed, energy stored and energy dissipated; of the step before,
    # the force of the damping and the rate before it; and the work of the damping
    state = 6
    stored_in = 1
    dissipated_in = 2

    beta_s: Annotated[float, Gt(0), Unit("1"), Doc("eps_s over EA/h, softer side; 1/4 unless given")] | None = None
    epsilon_s: Annotated[float, Gt(0), Unit("force/length"), Doc("stiffness; instead of beta_s")] | None = None
    exponent: Annotated[float, Ge(1), Unit("1"), Doc("n; 3/2 between spheres")] = 1.0
    at_overlap: Annotated[float, Gt(0), Unit("length"), Doc("r, where the force is eps_s r, for n > 1")] | None = None
    restitution: Annotated[float, Gt(0), Le(1), Unit("1"), Doc("e of rigid bodies, near 1")] = 0.9

    def __post_init__(self) -> None:
        refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")
        if (self.exponent != 1.0) != (self.at_overlap is not None):
            raise ValueError("at_overlap belongs to an exponent other than 1: give both or neither")

    def bind(self, points: ContactPoints, dt: float) -> Spring:  # noqa: ARG002
        """Return stiffness, exponent, overlap and damping of each point."""
        values = (self.exponent, self.at_overlap or 1.0, 1.5 * (1.0 - self.restitution))
        return Spring(quarter_stiffness(self, points), *(np.full(points.stiffness.size, value) for value in values))

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return the stiffness eps_s."""
        return {"epsilon_s": quarter_stiffness(self, points)}

    @staticmethod
    def multipliers(bound: Spring, trial: Trial, multiplier: Floats) -> None:
        """Set the force of each point, and follow its greatest rate and its energies."""
        for p in range(multiplier.size):
            overlap = max(-trial.gap[p], 0.0)
            rate = -trial.rate[p]
            greatest = max(trial.before[p, 0], rate) if overlap > 0.0 else 0.0
            spring = bound.stiffness[p] * overlap * (overlap / bound.overlap[p]) ** (bound.exponent[p] - 1.0)
            # The spring over the greatest rate is bounded, the damping over it is not.
            damping = bound.damping[p] * (spring / greatest) * rate if greatest > 0.0 else 0.0
            multiplier[p] = max(spring + damping, 0.0)
            trial.after[p, 0] = greatest
            trial.after[p, 1] = spring * overlap / (bound.exponent[p] + 1.0)
            mean_rate = 0.5 * (trial.before[p, 4] + rate)
            work = trial.before[p, 5] + trial.before[p, 3] * mean_rate * trial.dt
            # Where the end turns around within a step the damping gives a little back, which the next steps take again.
            trial.after[p, 2] = max(trial.before[p, 2], work)
            trial.after[p, 5] = work
            trial.after[p, 3] = multiplier[p] - spring
            trial.after[p, 4] = rate
