"""The criteria of a run: one for each of its stretches, from the sparse operator or from the step itself.

The step itself uses no property of the laws and `percuss.certificate.closed_form` no mesh, so each of them is an
independent check of the operator, which asks the step itself only about bodies of one or two elements above theta = 1.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING

import numpy as np

from percuss.certificate.assembled import operator_of
from percuss.certificate.assessment import Assessment, Criterion, quoted
from percuss.certificate.closed_contacts import closed_contacts
from percuss.certificate.operator_criterion import OperatorCriterion
from percuss.certificate.scheme_limit import limit_ratio
from percuss.certificate.step_itself import LARGEST_DENSE_STATE, StepCriterion

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.march.model import Model

# Number of elements below which contact can damp all of a body, so that a step above theta = 1 may be stable.
SHORT_BODY_ELEMENTS = 3


def operator_criterion(model: Model) -> OperatorCriterion:
    """Return the criterion of the sparse operator of a stretch of a run, `percuss.march.model.Model.stretches`."""
    # Contact can damp all of a short body, so a step above theta = 1 may be stable: the step itself tells. The state of
    # ends without mass is not one of displacement and velocity alone, and states are weighted with diagonal masses.
    short = any(body.count < SHORT_BODY_ELEMENTS for body in model.bodies.values())
    covered = not model.why("black box")
    asked = short and covered and 2 * model.dim * model.bodies.mass.size <= LARGEST_DENSE_STATE
    return OperatorCriterion(
        operator_of(model),
        model.rows.at(0.5 * model.dt)[1:],
        functools.partial(closed_contacts, model),
        contact_names(model),
        limit_ratio=limit_ratio(model),
        tied=model.tied_points,
        apart=lambda: operator_of(model, tied=False),
        beyond=StepCriterion(model) if asked else None,
        why_open=model.why("short bars") if short else "",
    )


def step_criterion(model: Model) -> StepCriterion:
    """Return the criterion of the step itself of a stretch; its search begins at the critical step by the operator."""
    return StepCriterion(
        model, lambda: 0.0 if closed_contacts(model, model.dt).doubts else operator_criterion(model).bound
    )


def contact_names(model: Model) -> list[str]:
    """Return the name of the contact of each point."""
    return [contact_point.name for contact_point in model.contact_points]


class RunCriterion:
    """Criterion for a whole run, made of one criterion for each of its stretches, of which the worst decides.

    Parameters
    ----------
    model
        The model of the whole run.
    kind
        `operator_criterion`, `step_criterion`, or `percuss.certificate.bounds.BoundsCriterion`.
    other_step
        The criterion of the same run with another step. If the run has the same stretches with both steps, it also has
        the same critical step, and their criteria are taken over with what they have searched already.
    """

    def __init__(
        self, model: Model, kind: Callable[[Model], Criterion], other_step: RunCriterion | None = None
    ) -> None:
        self.model = model
        self.names = contact_names(model)
        self.kind = kind
        self.stretches = model.stretches()
        # What acts in each stretch: the active constraints, and all contact points but the inactive ones.
        self._actions = [(stretch.constraints, stretch.inactive) for stretch in self.stretches]
        same = other_step is not None and other_step.kind is kind and other_step._actions == self._actions
        known = other_step.criteria if other_step and same else None
        self.criteria: list[Criterion] = known or [kind(stretch.model) for stretch in self.stretches]
        self.by = self.criteria[0].by

    @property
    def free(self) -> float:
        """Largest step that is stable with no contact closed but ties."""
        return min(criterion.free for criterion in self.criteria)

    def nothing_closed(self, stretch: int | None = None, without_ties: str = "without contact") -> str:
        """Return in words that no contact is closed but ties, in a stretch or the one that limits `free`."""
        if stretch is None:
            stretch = int(np.argmin([criterion.free for criterion in self.criteria]))
        tied = self.stretches[stretch].model.tied_points
        noun = "contacts" if len({self.names[p] for p in tied}) > 1 else "contact"
        return f"with {noun} {quoted(self.names, tied)} tied and no other closed" if tied else without_ties

    @property
    def critical_step(self) -> float:
        """Largest stable step, nan where it is not known."""
        try:
            limits = [criterion.critical_step for criterion in self.criteria]
        except np.linalg.LinAlgError:  # of matrices that overflow, as the assessment of a step says
            return np.nan
        return float(np.nan if np.isnan(limits).any() else min(limits))

    def assess_step(self, dt: float) -> Assessment:
        """Return the assessment of a step in the worst stretch, with the largest theta of all stretches."""
        try:
            assessments = [
                dataclasses.replace(criterion.assess_step(dt), stretch=k) for k, criterion in enumerate(self.criteria)
            ]
        except np.linalg.LinAlgError as error:
            doubt = f"the numbers of its matrices are too large or too unlike to be computed with ({error})"
            return Assessment("unknown", doubt=doubt)
        thetas = [assessment.theta for assessment in assessments if assessment.theta is not None]

        def severity(assessment: Assessment) -> tuple[int, float]:
            kind = {"stable": 0, "grows": 2}.get(assessment.answer, 1)
            return kind, assessment.theta or 0.0

        return dataclasses.replace(max(assessments, key=severity), theta=max(thetas, default=None))
