"""The criterion of a run of solids under laws that no stiffness and inertia describe: it finds growth, or nothing.

The black box examines many combinations of closed contacts on several lines of such laws, which takes far longer than
the march of a run. Here a Lanczos run tells of the bodies alone, and of small solids a few products with the step
itself tell of all contacts closed. What grows in these is unstable; where nothing grows, little is known.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from percuss.certificate.assessment import MARGINAL_DISTANCE, Assessment
from percuss.certificate.black_box import LARGEST_DENSE_STATE, MOST_TOGETHER, BlackBox, grows_clearly
from percuss.certificate.closed_step import Motions
from percuss.certificate.lanczos import Lanczos, why_not_covered
from percuss.certificate.linear_laws import doubts_of

if TYPE_CHECKING:
    from percuss.contact.model import Model

MOST_MOTIONS = 1500  # degrees of freedom of solids of which the step itself is looked at, those of all stretches
OF_EACH_STRETCH = 300  # that take as long as what is done once in a stretch
MOST_IN_GAPS = 100_000  # entries of the gaps of all motions, which are kept in full


def looked_at_by_check(model: Model) -> str:
    """Return why a run does not tell whether a step is stable."""
    return f"{'; '.join(doubts_of(model))}: `percuss check` looks for growth"


def takes_longer_than_a_run(model: Model) -> bool:
    """Return whether the black box takes longer than the march: of all solids but small ones with few linear laws."""
    few = len(model.contact_points) <= MOST_TOGETHER and 2 * model.bodies.mass_of_dofs.size <= LARGEST_DENSE_STATE // 2
    return not model.bodies.of_lines and not (few and all(one.linear is not None for one in model.laws))


class Glance(Lanczos):
    """Criterion of one stretch of a run of solids from a few products.

    Parameters
    ----------
    model
        A stretch of a run, `percuss.march.model_of_case.stretches`.
    """

    critical_step = math.nan  # `check` searches it

    def assess_step(self, dt: float) -> Assessment:
        """Return the assessment of a step."""
        model, covered = self.model, not why_not_covered(self.model)
        if covered and dt > self.bounds.free and dt > self.free * (1.0 + MARGINAL_DISTANCE):
            return Assessment("grows")
        points, size = range(len(model.contact_points)), self._root.size
        in_all = (size + OF_EACH_STRETCH) * len(model.whole.segments())
        if in_all <= MOST_MOTIONS and size * len(points) <= MOST_IN_GAPS:
            motions = Motions(model)
            if grows_clearly(motions, dt, points):
                return Assessment("grows", motions.not_tied, by=BlackBox.by)
        return Assessment("unknown", doubt=looked_at_by_check(model))
