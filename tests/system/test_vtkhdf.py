"""Fields for ParaView: the layout of a VTKHDF file, and what VTK itself reads from it."""

import netCDF4
import numpy as np
import pytest

import percuss
from command_line import refused
from marks import deep
from strategies import hunek

MATERIAL = {"young": 1.0, "density": 1.0, "poisson": 0.3}


def block(size, at, **more):
    speed = [0.1 if at[0] == 0 else -0.1] + [0.0] * (len(size) - 1)
    elements = [3] + [2] * (len(size) - 1)
    return {"block": {"size": size, "elements": elements}, "at": at, "material": MATERIAL, "velocity": speed, **more}


def blocks(size, **more):
    """Two blocks that meet face to face, with the cells of each in other numbers across."""
    left, right = block(size, [0.0] * len(size), **more), block(size, [size[0]] + [0.0] * (len(size) - 1), **more)
    right["block"]["elements"] = [2] + [3] * (len(size) - 1)
    return {"bodies": {"left": left, "right": right}, "contacts": {"seam": {"between": ["left.right", "right.left"]}}}


def cells(name, case):
    for body in case["bodies"].values():
        body["block"]["cells"] = name
    return case


# What each kind of body is made of, and the area or volume of the cells of all bodies.
KINDS = {
    "quad4": (blocks([1.0, 0.5]), "Area", 1.0),
    "tri3": (cells("tri3", blocks([1.0, 0.5])), "Area", 1.0),
    "hex8": (blocks([1.0, 0.5, 0.5]), "Volume", 0.5),
    "tet4": (cells("tet4", blocks([1.0, 0.5, 0.5])), "Volume", 0.5),
}


def result_of(case, **record):
    return percuss.run(
        percuss.load({"percuss": 1, **case, "time": {"end": 1.0, "courant": 0.5}, "record": {"fields": 8, **record}})
    )


# The cells of these kinds are compiled for these tests alone.
LASTING = ("tri3", "tet4", "hex8")


@pytest.fixture(scope="module", params=[deep(kind) if kind in LASTING else kind for kind in KINDS])
def written(request, tmp_path_factory):
    """A result, its file, and the size of its cells."""
    case, measure, size = KINDS[request.param]
    result, path = result_of(case), tmp_path_factory.mktemp("vtk") / f"{request.param}.vtkhdf"
    result.save(path)
    return result, path, measure, size


def test_the_file_has_the_layout_of_vtkhdf(written):
    result, path, _, _ = written
    fields = result.field_arrays
    nodes, points = len(fields["node_position"]), len(fields["point_contact"])
    with netCDF4.Dataset(path) as file:
        root = file["VTKHDF"]
        assert (root.Type, root.Version.tolist()) == ("UnstructuredGrid", [2, 0])
        grid = {name: variable[:].data for name, variable in root.variables.items()}
        assert grid["NumberOfPoints"] == [nodes + points] == [len(grid["Points"])]
        assert grid["NumberOfCells"] == [len(fields["body"]) + points] == [len(grid["Types"])]
        assert grid["NumberOfConnectivityIds"] == [len(grid["Connectivity"])] == grid["Offsets"][-1:]
        steps = len(fields["time"])
        assert root["Steps"].NSteps == steps > 8
        assert root["Steps/Values"][:].tolist() == fields["time"].tolist()
        for kind, count in (("PointData", nodes + points), ("CellData", len(fields["body"]) + points)):
            for name, variable in root[kind].variables.items():
                moving = name not in {"body", "contact", "contact_area", "contact_normal"}
                assert variable.shape[0] == count * (steps if moving else 1)
                assert root[f"Steps/{kind}Offsets/{name}"][:].tolist() == [n * count * moving for n in range(steps)]
                assert variable.chunking()[0] == count


@pytest.mark.deep
def test_vtk_reads_what_the_result_holds(written):
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    result, path, measure, size = written
    fields = result.field_arrays
    nodes, cells, dim = len(fields["node_position"]), len(fields["body"]), fields["node_position"].shape[1]
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    sizes = vtk.vtkCellSizeFilter()
    sizes.SetInputConnection(reader.GetOutputPort())
    for n, time in reversed(list(enumerate(fields["time"]))):
        sizes.UpdateTimeStep(time)
        grid = sizes.GetOutput()
        of_points, of_cells = (
            {data.GetArrayName(i): vtk_to_numpy(data.GetArray(i)) for i in range(data.GetNumberOfArrays())}
            for data in (grid.GetPointData(), grid.GetCellData())
        )
        places = vtk_to_numpy(grid.GetPoints().GetData())
        assert np.array_equal(places[:nodes, :dim], fields["node_position"])
        for name in ("displacement", "velocity"):
            assert np.array_equal(of_points[name][:nodes, :dim], fields[name][n])
        moved = (places + of_points["displacement"])[nodes:, :dim]
        assert moved == pytest.approx(fields["point_position"][n], abs=1e-15)
        assert np.array_equal(of_points["contact_pressure"][nodes:], fields["contact_pressure"][n])
        assert np.isnan(of_points["contact_pressure"][:nodes]).all()
        assert np.array_equal(of_points["contact_area"][nodes:], fields["point_area"])
        assert np.array_equal(of_points["contact_normal"][nodes:, :dim], fields["point_normal"])
        assert np.array_equal(of_cells["von_mises"][:cells], fields["von_mises"][n])
        names = result.fields["stress_component"].to_numpy()
        for i, name in enumerate(names):
            assert np.array_equal(of_cells[f"stress_{name}"][:cells], fields["stress"][n][:, i])
        bodies = list(dict.fromkeys(fields["body"]))
        assert of_cells["body"].tolist() == [bodies.index(name) for name in fields["body"]] + [-1] * (
            len(places) - nodes
        )
        assert of_cells["contact"].tolist() == [-1] * cells + [0] * (len(places) - nodes)
        # The corners stand in the order of VTK: no cell is turned inside out or crossed.
        assert of_cells[measure][:cells].min() > 0.0
        assert of_cells[measure].sum() == pytest.approx(size, rel=1e-12)
    assert fields["contact_pressure"].max() > 0.0


def test_a_body_that_meets_nothing_has_no_contact_points(tmp_path):
    case = {"bodies": {"b": block([1.0, 0.5], [0.0, 0.0])}}
    result_of(case).save(tmp_path / "b.vtkhdf")
    with netCDF4.Dataset(tmp_path / "b.vtkhdf") as file:
        assert set(file["VTKHDF/PointData"].variables) == {"displacement", "velocity"}
        assert set(file["VTKHDF/CellData/contact"][:].tolist()) == {-1}


def test_bars_and_results_without_fields_are_refused(tmp_path):
    import yaml

    (tmp_path / "case.yaml").write_text(yaml.safe_dump(hunek(4, end=0.2)))
    told = refused("run", "case.yaml", "-o", "run.vtkhdf", cwd=tmp_path, plain=True)
    said = "run.vtkhdf: expected fields of bodies in two or three dimensions for .vtkhdf, found none"
    assert told.startswith(said)
    assert not (tmp_path / "run.vtkhdf").exists()
    with pytest.raises(percuss.InputError, match="expected fields of bodies in two or three dimensions"):
        result_of(KINDS["quad4"][0], fields=0).save(tmp_path / "run.vtkhdf")
