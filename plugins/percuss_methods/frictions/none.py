"""No friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from percuss import Friction, FrictionPoints


class Nothing(NamedTuple):
    """No numbers."""


@dataclass(frozen=True)
class NoFriction(Friction):
    """Frictionless surfaces: the force of a contact point is along its normal.

    Formula: ``lambda_t = 0``.
    """

    name = "none"
    summary = "Frictionless surfaces"

    @property
    def acts(self) -> bool:
        """No."""
        return False

    def bind(self, points: FrictionPoints, dt: float) -> Nothing:  # noqa: ARG002
        """Return nothing."""
        return Nothing()

    @staticmethod
    def bound(data, point, force, rate, before) -> float:  # noqa: ARG004
        """Return 0."""
        return 0.0
