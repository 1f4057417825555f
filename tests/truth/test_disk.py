"""A disk that falls on a rigid wall, against figures that two programs written apart agree on, and meshes of disks."""

import numpy as np
import pytest

import percuss
from percuss.march.model import Model
from percuss.mesh import cell_stiffness
from percuss.mesh.cell_stiffness import frequencies_of_cells, stiffness_of_cells
from percuss_methods.shapes.disk import Disk
from percuss_methods.shapes.ring import Ring


def fall(speed, elements, time, cells="quad4", **method):
    method = {"integrator": "wu-predictor-corrector", "contact": "lagrange", "pairing": "node-to-segment", **method}
    return percuss.load({
        "percuss": 1,
        "bodies": {"disk": {
            "disk": {"radius": 1.0, "elements": elements, "cells": cells}, "at": [0.0, 1.0], "velocity": [0.0, -speed],
            "material": {"young": 1.0, "density": 1.0, "poisson": 0.3},
        }},
        "contacts": {"floor": {"body": "disk.skin", "wall": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}},
        "method": method, "time": {"courant": 0.8, "end": time},
    })  # fmt: skip


@pytest.mark.parametrize(
    ("speed", "time", "force", "depth", "restitution"),
    [(1e-2, 7.04, 0.01404, 0.022295, 0.9847), (3e-2, 6.40, 0.0466, 0.05867, 0.9817)],
)
@pytest.mark.parametrize(("elements", "near"), [(64, 5e-3), pytest.param(128, 3e-3, marks=pytest.mark.deep)])
def test_a_disk_on_a_wall(speed, time, force, depth, restitution, elements, near):
    """Plane strain, Poisson's ratio .3, radius and density 1: time, force, approach of the centre, restitution."""
    case = fall(speed, elements, 1.2 * time)
    mass = float(Model(case).bodies.mass.sum())
    result = percuss.run(case)
    contact, pressing = result.summary["contacts"]["floor"], result.arrays["contact_force"][:, 0]
    steps = np.diff(result.arrays["time"], append=result.arrays["time"][-1])
    speeds = -speed + np.cumsum(pressing * steps) / mass
    assert contact["last_open"] - contact["first_closed"] == pytest.approx(time, rel=3e-3)
    assert contact["peak_force"] == pytest.approx(force, rel=1e-2)
    assert -np.cumsum(speeds * steps).min() == pytest.approx(depth, rel=near)
    assert contact["impulse"] / mass / speed - 1.0 == pytest.approx(restitution, abs=2e-3)
    assert result.summary["energy"]["ledger_closed"]
    assert result.summary["energy"]["max"] <= result.summary["energy"]["initial"] * (1.0 + 1e-12)


def test_a_disk_of_triangles_is_near_that_of_quadrilaterals():
    forces = [
        percuss.run(fall(1e-2, 32, 8.5, cells)).summary["contacts"]["floor"]["peak_force"]
        for cells in ("quad4", "tri3")
    ]
    assert forces[1] == pytest.approx(forces[0], rel=0.02)


def test_a_disk_at_a_wall_does_not_know_directions():
    """Mirrored and turned: a wall on the left, above, below; each the same force to round-off."""
    forces = []
    for axis, side in ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)):
        normal, at = np.zeros(2), np.zeros(2)
        normal[axis] = side
        case = fall(1e-2, 16, 8.0)
        case = case.with_overrides({
            "bodies.disk.velocity": (-0.01 * normal).tolist(), "bodies.disk.at": (at + normal).tolist(),
            "contacts.floor.wall": {"point": [0.0, 0.0], "normal": normal.tolist()},
        })  # fmt: skip
        forces.append(percuss.run(case).arrays["contact_force"])
    for other in forces[1:]:
        assert np.abs(other - forces[0]).max() < 1e-9 * forces[0].max()


def angles(mesh):
    """Return the angles of all cells [degrees]."""
    ((_, cells),) = mesh.cells.items()
    corners = mesh.nodes[cells]
    before, after = np.roll(corners, 1, axis=1) - corners, np.roll(corners, -1, axis=1) - corners
    turn = after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]
    return np.degrees(np.arctan2(turn, (after * before).sum(axis=-1)))


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
@pytest.mark.parametrize("elements", [4, 6, 8, 9, 16, 33, 64])
def test_disks_have_no_slivers_and_the_area_of_their_polygon(elements, cells):
    shape = Disk(radius=2.0, elements=elements, cells=cells)
    mesh = shape.mesh(np.array([1.0, -3.0]), 1)
    assert shape.element_count(1) == len(next(iter(mesh.cells.values())))
    found = angles(mesh)
    assert found.min() > (35.0 if cells == "quad4" else 18.0)
    assert found.max() < 160.0
    skin = mesh.nodes[list(mesh.regions["skin"].nodes)] - [1.0, -3.0]
    assert np.linalg.norm(skin, axis=1) == pytest.approx(2.0, rel=1e-14)
    x, y = skin.T
    polygon = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    count = len(skin)
    assert polygon == pytest.approx(count * 0.5 * 4.0 * np.sin(2.0 * np.pi / count), rel=1e-12)
    assert mesh.nodes.mean(axis=0) == pytest.approx([1.0, -3.0], abs=1e-12)


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
def test_rings_look_inward_and_outward(cells):
    case = percuss.load({
        "percuss": 1, "time": {"courant": 0.5, "steps": 1},
        "bodies": {"r": {"ring": {"inner": 1.0, "outer": 2.0, "elements": [24, 3], "cells": cells}, "at": [5.0, 1.0],
                         "material": {"young": 1.0, "density": 1.0, "poisson": 0.3}}},
    })  # fmt: skip
    body = Model(case).bodies["r"]
    area = 24 * 0.5 * (4.0 - 1.0) * np.sin(np.pi / 12)
    assert body.mass.sum() == pytest.approx(area, rel=1e-12)
    for region, sign in (("inner", -1.0), ("outer", 1.0)):
        surface = body.surface(region).surface
        middle = surface.positions[surface.facets].mean(axis=1) - [5.0, 1.0]
        assert (sign * (middle * surface.normals).sum(axis=1) > 0.9).all()
    assert angles(Ring(inner=1.0, outer=2.0, elements=(24, 3), cells=cells).mesh(np.zeros(2), 1)).min() > 20.0


def test_a_wall_at_a_point_needs_a_normal_for_a_disk():
    with pytest.raises(percuss.InputError, match=r"expected a wall with a normal, as disk\.skin looks to all sides"):
        Model(fall(1e-2, 8, 1.0).with_overrides({"contacts.floor.wall": [0.0, 0.0]}))
    at = {"contacts.floor.wall": -1.5, "bodies.disk.velocity": [-0.01, 0.0]}
    model = Model(fall(1e-2, 8, 1.0).with_overrides(at))
    assert model.contact_points[0].normal.tolist() == [-1.0, 0.0]


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
def test_compiled_and_plain_kernels_give_cells_the_same_stiffness(cells, monkeypatch):
    """Few cells of unlike shape are asked in plain Python, many of them in compiled code."""
    body = Model(fall(1e-2, 8, 1.0, cells)).bodies["disk"]
    parts = body.spec.element, body.spec.material, body.view
    plain, plain_frequencies = stiffness_of_cells(*parts), frequencies_of_cells(*parts)
    monkeypatch.setattr(cell_stiffness, "MANY", 1)
    monkeypatch.setattr(cell_stiffness, "ElementProbe", None)
    assert np.abs(stiffness_of_cells(*parts) - plain).max() <= 1e-13 * np.abs(plain).max()
    assert frequencies_of_cells(*parts) == pytest.approx(plain_frequencies, rel=1e-13)
