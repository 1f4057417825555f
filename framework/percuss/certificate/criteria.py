"""The criterion of a run: one criterion for each of its stretches, of which the worst decides.

The black box uses no property of the laws, so that it is an independent check of the linear laws, which ask it only
about bodies of one or two elements above theta = 1.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from percuss.certificate.assessment import Assessment, quoted
from percuss.certificate.black_box import BlackBox
from percuss.certificate.bounds import Bounds
from percuss.certificate.lanczos import Lanczos, why_not_covered
from percuss.certificate.linear_laws import LinearLaws, doubts_of, linear_laws
from percuss.contact.frictions import frictional
from percuss.march.model_of_case import stretches
from percuss.mesh.size_limits import why_not_factored

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.contact.model import Model

# What tells the stability of one stretch of a run.
Criterion = LinearLaws | BlackBox | Lanczos | Bounds
# Of a machine of 2023: these numbers times a power of the nodes of a body, by the dimension of space.
SECONDS_TO_SEARCH = {2: (1.7e-6, 1.5), 3: (2.7e-7, 2.0)}
MOST_CHEAP = 600  # degrees of freedom of solids that are factored in a blink
SEVERITY = {"stable": 0, "no growth found": 1, "unknown": 1, "grows": 2}  # of the answers about stretches


class RunCriterion:
    """Criterion for a whole run, made of one criterion for each of its stretches, of which the worst decides.

    Parameters
    ----------
    model
        The model of the whole run.
    kind
        `linear_laws`, `BlackBox`, `Lanczos` or `Bounds`.
    other_step
        The criterion of the same run with another step. If the run has the same stretches with both steps, it also has
        the same critical step, and their criteria are taken over with what they have searched already.
    """

    def __init__(
        self, model: Model, kind: Callable[[Model], Criterion], other_step: RunCriterion | None = None
    ) -> None:
        self.model = model
        self.names = model.contact_points.names
        self.kind = kind
        self.stretches = stretches(model)
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

    def times(self, assessment: Assessment) -> list[float] | None:
        """Return start and stop of the stretch that an assessment is of; None where the run has one stretch alone."""
        stretch = self.stretches[assessment.stretch]
        return [stretch.start, stretch.stop] if len(self.stretches) > 1 else None

    @property
    def critical_step(self) -> float:
        """Largest stable step, nan where it is not known."""
        try:
            limits = [criterion.critical_step for criterion in self.criteria]
        except np.linalg.LinAlgError:  # of matrices that overflow, as the assessment of a step says
            return np.nan
        return float(np.nan if np.isnan(limits).any() else min(limits))

    @property
    def proven_step(self) -> float:
        """Step up to which bounds prove solids stable that are not factored, nan where they prove none."""
        found = [one.bounds if isinstance(one, Lanczos) else one for one in self.criteria]
        return min(one.proven_step for one in found if isinstance(one, Bounds))

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
        worst = max(assessments, key=lambda one: (SEVERITY[one.answer], one.theta or 0.0))
        return dataclasses.replace(worst, theta=max(thetas, default=None))


def criterion_of(model: Model, other_step: RunCriterion | None = None, *, quickly: bool = False) -> RunCriterion:
    """Return the criterion of a run: that of the linear laws if they cover all of its contacts, else the black box.

    Of bodies that are too large to factor it is that of a Lanczos run, or of bounds where that does not cover them.

    Parameters
    ----------
    model
        The model of the run.
    other_step
        The criterion of the same run with another step, if there is one.
    quickly
        Whether solids are not factored unless that takes a blink.
    """
    kind: Callable[[Model], Criterion] = BlackBox if doubts_of(model) else linear_laws
    large = too_large(model)
    if large or (quickly and kind is linear_laws and takes_long(model)):
        if kind is linear_laws and not why_not_covered(model):
            kind = Lanczos
        elif large:
            kind = Bounds
    return RunCriterion(model, kind, other_step)


def takes_long(model: Model) -> bool:
    """Return whether the motions of solids are too many to be factored in a blink."""
    return not model.bodies.of_lines and model.bodies.mass_of_dofs.size > MOST_CHEAP


def too_large(model: Model) -> str:
    """Return why the solids of a model are not factored; empty if they are, or if there are none."""
    solids = [body.mass.size for body in model.bodies.values() if not body.is_bar]
    return why_not_factored(solids, model.dim) if solids else ""


def seconds_to_search(model: Model) -> float:
    """Return roughly how long the search of the critical step of a run takes, most of it factors [s]; 0 of bars.

    With friction it is searched of open points and of points that stick, with a row for each direction.
    """
    scale, power = SECONDS_TO_SEARCH.get(model.dim, (0.0, 1.0))
    searches = 1 + model.dim if frictional(model) else 1
    return float(searches * sum(scale * body.mass.size**power for body in model.bodies.values() if not body.is_bar))


def unknown_by_mass(model: Model) -> str:
    """Return why no criterion covers the mass of a model; empty if one does.

    Ends without mass, and masses that couple nodes, are examined by the linear laws alone.
    """
    what = model.why("black box")
    doubts = doubts_of(model) if what else ()
    return f"{what}, and {'; '.join(doubts)}" if doubts else ""
