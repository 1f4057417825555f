"""Cohesive contact: a bond that pulls up to a strength, softens, and breaks at a length."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from percuss import ContactLaw, ContactPoints, Doc, Gt, Unit
from percuss_methods.contacts._auto import quarter_stiffness, refuse_several

if TYPE_CHECKING:
    from percuss import Floats, Trial


WHY_ENERGY_MAY_GROW = "a contact that opens, closes or softens between two steps adds or removes energy"


class Bond(NamedTuple):
    """Stiffness k, strength, and openings at which the bond begins to soften and at which it breaks, (P,) each."""

    stiffness: Floats
    strength: Floats
    onset: Floats
    length: Floats


@dataclass(frozen=True)
class Cohesive(ContactLaw):
    """Bilinear cohesive law: a spring that softens beyond its strength and breaks at a length; then a penalty.

    Formula: ``lambda = -K g``; ``K = k`` for g < 0, ``K = T(d) / d`` for g > 0, with the greatest opening d so far and
    ``T(d) = k d`` up to ``strength``, then ``strength (l - d) / (l - strength / k)`` up to the length l, then 0.

    The bond unloads towards the origin. The energy ``strength l / 2`` breaks it, between surfaces times the area,
    whatever k is. Contacts that begin with an opening of more than l are broken from the start, and touching ones are
    whole. One that begins with an opening below l pulls from the start, as if it had been stretched so far before. In
    the paper the bond is rigid up to its strength; here it has the stiffness k.

    With central difference a closed contact and a whole bond lower the critical step as a penalty does.
    """

    name = "cohesive"
    summary = "Bond that pulls, softens beyond its strength and breaks at a length"
    references = (
        "Camacho, Ortiz: Computational modelling of impact damage in brittle materials, Int. J. Solids Struct. 33 "
        "(1996) 2899-2938, doi 10.1016/0020-7683(95)00255-3",
    )
    examples = (
        {"strength": 0.02, "length": 0.5},
        {"strength": 0.02, "length": 0.5, "beta_s": 0.1},
        {"strength": 1e-6, "length": 1.0, "epsilon_s": 5.0},
    )
    expected_failures = {
        "exact-impact": "where the exact bodies part, the bond pulls",
        "energy-never-grows with central-difference": WHY_ENERGY_MAY_GROW,
        "energy-never-grows with wu-predictor-corrector": WHY_ENERGY_MAY_GROW,
    }
    stiffening = ("beta_s", "epsilon_s")
    bond = True
    totals = ("energy_to_break",)
    # greatest opening, energy stored and energy dissipated; 1 after the first step, and what it had lost before that
    state = 5
    stored_in = 1
    dissipated_in = 2

    strength: Annotated[float, Gt(0), Unit("force"), Doc("largest pull")]
    length: Annotated[float, Gt(0), Unit("length"), Doc("l, the opening at which the bond is broken")]
    beta_s: Annotated[float, Gt(0), Unit("1"), Doc("k over EA/h of the softer side; 1/4 unless given")] | None = None
    epsilon_s: Annotated[float, Gt(0), Unit("force/length"), Doc("k; instead of beta_s")] | None = None

    def __post_init__(self) -> None:
        refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")

    def bind(self, points: ContactPoints, dt: float) -> Bond:  # noqa: ARG002
        """Return stiffness, strength, and the openings at which each bond softens and breaks.

        Raises
        ------
        ValueError
            If a bond would break before it reaches its strength.
        """
        stiffness = np.asarray(quarter_stiffness(self, points))
        strength = self.strength * points.weight
        onset = strength / stiffness
        if (onset >= self.length * (1.0 - 1e-12)).any():  # the two are equal in any units, or in none
            raise ValueError(
                f"with a stiffness of {stiffness.min():.4g} the bond reaches its strength at an opening of "
                f"{onset.max():.4g}, not below the length {self.length:g}: give a greater length or stiffness"
            )
        return Bond(stiffness, strength, onset, np.full(stiffness.size, self.length))

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return the stiffness k and the energy that breaks the bond, of each point."""
        return {
            "epsilon_s": quarter_stiffness(self, points),
            "energy_to_break": 0.5 * self.strength * self.length * points.weight,
        }

    @staticmethod
    def multipliers(bound: Bond, trial: Trial, multiplier: Floats) -> None:
        """Set the force of each point, and follow its greatest opening and its energies."""
        for p in range(multiplier.size):
            k, strength, onset, length = bound.stiffness[p], bound.strength[p], bound.onset[p], bound.length[p]
            gap = trial.gap[p]
            opening = max(trial.before[p, 0], gap)
            pull, work = k * opening, 0.5 * k * opening**2  # of the envelope up to the greatest opening
            if opening > onset:
                pull = max(strength * (length - opening) / (length - onset), 0.0)
                work = 0.5 * strength * onset + 0.5 * (strength + pull) * (min(opening, length) - onset)
            secant = pull / opening if opening > onset else k
            stiffness = secant if gap > 0.0 else k
            multiplier[p] = -stiffness * gap
            trial.after[p, 0] = opening
            trial.after[p, 1] = 0.5 * stiffness * gap**2
            lost = work - 0.5 * secant * opening**2
            trial.after[p, 3] = 1.0
            trial.after[p, 4] = trial.before[p, 4] if trial.before[p, 3] == 1.0 else lost
            trial.after[p, 2] = lost - trial.after[p, 4]
