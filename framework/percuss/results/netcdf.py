"""Results as NetCDF-4 files, and fields of bodies in two and three dimensions as VTKHDF files; both are HDF5.

Numbers in NetCDF have checksums that HDF5 compares (Fletcher-32).

VTKHDF is a layout of HDF5 (docs.vtk.org, "VTKHDF file format", version 2.0), and netCDF4 writes HDF5. ParaView and VTK
open it. The file has one unstructured grid over time: nodes at their places at the start and cells of all bodies, then
each contact point as a cell of one vertex. The mesh is stored once, and each array in one chunk a snapshot. An array
holds nan where it has no meaning: contact pressures at nodes, stresses at contact points.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from percuss.case.quantities import FIELD_COORDINATES, QUANTITIES, unit_name
from percuss.errors import wrong_input
from percuss.files import is_file, replacing, unwritten
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import Array, Floats
from percuss.results.fields import component_names

if TYPE_CHECKING:
    import xarray as xr

_STRESSES = "stress_component"
# Axes of histories and of fields after that of time, by what a quantity is of; the stress of bars has one component.
_AXES = {
    "contact": ("contact",),
    "contact state": ("contact", "state_variable"),
    "contact vector": ("contact", "component"),
    "probe": ("probe", "component"),
    "support": ("support", "component"),
    "run": (),
}
_FIELD_AXES = {
    "element": ("element", _STRESSES),
    "probe": ("node", "component"),
    "point": ("point",),
    "point vector": ("point", "component"),
}


class Labelled(NamedTuple):
    """Arrays with the names of their axes and their attributes, before a library makes a dataset or a file of them."""

    variables: Entries  # name: (axes, array, attributes)
    coordinates: Entries
    attributes: Data

    def dataset(self) -> xr.Dataset:
        """Return the dataset of xarray, which is imported here alone: a file is written without it."""
        import xarray as xr

        return xr.Dataset(self.variables, coords=self.coordinates, attrs=dict(self.attributes))


Source = Literal["leap-frog", "multistage", "exact"]  # kind of scheme, or none
_POINTS = "point_contact"  # contact of each contact point
_TIMES = ("time", "time_half")  # a result without steps has no second one


def _variables(arrays: Data, axes: Mapping[str, tuple[str, ...]], source: Source, units: Mapping[str, str]) -> Entries:
    """Return the quantities among arrays with their axes, and label, definition, unit and, for energies, times.

    The label is the ``long_name``, which other programs write at the axes of their pictures. Units have the names in
    `units` where the case gives them, else words as ``force``.
    """
    variables: Entries = {}
    for name in filter(QUANTITIES.__contains__, arrays):
        quantity = QUANTITIES[name]
        special = {"multistage": quantity.definition_multistage, "exact": quantity.definition_exact}.get(source)
        about = {"long_name": quantity.label, "definition": special or quantity.definition}
        about["units"] = unit_name(quantity.unit, units) or quantity.unit
        if quantity.axis == "time_half":
            about["at"] = "time_half"
        variables[name] = (("time", *axes[quantity.of])[: arrays[name].ndim], arrays[name], about)
    return variables


def labelled_histories(
    arrays: Data, coordinates: Mapping[str, list[str]], source: Source, units: Mapping[str, str], attributes: Data
) -> Labelled:
    """Return histories with axes and attributes.

    Parameters
    ----------
    arrays
        Histories by name, among them ``time`` and, if energies belong to other times, ``time_half``.
    coordinates
        Names along the axes ``contact`` and ``probe``, and ``support`` where there are any; of surfaces whose laws have
        state variables the contact of each ``point`` too.
    source, units
        What the histories are of, on which their definitions depend, and the names of units by kind.
    attributes
        Attributes of the whole.
    """
    axes, names = dict(_AXES), {"contact": "contact", "probe": "probe"}
    if "support" in coordinates:
        names["support"] = "support"
    if "point" in coordinates:
        axes["contact state"], names[_POINTS] = ("point", "state_variable"), "point"
    coords: Entries = {name: (("time",), arrays[name], {}) for name in _TIMES if name in arrays}
    coords |= {name: ((axis,), np.array(coordinates[axis], dtype=object), {}) for name, axis in names.items()}
    coords["component"] = (("component",), np.arange(arrays["displacement"].shape[2]), {})
    return Labelled(_variables(arrays, axes, source, units), coords, attributes)


def labelled_fields(field_arrays: Data, source: Source, units: Mapping[str, str]) -> Labelled:
    """Return the fields over time with axes and attributes; none if none were recorded."""
    coords: Entries = {}
    for name in filter(FIELD_COORDINATES.__contains__, field_arrays):
        values, about = field_arrays[name], FIELD_COORDINATES[name]
        array = np.array(values, dtype=object) if isinstance(values, list) else np.asarray(values)
        unit = {"units": unit_name(about["unit"], units) or about["unit"]} if "unit" in about else {}
        coords[name] = (about["axes"], array, {"long_name": about["label"], **unit})
    if "node_position" in field_arrays:
        names = component_names(field_arrays["node_position"].shape[1])
        coords[_STRESSES] = ((_STRESSES,), np.array(names, dtype=object), {})
    return Labelled(_variables(field_arrays, _FIELD_AXES, source, units), coords, {})


FORMAT = "percuss-result-4"  # format 3 had one checksum, at the end of the file
READ = ("percuss-result-3", FORMAT)
ADVICE = "Make the run again, or use an undamaged copy."


def write(path: str | os.PathLike[str], histories: Labelled, fields: Labelled | None) -> None:
    """Write histories, and fields in a group of their own, to a temporary file beside `path`, then rename it.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    UnwrittenError
        If the file cannot be written to its end, as on a full disk.
    """
    import netCDF4

    with written_whole(path, ".nc") as temporary, netCDF4.Dataset(temporary, "w", format="NETCDF4") as file:
        _put_labelled(file, histories)
        if fields is not None:
            _put_labelled(file.createGroup("fields"), fields)


def _put_labelled(group: Any, labelled: Labelled) -> None:
    """Write arrays with their axes, attributes and, of numbers, checksums, as xarray reads them; texts have none."""
    beside = {name: axes for name, (axes, *_) in labelled.coordinates.items() if axes != (name,)}
    named: set[str] = set()  # by a quantity
    for name, (axes, given, about) in {**labelled.coordinates, **labelled.variables}.items():
        values = np.asarray(given)
        for axis, length in zip(axes, values.shape, strict=True):
            if axis not in group.dimensions:
                group.createDimension(axis, length)
        text, missing = values.dtype.kind == "O", np.nan if values.dtype.kind == "f" else None
        kind = str if text else values.dtype
        variable = group.createVariable(name, kind, axes, fletcher32=not text, fill_value=missing)
        of_it = [other for other, others in beside.items() if name in labelled.variables and set(others) <= set(axes)]
        named.update(of_it)
        variable.setncatts(about | ({"coordinates": " ".join(of_it)} if of_it else {}))
        variable[...] = values
    others = " ".join(sorted(beside.keys() - named))
    group.setncatts(dict(labelled.attributes) | ({"coordinates": others} if others else {}))


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
            histories = xr.open_dataset(NetCDF4DataStore(file)).load()
            group = file.groups.get("fields")
            fields = xr.open_dataset(NetCDF4DataStore(group)).load() if group is not None else None
        summary, provenance = (json.loads(histories.attrs.get(name, "{}")) for name in ("summary", "provenance"))
    except Exception as error:  # no NetCDF file, a damaged one, or one that another program put together
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise wrong_input(str(path), f"cannot be read as a percuss result: {reason}", ADVICE) from error
    if (found := histories.attrs.get("format", "no format")) not in READ:
        raise wrong_input(str(path), f"expected a percuss result ({FORMAT}), found {found}", ADVICE)
    arrays = {str(name): values.to_numpy() for name, values in histories.data_vars.items()}
    arrays |= {name: histories[name].to_numpy() for name in _TIMES if name in histories.coords}
    named = ("contact", "probe", *(["support"] if "support" in histories.coords else []))
    coordinates = {axis: [str(name) for name in histories[axis].to_numpy()] for axis in named}
    if _POINTS in histories.coords:
        coordinates["point"] = [str(name) for name in histories[_POINTS].to_numpy()]
    field_arrays: Entries = {}
    if fields is not None:
        for name in map(str, fields.variables):
            values = fields[name].to_numpy()
            field_arrays[name] = [str(word) for word in values] if values.dtype.kind in "OUT" else values
        field_arrays.pop(_STRESSES, None)
    return arrays, coordinates, field_arrays, summary, provenance


# -- fields of solids for ParaView --------------------------------------------------------------------------------

VTKHDF = ".vtkhdf"
VERTEX = 1  # cell type of VTK
# Cell types of VTK by dimensions and corners, whose order is that of percuss.
CELLS = {(2, 3): 5, (2, 4): 9, (3, 4): 10, (3, 8): 12}


def expect_meshes(path: str | os.PathLike[str], *, present: bool) -> None:
    """Refuse a file of fields on meshes where there are none.

    Raises
    ------
    InputError
        If `present` is False.
    """
    if not present:
        message = f"expected fields of bodies in two or three dimensions for {VTKHDF}, found none"
        raise wrong_input(str(path), message, "Name it result.nc: NetCDF holds bars too, and results without `fields`.")


def write_vtkhdf(path: str | os.PathLike[str], fields: Data) -> None:
    """Write fields, `percuss.Result.field_arrays`, to a temporary file beside `path`, then rename it.

    Raises
    ------
    InputError
        If the fields are not those of bodies in two or three dimensions, or there cannot be such a file.
    UnwrittenError
        If the file cannot be written to its end, as on a full disk.
    """
    import netCDF4

    expect_meshes(path, present="cell_nodes" in fields)
    steps, data = fields["time"].size, {"PointData": _point_data(fields), "CellData": _cell_data(fields)}
    with written_whole(path, VTKHDF) as temporary, netCDF4.Dataset(temporary, "w") as file:
        root = file.createGroup("VTKHDF")
        root.setncatts({"Type": "UnstructuredGrid", "Version": np.array([2, 0])})
        for name, values in _grid(fields).items():
            _put(root, name, values)
        of_steps = root.createGroup("Steps")
        of_steps.setncattr("NSteps", steps)
        _put(of_steps, "Values", fields["time"])
        _put(of_steps, "NumberOfParts", np.ones(steps, dtype=np.int64))
        for name in ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets"):
            _put(of_steps, name, np.zeros(steps, dtype=np.int64))
        for group, arrays in data.items():
            of_data, offsets = root.createGroup(group), of_steps.createGroup(f"{group}Offsets")
            for name, values in arrays.items():
                _put(of_data, name, values.reshape(-1, *values.shape[2:]), chunk=values.shape[1:])
                _put(offsets, name, np.arange(steps) * (values.shape[1] if len(values) == steps else 0))


def _put(group: Any, name: str, values: Array, chunk: tuple[int, ...] | None = None) -> None:
    """Write an array, in chunks of a shape.

    The length of each axis has a name in NetCDF, which stands in the file outside of all that VTK reads.
    """
    file = group
    while file.parent is not None:
        file = file.parent
    for length in values.shape:
        if f"of_{length}" not in file.dimensions:
            file.createDimension(f"of_{length}", length)
    group.createVariable(name, values.dtype, [f"of_{n}" for n in values.shape], chunksizes=chunk)[:] = values


def _grid(fields: Data) -> dict[str, Array]:
    """Return the mesh at the start: nodes and cells of the bodies, then the contact points."""
    nodes, cells = np.asarray(fields["node_position"]), np.asarray(fields["cell_nodes"])
    dim, points = nodes.shape[1], _points(fields)
    corners = np.concatenate([(cells >= 0).sum(axis=1), np.ones(points, dtype=np.int64)])
    places = np.concatenate([nodes, fields["point_position"][0]]) if points else nodes
    kinds = [CELLS[dim, count] for count in corners[: len(cells)].tolist()] + [VERTEX] * points
    return {
        "NumberOfPoints": np.array([len(places)]),
        "NumberOfCells": np.array([len(corners)]),
        "NumberOfConnectivityIds": np.array([corners.sum()]),
        "Points": _in_space(places),
        "Connectivity": np.concatenate([cells[cells >= 0], len(nodes) + np.arange(points)]),
        "Offsets": np.concatenate([[0], np.cumsum(corners)]),
        "Types": np.array(kinds, dtype=np.uint8),
    }


def _point_data(fields: Data) -> dict[str, Array]:
    """Return the arrays over nodes and contact points, (snapshots or 1, both, components)."""
    nodes, points = len(fields["node_position"]), _points(fields)
    displacement = np.asarray(fields["displacement"])
    if points:
        place = fields["point_position"]
        displacement = np.concatenate([displacement, place - place[0]], axis=1)
    data = {"displacement": _in_space(displacement), "velocity": _padded(_in_space(fields["velocity"]), after=points)}
    if points:
        of_points = {
            "contact_pressure": fields["contact_pressure"],
            "contact_area": fields["point_area"][None],
            "contact_normal": _in_space(fields["point_normal"][None]),
        }
        data |= {name: _padded(values, before=nodes) for name, values in of_points.items()}
    return data


def _cell_data(fields: Data) -> dict[str, Array]:
    """Return the arrays over cells and contact points, (snapshots or 1, both)."""
    points, stress = _points(fields), np.asarray(fields["stress"])
    names = component_names(np.shape(fields["node_position"])[1])
    of_cells = {name: fields[name] for name in ("von_mises", "volume_ratio", "plastic_strain") if name in fields}
    of_cells |= {f"stress_{name}": stress[..., i] for i, name in enumerate(names)}
    data = {name: _padded(values, after=points) for name, values in of_cells.items()}
    bodies, contacts = (list(dict.fromkeys(fields.get(name, []))) for name in ("node_body", "point_contact"))
    body = [bodies.index(name) for name in fields["body"]] + [-1] * points
    contact = [-1] * len(fields["body"]) + [contacts.index(name) for name in fields.get("point_contact", [])]
    return {"body": np.array([body]), "contact": np.array([contact]), **data}


def _points(fields: Data) -> int:
    return len(fields.get("point_contact", ()))


def _in_space(vectors: Floats) -> Floats:
    """Return vectors with three components, the last one 0 where they have two."""
    return np.pad(vectors, [(0, 0)] * (vectors.ndim - 1) + [(0, 3 - vectors.shape[-1])])


def _padded(values: Floats, *, before: int = 0, after: int = 0) -> Floats:
    """Return an array with nan before or after its second axis."""
    widths = [(0, 0), (before, after), *[(0, 0)] * (values.ndim - 2)]
    return np.pad(values, widths, constant_values=np.nan)
