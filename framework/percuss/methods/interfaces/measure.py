"""Interface of a measure: a number computed from a result."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

from percuss.methods.interfaces.base import Component


class Measure(Component, contract="measures"):
    """A number that a study computes from each completed run, in addition to its summary and histories.

    Attributes
    ----------
    what
        Description of quantity, norm and averaging, in words; shown beside the column.
    """

    what: ClassVar[str]

    @abstractmethod
    def of(self, result: Any) -> float | None:
        """Return the value for a `percuss.Result`, or None if the result has none."""
