"""Results as NetCDF-4 files, whose numbers have checksums that HDF5 compares (Fletcher-32)."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from percuss.case.quantities import FIELD_COORDINATES, QUANTITIES, unit_name
from percuss.errors import InputError, wrong_input
from percuss.files import is_file, replacing, unwritten
from percuss.jsonable import Data, Entries
from percuss.results.fields import component_names

if TYPE_CHECKING:
    import xarray as xr

_AXES = {
    "contact": ("contact",),
    "contact state": ("contact", "state_variable"),
    "probe": ("probe", "component"),
    "run": (),
}
Source = Literal["leap-frog", "multistage", "exact"]  # kind of scheme, or none
_POINTS = "point_contact"  # contact of each contact point
_TIMES = ("time", "time_half")  # a result without steps has no second one


def definition_attributes(source: Source, units: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return label, definition, unit and, for energies, times of each history of a run or of an exact solution.

    The label is the ``long_name``, which other programs write at the axes of their pictures. Units have the names in
    `units` where the case gives them, else words as ``force``.
    """
    attributes: dict[str, dict[str, str]] = {}
    for name, quantity in QUANTITIES.items():
        definition = quantity.definition
        if source == "multistage":
            definition = quantity.definition_multistage or definition
        elif source == "exact":
            definition = quantity.definition_exact
        if definition:
            unit = unit_name(quantity.unit, units) or quantity.unit
            attributes[name] = {"long_name": quantity.label, "definition": definition, "units": unit}
            if quantity.axis == "time_half":
                attributes[name]["at"] = "time_half"
    return attributes


def histories_dataset(
    arrays: Data,
    coordinates: Mapping[str, list[str]],
    described: Mapping[str, Mapping[str, str]],
    attributes: Data,
) -> xr.Dataset:
    """Return histories as a dataset.

    Parameters
    ----------
    arrays
        Histories by name, among them ``time`` and, if energies belong to other times, ``time_half``.
    coordinates
        Names along the axes ``contact`` and ``probe``; of surfaces whose laws have state variables the contact of each
        ``point`` too.
    described
        Attributes of each history (`definition_attributes`); a history without them is left out.
    attributes
        Attributes of the dataset.
    """
    import xarray as xr

    of_axes, axes = dict(_AXES), {axis: np.array(coordinates[axis], dtype=object) for axis in ("contact", "probe")}
    if "point" in coordinates:
        of_axes["contact state"] = ("point", "state_variable")
        axes[_POINTS] = ("point", np.array(coordinates["point"], dtype=object))  # type: ignore[assignment]
    data = {
        name: (("time", *of_axes[QUANTITIES[name].of]), values, described[name])
        for name, values in arrays.items()
        if name in described
    }
    component = list(range(arrays["displacement"].shape[2]))
    times = {name: ("time", arrays[name]) for name in _TIMES if name in arrays}
    return xr.Dataset(data, coords={**times, **axes, "component": component}, attrs=dict(attributes))


# Axes of the fields that are quantities, by what these are of; the stress of bars has one component.
_FIELD_AXES = {
    "element": ("time", "element", "stress_component"),
    "probe": ("time", "node", "component"),
    "point": ("time", "point"),
}
_STRESSES = "stress_component"


def fields_dataset(field_arrays: Data, source: Source, units: Mapping[str, str]) -> xr.Dataset:
    """Return the fields over time as a dataset; empty if none were recorded."""
    import xarray as xr

    described = definition_attributes("leap-frog", units) | definition_attributes(source, units)
    variables, coordinates = {}, {}
    for name, values in field_arrays.items():
        array = np.array(values, dtype=object) if isinstance(values, list) else np.asarray(values)
        if name in FIELD_COORDINATES:
            about = FIELD_COORDINATES[name]
            unit = about.get("unit", "")
            attributes = {"long_name": about["label"], **({"units": unit_name(unit, units) or unit} if unit else {})}
            coordinates[name] = (about["axes"], array, attributes)
        else:
            axes = _FIELD_AXES[QUANTITIES[name].of][: array.ndim]
            variables[name] = (axes, array, described[name])
            if _STRESSES in axes:
                names = component_names(field_arrays["node_position"].shape[1])
                coordinates[_STRESSES] = ((_STRESSES,), np.array(names, dtype=object), {})
    return xr.Dataset(variables, coords=coordinates)


FORMAT = "percuss-result-4"  # format 3 had one checksum, at the end of the file
READ = ("percuss-result-3", FORMAT)
ADVICE = "Make the run again, or use an undamaged copy."
MOST_COMPRESSED = 1000  # bytes of numbers to a byte of the file, as HDF5 may compress them


def write(path: str | os.PathLike[str], histories: xr.Dataset, fields: xr.Dataset | None) -> None:
    """Write histories, and fields in a group of their own, to a temporary file beside `path`, then rename it.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    UnwrittenError
        If the file cannot be written to its end, as on a full disk.
    """
    with written_whole(path, ".nc") as temporary:
        histories.to_netcdf(temporary, engine="netcdf4", format="NETCDF4", encoding=_checksums(histories))
        if fields is not None:
            encoding = _checksums(fields)
            fields.to_netcdf(temporary, engine="netcdf4", format="NETCDF4", mode="a", group="fields", encoding=encoding)


def _checksums(dataset: xr.Dataset) -> dict[str, dict[str, bool]]:
    """Return the encoding by which all numbers of a dataset have checksums; texts have none in HDF5."""
    return {str(name): {"fletcher32": True} for name, values in dataset.variables.items() if values.dtype.kind in "if"}


@contextmanager
def written_whole(path: str | os.PathLike[str], suffix: str) -> Iterator[Path]:
    """Give a temporary path beside `path` for an HDF5 file, then rename the file.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    UnwrittenError
        If the file cannot be written to its end, as on a full disk.
    """
    with replacing(path, suffix) as temporary:
        try:
            yield temporary
        except (OSError, RuntimeError) as error:
            raise unwritten(Path(path), str(error)) from error


def read(path: str | os.PathLike[str]) -> tuple[Entries, dict[str, list[str]], Entries, Any, Any]:
    """Return what a result file holds: histories, names along the axes, fields, summary, provenance.

    Raises
    ------
    InputError
        If there is no such file, it is not a percuss result, or it is damaged.
    """
    import netCDF4
    import xarray as xr
    from xarray.backends import NetCDF4DataStore

    if not is_file(Path(path)):
        raise wrong_input(str(path), "expected a result file, found nothing", "Write one with -o.")
    try:
        with netCDF4.Dataset(path) as file:
            _expect_format(path, str(getattr(file, "format", "no format")))
            _expect_numbers(path, file)
            histories = xr.open_dataset(NetCDF4DataStore(file)).load()
            group = file.groups.get("fields")
            fields = xr.open_dataset(NetCDF4DataStore(group)).load() if group is not None else None
        summary, provenance = (json.loads(histories.attrs[name]) for name in ("summary", "provenance"))
    except InputError:
        raise
    except Exception as error:  # no NetCDF file, a damaged one, or one that another program put together
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise wrong_input(str(path), f"cannot be read as a percuss result: {reason}", ADVICE) from error
    arrays = {str(name): values.to_numpy() for name, values in histories.data_vars.items()}
    arrays |= {name: histories[name].to_numpy() for name in _TIMES if name in histories.coords}
    coordinates = {axis: [str(name) for name in histories[axis].to_numpy()] for axis in ("contact", "probe")}
    if _POINTS in histories.coords:
        coordinates["point"] = [str(name) for name in histories[_POINTS].to_numpy()]
    field_arrays: Entries = {}
    if fields is not None:
        for name in map(str, fields.variables):
            values = fields[name].to_numpy()
            field_arrays[name] = [str(word) for word in values] if values.dtype.kind in "OUT" else values
        field_arrays.pop(_STRESSES, None)
    return arrays, coordinates, field_arrays, summary, provenance


def _expect_format(path: str | os.PathLike[str], found: str) -> None:
    if found not in READ:
        raise wrong_input(str(path), f"expected a percuss result ({FORMAT}), found {found}", ADVICE)


def _expect_numbers(path: str | os.PathLike[str], file: Any) -> None:
    """Refuse a file that declares far more numbers than it can hold, for which HDF5 would fill all memory."""
    variables = [one for group in (file, *file.groups.values()) for one in group.variables.values()]
    declared = sum(math.prod(one.shape) * np.dtype(one.dtype).itemsize for one in variables if one.dtype is not str)
    if declared > MOST_COMPRESSED * Path(path).stat().st_size:
        raise ValueError(f"it declares {declared:.3g} bytes of numbers")
