"""A disk that falls on a rigid wall, against figures that two programs written apart agree on, and meshes of disks."""

import math
import re
from dataclasses import dataclass

import numpy as np
import pytest

import percuss
from blocks import alone, block, loaded, plane_at
from hertz import WHOLE, hertz, over_hertz
from marks import deep
from percuss import SolidMaterial
from percuss.march.model_of_case import model_of
from percuss.mesh import element_probe
from percuss.mesh.cell_stiffness import frequencies_of_cells, stiffness_of_cells
from percuss_methods.shapes.disk import Disk
from percuss_methods.shapes.half_disk import HalfDisk
from percuss_methods.shapes.ring import Ring
from strategies import with_methods


def fall(shape, speed, time, poisson=0.3, **more):
    """Return a disk, or half of one about the axis of a ball, of unit radius and modulus, that meets a floor."""
    body = {
        "at": [0.0, 1.0], "velocity": [0.0, -speed], "material": {"young": 1.0, "density": 1.0, "poisson": poisson},
        **more,
    }  # fmt: skip
    method = {"integrator": "wu-predictor-corrector", "contact": "lagrange", "pairing": "node-to-segment"}
    floor = {"floor": {"body": "body.skin", "wall": plane_at([0.0, 0.0], [0.0, 1.0])}}
    return loaded({"body": shape | body}, floor, method, {"courant": 0.8, "end": time})


def disk(speed, elements, time, cells="quad4", grading=1.0):
    return fall({"disk": {"radius": 1.0, "elements": elements, "cells": cells, "grading": grading}}, speed, time)


def ball(speed, elements, time, poisson=0.3, cells="quad4", grading=1.0):
    half = {"half-disk": {"radius": 1.0, "elements": elements, "cells": cells, "grading": grading}}
    return fall(half, speed, time, poisson, plane="axisymmetric", fixed=[{"on": "axis", "along": "x"}])


FALLS = {
    1e-3: (8.53, 1.208e-3, 2.702e-3, 0.9827),
    1e-2: (7.04, 0.01404, 0.022295, 0.9847),
    3e-2: (6.40, 0.0466, 0.05867, 0.9817),
}
DEEP = pytest.mark.deep


@pytest.mark.parametrize(
    ("speed", "elements", "grading", "near", "light"),
    [
        (1e-2, 64, 1.0, 5e-3, 5e-4),
        deep(3e-2, 64, 1.0, 5e-3, 5e-4),
        deep(1e-3, 64, 16.0, 3e-3, 3e-3),
        deep(1e-2, 128, 1.0, 3e-3, 2e-4),
        deep(3e-2, 128, 1.0, 3e-3, 2e-4),
        deep(1e-2, 64, 4.0, 3e-3, 1e-3),
        deep(1e-3, 128, 25.0, 1e-3, 1e-3),
    ],
)
def test_a_disk_on_a_wall(speed, elements, grading, near, light):
    """Plane strain, Poisson's ratio .3, radius and density 1: time, force, approach of the centre, restitution.

    The mass of a graded disk is made that of the disk: its polygon has long sides on top.
    """
    time, force, depth, restitution = FALLS[speed]
    case = disk(speed, elements, 1.2 * time, grading=grading)
    mass = float(model_of(case).bodies.mass.sum())
    assert 0.0 < 1.0 - mass / np.pi < light
    if grading > 1.0:
        case, mass = case.with_overrides({"bodies.body.material.density": np.pi / mass}), np.pi
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
    ring = {"ring": {"inner": 1.0, "outer": 2.0, "elements": [24, 3], "cells": cells}, "at": [5.0, 1.0]}
    body = model_of(alone(ring | {"material": {"young": 1.0, "density": 1.0, "poisson": 0.3}})).bodies["a"]
    area = 24 * 0.5 * (4.0 - 1.0) * np.sin(np.pi / 12)
    assert body.mass.sum() == pytest.approx(area, rel=1e-12)
    for region, sign in (("inner", -1.0), ("outer", 1.0)):
        surface = body.surface(region).surface
        middle = surface.positions[surface.facets].mean(axis=1) - [5.0, 1.0]
        assert (sign * (middle * surface.normals).sum(axis=1) > 0.9).all()
    assert angles(Ring(inner=1.0, outer=2.0, elements=(24, 3), cells=cells).mesh(np.zeros(2), 1)).min() > 20.0


def test_a_wall_at_a_point_needs_a_normal_for_a_disk():
    with pytest.raises(percuss.InputError, match=r"expected a wall with a normal, as body\.skin looks to all sides"):
        model_of(disk(1e-2, 8, 1.0).with_overrides({"contacts.floor.wall": [0.0, 0.0]}))
    at = {"contacts.floor.wall": -1.5, "bodies.body.velocity": [-0.01, 0.0]}
    model = model_of(disk(1e-2, 8, 1.0).with_overrides(at))
    assert model.contact_points.normal[0].tolist() == [-1.0, 0.0]


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
def test_compiled_and_plain_kernels_give_cells_the_same_stiffness(cells, monkeypatch):
    """Few cells of unlike shape are asked in plain Python, many of them in compiled code."""
    body = model_of(disk(1e-2, 8, 1.0, cells)).bodies["body"]
    parts = body.spec.element, body.spec.material, body.view
    plain, plain_frequencies = stiffness_of_cells(*parts), frequencies_of_cells(*parts)
    monkeypatch.setattr(element_probe, "MANY", 1)
    monkeypatch.setattr(element_probe, "plain", None)
    assert np.abs(stiffness_of_cells(*parts) - plain).max() <= 1e-13 * np.abs(plain).max()
    assert frequencies_of_cells(*parts) == pytest.approx(plain_frequencies, rel=1e-13)


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
@pytest.mark.parametrize(("elements", "grading"), [(8, 9.0), (16, 36.0), (16, 1 / 36.0), (64, 16.0), (64, 400.0)])
def test_graded_disks_keep_circle_and_angles_and_are_fine_at_one_point(elements, grading, cells):
    shape = Disk(radius=1.0, elements=elements, cells=cells, grading=grading)
    even = Disk(radius=1.0, elements=elements, cells=cells)
    mesh, first = (one.mesh(np.zeros(2), 1) for one in (shape, even))
    found, before = angles(mesh), angles(first)
    assert found.min() > 0.75 * before.min()
    assert found.max() < before.max() + 10.0
    skin = mesh.nodes[list(mesh.regions["skin"].nodes)]
    assert np.linalg.norm(skin, axis=1) == pytest.approx(1.0, rel=1e-14)
    assert np.abs(np.sort(skin[:, 0]) + np.sort(skin[:, 0])[::-1]).max() < 1e-12
    edge = np.linalg.norm(skin - np.roll(skin, 1, axis=0), axis=1)
    middle = 0.5 * (skin + np.roll(skin, 1, axis=0))
    at_bottom, at_top = edge[middle[:, 1].argmin()], edge[middle[:, 1].argmax()]
    whole = 2.0 * np.pi / len(skin)  # an edge of the even mesh, which is curved where it becomes as long as the radius
    assert at_bottom == pytest.approx(whole * grading**-0.5, rel=0.3)
    assert at_top == pytest.approx(2.0 * np.sin(np.arctan(0.5 * whole * grading**0.5)), rel=0.3)
    half = HalfDisk(radius=1.0, elements=elements, cells=cells, grading=grading).mesh(np.zeros(2), 1)
    right = {tuple(node) for node in mesh.nodes.round(12) + 0.0 if node[0] > -1e-12}
    assert {tuple(node) for node in half.nodes.round(12) + 0.0} == right


@pytest.mark.parametrize(
    ("speed", "poisson", "time", "force", "depth", "elements", "grading"),
    [
        (1e-2, 0.3, 0.9375, 1.098, 0.9347, 64, 1.0),
        deep(3e-2, 0.3, 0.916, 1.146, 0.8961, 64, 1.0),
        deep(1e-2, 0.0, 0.954, 1.070, 0.9516, 64, 1.0),
        deep(1e-3, 0.3, 0.9745, 1.035, 0.9754, 64, 16.0),
        deep(1e-3, 0.3, 0.9745, 1.035, 0.9754, 96, 25.0),
    ],
)
def test_a_ball_on_a_wall_over_the_ball_of_hertz(speed, poisson, time, force, depth, elements, grading):
    """Ratios of two programs written apart to the quasi-static ball: duration, force at the middle, approach."""
    case = ball(speed, elements, 1.1 * hertz(speed, poisson)[0], poisson, grading=grading)
    mass = float(model_of(case).bodies.mass.sum())
    assert mass == pytest.approx(WHOLE, rel=4e-3 if grading > 1.0 else 1e-3)
    if grading > 1.0:
        case, mass = case.with_overrides({"bodies.body.material.density": WHOLE / mass}), WHOLE
    result = percuss.run(case)
    duration, middle, approach, _ = over_hertz(result, mass, speed, poisson)
    assert duration == pytest.approx(time, rel=3e-3 if grading > 1.0 else 5e-3)
    assert middle == pytest.approx(force, rel=7e-3)
    assert approach == pytest.approx(depth, rel=2e-3)
    assert result.summary["energy"]["ledger_closed"]
    assert result.summary["momentum"]["balanced"]


@pytest.mark.deep
def test_a_ball_of_triangles_is_near_that_of_quadrilaterals():
    forces = [percuss.run(ball(1e-2, 48, 6.0, 0.3, cells)).arrays["contact_force"].max() for cells in ("quad4", "tri3")]
    assert forces[1] == pytest.approx(forces[0], rel=0.02)


def test_uniform_pressure_on_a_cylinder_is_hydrostatic():
    """Under pressure on all sides the static displacement is u = -p (1 - 2 nu) / E x: a trap of coupled hoop strain."""
    pressure, poisson = 0.01, 0.3
    rollers = [{"on": "left", "along": "x"}]
    body = block(0.0, 0.0, [5, 5], poisson, size=[1.0, 1.0], plane="axisymmetric", fixed=rollers)
    load = {"constant": pressure, "on": ["a.right", "a.top", "a.bottom"], "as": "pressure"}
    model = model_of(alone(body, loads={"p": load}))
    force = np.zeros((model.bodies.n_nodes, 2))
    for one in model.loads.nodal_forces:
        force[one.node] += pressure * one.force
    nodes = model.bodies["a"].mesh.nodes
    displacement = -pressure * (1.0 - 2.0 * poisson) * nodes
    inner = (model.bodies["a"].stiffness_matrix() @ displacement.ravel()).reshape(-1, 2)
    free = nodes[:, 0] > 0.0
    assert np.abs((inner - force)[free]).max() < 1e-12 * np.abs(force).max()
    assert np.abs((inner - force)[:, 1]).max() < 1e-12 * np.abs(force).max()


def about_the_axis(contacts=None, **more):
    """Return a case of one cylinder of 4 by 4 cells."""
    body = block(0.0, [0.0, -1.0], [4, 4], size=[1.0, 1.0], plane="axisymmetric")
    return loaded({"a": body}, contacts, time={"courant": 0.5, "end": 0.5}, **more)


def test_the_axis_of_revolution_moves_with_its_body_and_takes_a_force():
    run = percuss.run(about_the_axis(record={"probes": ["a.left", "a.right"]}))
    fallen = run.arrays["displacement"][-1, :, 1]
    assert np.abs(fallen + run.arrays["time"][-1]).max() < 1e-12
    model = model_of(about_the_axis(loads={"push": {"constant": 1.0, "on": "a.left", "direction": [0.0, 1.0]}}))
    assert sum(one.force for one in model.loads.nodal_forces) == pytest.approx([0.0, 1.0], rel=1e-14)
    assert {model.bodies["a"].mesh.nodes[one.node, 0] for one in model.loads.nodal_forces} == {0.0}


@dataclass(frozen=True)
class Brittle(SolidMaterial):
    """A material without a stress beyond a strain of 0.01. Formula: ``s = e``."""

    name = "brittle"
    summary = "no stress beyond a strain"
    linear = False
    rho = 1.0

    def solid_parameters(self, plane):
        return ()

    def wave_modulus(self, plane):
        return 1.0

    @staticmethod
    def stress_2d(parameters, gradient):
        along, shear = gradient[0] if abs(gradient[0]) <= 0.01 else math.nan, 0.5 * (gradient[1] + gradient[2])
        return along, shear, shear, gradient[3]

    @staticmethod
    def stored_2d(parameters, gradient):
        return 0.5 * (gradient[0] ** 2 + gradient[3] ** 2) + 0.25 * (gradient[1] + gradient[2]) ** 2


@pytest.mark.deep
def test_a_material_without_a_number_in_a_run_is_named():
    body = block(0.0, 0.5, [10, 2]) | {"material": "brittle"}
    time = {"courant": 0.5, "end": 1.0}
    case = alone(body, 1.05, time=time, registry=with_methods(Brittle))
    with pytest.raises(percuss.RunError, match=r"material brittle: the stress is nan, .* at the strain") as stopped:
        percuss.run(case)
    assert re.search(r"likely cause: the kernel at .*test_disk\.py:\d+ has no value there", str(stopped.value))
