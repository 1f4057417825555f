"""Fields of bodies in two and three dimensions as VTKHDF files, which ParaView and VTK open.

VTKHDF is a layout of HDF5 (docs.vtk.org, "VTKHDF file format", version 2.0), and netCDF4 writes HDF5. The file has one
unstructured grid over time: nodes at their places at the start and cells of all bodies, then each contact point as a
cell of one vertex. The mesh is stored once, and each array in one chunk a snapshot. An array holds nan where it has no
meaning: contact pressures at nodes, stresses at contact points.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from percuss.errors import wrong_input
from percuss.jsonable import Data
from percuss.methods.interfaces import Array, Floats
from percuss.results.fields import component_names
from percuss.results.netcdf import written_whole

SUFFIX = ".vtkhdf"
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
        message = f"expected fields of bodies in two or three dimensions for {SUFFIX}, found none"
        raise wrong_input(str(path), message, "Name it result.nc: NetCDF holds bars too, and results without `fields`.")


def write(path: str | os.PathLike[str], fields: Data) -> None:
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
    with written_whole(path, SUFFIX) as temporary, netCDF4.Dataset(temporary, "w") as file:
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
    stresses = {"von_mises": fields["von_mises"], **{f"stress_{name}": stress[..., i] for i, name in enumerate(names)}}
    data = {name: _padded(values, after=points) for name, values in stresses.items()}
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
