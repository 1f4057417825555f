"""Coulomb's friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from percuss import Doc, Friction, FrictionPoints, Ge, Stiffness, Unit


class Cone(NamedTuple):
    """The opening of the cone."""

    mu: float


@dataclass(frozen=True)
class Coulomb(Friction):
    """Coulomb's friction: a point slides where its force along the surfaces reaches a share of the normal force.

    Formula: ``|lambda_t| <= mu lambda_n``; where the point slides, ``lambda_t`` is that large, against the slip rate.
    """

    name = "coulomb"
    summary = "Coulomb's friction: at most a share of the normal force"
    references = (
        "Wriggers: Computational Contact Mechanics, 2nd ed., Springer 2006, ch. 5, doi 10.1007/978-3-540-32609-0",
    )
    shorthand = "mu"
    examples = ({"mu": 0.3}, {"mu": 0.1, "stiffness": "exact"})

    mu: Annotated[float, Ge(0), Unit("1"), Doc("coefficient of friction")]
    stiffness: Stiffness = None

    @property
    def acts(self) -> bool:
        """Whether the coefficient is not 0."""
        return self.mu > 0.0

    def bind(self, points: FrictionPoints, dt: float) -> Cone:  # noqa: ARG002
        """Return the coefficient."""
        return Cone(self.mu)

    @staticmethod
    def bound(data, point, force, rate, before) -> float:  # noqa: ARG004
        """Return ``mu lambda_n``."""
        return data.mu * force
