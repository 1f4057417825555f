"""Elements in a row, of equal lengths or of lengths that form a geometric sequence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from percuss import Floats


def lengths_of(length: float, count: int, grading: float) -> Floats:
    """Return the lengths of elements in a row, the last of which is `grading` times as long as the first."""
    if grading == 1.0 or count == 1:
        return np.full(count, length / count)
    lengths: Floats = grading ** (np.arange(count) / (count - 1))
    lengths *= length / lengths.sum()
    return lengths


def places_of(lengths: Floats, length: float) -> Floats:
    """Return where the elements begin and end."""
    return np.append(np.concatenate([[0.0], np.cumsum(lengths[:-1])]), length)
