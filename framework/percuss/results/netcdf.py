"""Results as NetCDF-4 files, every value, name and attribute covered by a checksum."""

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

FORMAT = "percuss-result-2"  # the first one had no checksums
AGAIN = "Make the run again, or take a copy of the file that is whole."
DIGEST = "sha256"  # attribute with the checksum of all else in the file


def write(path: str | os.PathLike[str], histories: xr.Dataset, fields: xr.Dataset | None) -> None:
    """Write histories, and fields in a group of their own: beside `path` first, then renamed.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    """
    import xarray as xr

    whole = histories.assign_attrs({DIGEST: _digest(histories, xr.Dataset() if fields is None else fields)})
    with replacing(path, ".nc") as beside:
        whole.to_netcdf(beside, engine="netcdf4", format="NETCDF4", encoding=_checksums(whole))
        if fields is not None:
            fields.to_netcdf(
                beside, engine="netcdf4", format="NETCDF4", mode="a", group="fields", encoding=_checksums(fields)
            )


def read(path: str | os.PathLike[str]) -> tuple[xr.Dataset, xr.Dataset | None]:
    """Read histories, and fields if there are any, of a result.

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
            kind = dataset.attrs.get("format")
    except Exception as error:  # whatever the libraries say of bytes that are no NetCDF
        raise InputError([Problem(str(path), "", "expected a NetCDF-4 file, found something else")]) from error
    if kind != FORMAT:
        earlier = isinstance(kind, str) and kind.startswith("percuss-result-")
        found, advice = (f"the format {kind}", AGAIN) if earlier else ("another NetCDF file", "")
        raise InputError([Problem(str(path), "", f"expected a percuss result ({FORMAT}), found {found}", advice)])
    try:
        return _checked(path)
    except Exception as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise InputError([Problem(str(path), "", f"the file is damaged: {reason}", AGAIN)]) from error


def _checked(path: str | os.PathLike[str]) -> tuple[xr.Dataset, xr.Dataset | None]:
    """Return the contents of a file of the right format; raise whatever shows that the file is damaged."""
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


def _checksums(dataset: xr.Dataset) -> dict[Any, dict[str, Any]]:
    """Return how the variables of a dataset are stored: those of numbers with a checksum for each chunk.

    HDF5 keeps text elsewhere than in the chunks, and has none for variables without an axis or an entry: these are
    covered by the checksum of the whole file alone.
    """
    return {
        name: {"fletcher32": True}
        for name, variable in dataset.variables.items()
        if variable.dtype.kind in "iuf" and variable.size > 0 and variable.ndim > 0
    }


def _digest(*datasets: xr.Dataset) -> str:
    """Return a checksum of all values, names and attributes of datasets, the same before writing and after reading."""
    digest = hashlib.sha256()
    for dataset in datasets:
        told: list[Any] = [sorted((str(name), str(value)) for name, value in dataset.attrs.items() if name != DIGEST)]
        for name, variable in sorted(dataset.variables.items(), key=lambda item: str(item[0])):
            attributes = sorted((str(key), str(value)) for key, value in variable.attrs.items())
            values = variable.to_numpy()
            numeric = values.dtype.kind in "iuf"
            told += [str(name), list(variable.dims), list(values.shape), attributes]
            told.append([] if numeric else [str(value) for value in values.ravel()])
            if numeric:
                # one pattern of bits for all that is no number, and one order of bytes
                exact = values.astype("<f8" if values.dtype.kind == "f" else "<i8")
                if exact.dtype.kind == "f":
                    exact = np.where(np.isnan(exact), np.nan, exact)
                digest.update(exact.tobytes())
        digest.update(json.dumps(told).encode())
    return digest.hexdigest()
