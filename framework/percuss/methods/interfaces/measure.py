"""The interface of a measure: a number that is taken from a result."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

from percuss.methods.interfaces.base import Component


class Measure(Component, contract="measures"):
    """A number that a study takes of every run that is done, beside those of its summary and histories.

    Attributes
    ----------
    what
        In words: quantity, norm, averaging; stands beside the column.
    """

    what: ClassVar[str]

    @abstractmethod
    def of(self, result: Any) -> float | None:
        """Return the number of a `percuss.Result`, None where it has none."""
