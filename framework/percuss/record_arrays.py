"""Record arrays, which the compiled loop and plain Python read alike."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, TypeAlias, cast

import numpy as np

Records: TypeAlias = "np.recarray[Any, np.dtype[np.record]]"  # its fields are attributes, as those of each record
Row: TypeAlias = np.record  # one of them


def empty_records(count: int, kind: np.dtype[np.void]) -> Records:
    """Return a record array of the dtype `kind`, filled with zeros."""
    return np.zeros(count, dtype=_record_dtype(kind)).view(np.recarray)


def record_array(rows: Sequence[tuple[object, ...]], kind: np.dtype[np.void]) -> Records:
    """Return rows of values as a record array of the dtype `kind`."""
    return np.array(rows, dtype=_record_dtype(kind)).view(np.recarray)


def copied_records(records: Records) -> Records:
    """Return a copy of a record array, in a tenth of the time that NumPy takes, which copies it field by field."""
    return np.frombuffer(bytearray(records), records.dtype).view(np.recarray)


@functools.lru_cache(maxsize=64)
def _record_dtype(kind: np.dtype[np.void]) -> np.dtype[np.record]:
    """Return the dtype of the records of a record array, which NumPy makes anew for each array of another dtype."""
    return cast("np.dtype[np.record]", np.dtype((np.record, kind)))
