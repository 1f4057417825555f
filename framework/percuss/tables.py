"""Numbers from CSV files that a case names."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from percuss.contracts import DataFile

__all__ = ["read_table"]


def read_table(path: str, folder: Path) -> DataFile:
    """Return the numbers of a CSV file.

    Parameters
    ----------
    path
        As written in a case.
    folder
        Folder it is relative to.

    Returns
    -------
    DataFile
        With one row a column of the file; a first line of words is skipped.

    Raises
    ------
    ValueError
        If there is no such file, or something in it is not a finite number.
    """
    try:
        lines = (folder / path).read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise ValueError(f"no such file: {folder / path}") from None
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise ValueError(f"cannot read {folder / path}: {getattr(error, 'strerror', None) or error}") from None
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        cells = [cell.strip() for cell in line.replace(";", ",").split(",")] if line.strip() else []
        if not cells or line.lstrip().startswith("#"):
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            if not rows and number == 1:
                continue
            raise ValueError(f"{path}, line {number}: expected numbers, found {line.strip()!r}") from None
        if not all(map(math.isfinite, row)):
            raise ValueError(f"{path}, line {number}: expected finite numbers, found {line.strip()!r}")
        if rows and len(row) != len(rows[0]):
            raise ValueError(f"{path}, line {number}: expected {len(rows[0])} columns as above, found {len(row)}")
        rows.append(row)
    if not rows:
        raise ValueError(f"{path} holds no numbers")
    table = np.ascontiguousarray(np.array(rows).T)
    table.flags.writeable = False
    return DataFile(path, table)
