"""Histories and stress fields of a result as xarray datasets, with their names along the axes and descriptions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from percuss.case.quantities import QUANTITIES, unit_name
from percuss.jsonable import Data, Entries

if TYPE_CHECKING:
    import xarray as xr

_AXES = {
    "contact": ("contact",),
    "contact state": ("contact", "state_variable"),
    "probe": ("probe", "component"),
    "run": (),
}
Source = Literal["leap-frog", "multistage", "implicit", "exact"]  # kind of scheme, or none
_TIMES = ("time", "time_half")  # a result without steps has no second one


def definition_attributes(source: Source, units: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return definition, unit and, for energies, times of each history of a run or of an exact solution.

    Units have the names in `units` where the case gives them, else words as ``force``.
    """
    attributes: dict[str, dict[str, str]] = {}
    for name, quantity in QUANTITIES.items():
        definition = quantity.definition
        if source == "multistage":
            definition = quantity.definition_multistage or definition
        elif source == "implicit" and quantity.of != "contact":
            # Forces are those of steps around t_n, as of a leap-frog scheme, and everything else that at t_n.
            definition = quantity.definition_multistage or definition
            definition = definition.replace("t_n+1/2", "t_n").replace("t_n+1", "t_n")
        elif source == "exact":
            definition = quantity.definition_exact
        if definition:
            attributes[name] = {"long_name": definition, "units": unit_name(quantity.unit, units) or quantity.unit}
            if quantity.axis == "time_half" and source != "exact":
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
        Names along the axes ``contact`` and ``probe``.
    described
        Attributes of each history (`definition_attributes`); a history without them is left out.
    attributes
        Attributes of the dataset.
    """
    import xarray as xr

    data = {
        name: (("time", *_AXES[QUANTITIES[name].of]), values, described[name])
        for name, values in arrays.items()
        if name in described
    }
    axes = {axis: np.array(coordinates[axis], dtype=object) for axis in ("contact", "probe")}
    component = list(range(arrays["displacement"].shape[2]))
    times = {name: ("time", arrays[name]) for name in _TIMES if name in arrays}
    return xr.Dataset(data, coords={**times, **axes, "component": component}, attrs=dict(attributes))


def fields_dataset(field_arrays: Data, units: Mapping[str, str]) -> xr.Dataset:
    """Return the stress along the bodies over time, (time, element), as a dataset; empty if none was recorded."""
    import xarray as xr

    if not field_arrays:
        return xr.Dataset()
    return xr.Dataset(
        {"stress": (("time", "element"), field_arrays["stress"], definition_attributes("leap-frog", units)["stress"])},
        coords={
            "time": field_arrays["time"],
            "body": ("element", np.array(field_arrays["body"], dtype=object)),
            "position": (("element", "component"), field_arrays["position"]),
        },
    )


def plain_arrays(histories: xr.Dataset, fields: xr.Dataset | None) -> tuple[Entries, dict[str, list[str]], Entries]:
    """Return histories, names along the axes, and fields of datasets as the plain values they were made from."""
    arrays = {str(name): values.to_numpy() for name, values in histories.data_vars.items()}
    arrays |= {name: histories[name].to_numpy() for name in _TIMES if name in histories.coords}
    coordinates = {axis: [str(name) for name in histories[axis].to_numpy()] for axis in ("contact", "probe")}
    field_arrays: Entries = {}
    if fields is not None:
        field_arrays = {name: fields[name].to_numpy() for name in ("time", "stress", "position")}
        field_arrays["body"] = [str(name) for name in fields["body"].to_numpy()]
    return arrays, coordinates, field_arrays
