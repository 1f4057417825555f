"""Results as NetCDF-4 files in which a checksum covers every value, name and attribute."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import InputError, Problem
from percuss.files import replacing

if TYPE_CHECKING:
    import xarray as xr

FORMAT = "percuss-result-2"  # format 1 had no checksums
ADVICE = "Make the run again, or take a copy of the file that is whole."
DIGEST = "sha256"  # attribute with the checksum of everything else in the file


def write(path: str | os.PathLike[str], histories: xr.Dataset, fields: xr.Dataset | None) -> None:
    """Write histories, and fields in a group of their own, to a temporary file beside `path`, then rename it.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    """
    import xarray as xr

    with_digest = histories.assign_attrs({DIGEST: _digest(histories, xr.Dataset() if fields is None else fields)})
    with replacing(path, ".nc") as temporary:
        with_digest.to_netcdf(temporary, engine="netcdf4", format="NETCDF4", encoding=_encodings(with_digest))
        if fields is not None:
            fields.to_netcdf(
                temporary, engine="netcdf4", format="NETCDF4", mode="a", group="fields", encoding=_encodings(fields)
            )


def read(path: str | os.PathLike[str]) -> tuple[xr.Dataset, xr.Dataset | None]:
    """Return the histories of a result file, and its fields or None.

    Raises
    ------
    InputError
        If there is no such file, it is not a percuss result, or it is damaged.
    """
    import xarray as xr

    if not Path(path).is_file():
        raise InputError([Problem(str(path), "", "expected a result file, found nothing", "Write one with -o.")])
    try:
        with xr.open_dataset(path, engine="netcdf4") as dataset:
            file_format = dataset.attrs.get("format")
    except Exception as error:  # the libraries raise errors of many types for a file that is not NetCDF
        raise InputError([Problem(str(path), "", "expected a NetCDF-4 file, found something else")]) from error
    if file_format != FORMAT:
        is_older_format = isinstance(file_format, str) and file_format.startswith("percuss-result-")
        actual, advice = (f"the format {file_format}", ADVICE) if is_older_format else ("another NetCDF file", "")
        raise InputError([Problem(str(path), "", f"expected a percuss result ({FORMAT}), found {actual}", advice)])
    try:
        return _read_verified(path)
    except Exception as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise InputError([Problem(str(path), "", f"the file is damaged: {reason}", ADVICE)]) from error


def _read_verified(path: str | os.PathLike[str]) -> tuple[xr.Dataset, xr.Dataset | None]:
    """Return the contents of a file of the right format; raise an error of any type if the file is damaged."""
    import netCDF4
    import xarray as xr

    with xr.open_dataset(path, engine="netcdf4") as dataset:
        histories = dataset.load()
    with netCDF4.Dataset(path) as file:
        has_fields = "fields" in file.groups
    fields = xr.Dataset()
    if has_fields:
        with xr.open_dataset(path, engine="netcdf4", group="fields") as dataset:
            fields = dataset.load()
    if histories.attrs.pop(DIGEST, None) != _digest(histories, fields):
        raise ValueError("its contents do not have the checksum that was written with them")
    for name in ("summary", "provenance"):
        json.loads(histories.attrs[name])
    return histories, fields if has_fields else None


def _encodings(dataset: xr.Dataset) -> dict[Any, dict[str, Any]]:
    """Return the encoding of the variables of a dataset: numeric ones have a checksum for each chunk.

    HDF5 stores text outside the chunks, and has no chunks for variables without an axis or an entry: these are covered
    by the checksum of the whole file alone.
    """
    return {
        name: {"fletcher32": True}
        for name, variable in dataset.variables.items()
        if variable.dtype.kind in "iuf" and variable.size > 0 and variable.ndim > 0
    }


def _digest(*datasets: xr.Dataset) -> str:
    """Return a checksum of all values, names and attributes of datasets, equal before writing and after reading."""
    digest = hashlib.sha256()
    for dataset in datasets:
        content: list[Any] = [
            sorted((str(name), str(value)) for name, value in dataset.attrs.items() if name != DIGEST)
        ]
        for name, variable in sorted(dataset.variables.items(), key=lambda item: str(item[0])):
            attributes = sorted((str(key), str(value)) for key, value in variable.attrs.items())
            values = variable.to_numpy()
            numeric = values.dtype.kind in "iuf"
            content += [str(name), list(variable.dims), list(values.shape), attributes]
            content.append([] if numeric else [str(value) for value in values.ravel()])
            if numeric:
                # nan has many bit patterns, and numbers have the byte order of the machine
                portable = values.astype("<f8" if values.dtype.kind == "f" else "<i8")
                if portable.dtype.kind == "f":
                    portable = np.where(np.isnan(portable), np.nan, portable)
                digest.update(portable.tobytes())
        digest.update(json.dumps(content).encode())
    return digest.hexdigest()
