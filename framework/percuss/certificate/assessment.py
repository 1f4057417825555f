"""What a stability criterion says of a step: one answer, whichever criterion gives it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.contact.model import Model

# Number of contacts that a reason names, so that it stays readable.
MOST_NAMED = 6

Answer = Literal["stable", "no growth found", "grows", "unknown"]


@dataclass(frozen=True)
class Assessment:
    """Assessment of one step by a stability criterion.

    Attributes
    ----------
    answer
        ``stable`` where nothing grows in any combination of closed contacts, which is certain; ``no growth found``
        where growth was looked for in vain and may be there; ``grows``; ``unknown`` where the criterion cannot tell.
    worst
        Contacts that suffice to make the step unstable while they are closed; empty where none are needed.
    theta
        theta of Wu's predictor-corrector in that combination, or the largest one found.
    doubt
        Why the answer is less than certain; empty where it is certain.
    stretch
        Number of the stretch of the run that is assessed.
    """

    answer: Answer
    worst: list[int] = field(default_factory=list)
    theta: float | None = None
    doubt: str = ""
    stretch: int = 0

    @property
    def conclusive(self) -> bool:
        """Whether the answer is certain."""
        return self.answer in {"stable", "grows"}

    @property
    def stable(self) -> bool:
        """Whether nothing grows as far as is known."""
        return self.answer in {"stable", "no growth found"}


class Criterion(Protocol):
    """A criterion of one stretch of a run."""

    by: ClassVar[str]

    @property
    def free(self) -> float:
        """Largest step that is stable with no contact closed but ties."""

    @property
    def critical_step(self) -> float:
        """Largest stable step, nan where it is not known."""

    def assess_step(self, dt: float) -> Assessment:
        """Return the assessment of a step."""

    def excess(self, dt: float) -> float:
        """Return the signed distance of a step from the critical one, -1 to 1: at most 0 where it is stable."""


def contact_names(model: Model) -> list[str]:
    """Return the name of the contact of each point."""
    return list(model.contact_points.names)


def quoted(names: Sequence[str], points: Sequence[int]) -> str:
    """Return the names of contacts in quotes, of many contacts the first `MOST_NAMED` and the number of the others."""
    named = list(dict.fromkeys(names[p] for p in points))
    first = ", ".join(f"'{name}'" for name in named[:MOST_NAMED])
    more = len(named) - MOST_NAMED
    return f"{first} and {more} more" if more > 0 else first
