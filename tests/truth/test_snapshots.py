"""Snapshots of bodies in two dimensions: stresses, motion and contact pressures against what is known of them."""

from pathlib import Path

import numpy as np
import pytest

import percuss
from blocks import block
from percuss.march.model_of_case import model_of
from percuss.mesh.stresses import stress_field
from percuss.results.fields import von_mises

YOUNG, NU = 3.0, 0.3


def body(**more):
    shape = {"block": {"size": [1.0, 0.4], "elements": [4, 3], "cells": more.pop("cells", "quad4")}}
    return {**shape, "at": [0.0, 0.0], "material": {"young": YOUNG, "density": 1.0, "poisson": NU}, **more}


def stress_of(gradient, plugins=(), **more):
    """Return the stress in the cells of a block whose displacement has a gradient, (cells, 3, 3)."""
    case = {"percuss": 1, "bodies": {"a": body(**more)}, "time": {"courant": 0.5, "steps": 1}}
    only = model_of(percuss.load(case, plugins=plugins)).bodies["a"]
    numbers = np.arange(only.count)
    u = (only.mesh.nodes @ np.transpose(gradient) + [0.7, -0.2])[only.element_nodes(numbers)]
    return stress_field(only, numbers, u[None], np.zeros((1, only.count, only.volumes.shape[1], 0)))[0][0]


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_stress_of_a_gradient_is_that_of_hookes_law(cells, plane):
    gradient = np.array([[2e-3, 5e-4], [-1e-4, -7e-4]])
    strain = np.zeros((3, 3))
    strain[:2, :2] = 0.5 * (gradient + gradient.T)
    if plane == "stress":
        strain[2, 2] = -NU / (1.0 - NU) * np.trace(strain)
    expected = YOUNG / (1.0 + NU) * (strain + NU / (1.0 - 2.0 * NU) * np.trace(strain) * np.eye(3))
    found = stress_of(gradient, plane=plane, cells=cells)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    assert (abs(found[0, 2, 2]) > 1e-4) == (plane == "strain")


@pytest.mark.parametrize("cells", ["quad4", "tri3"])
def test_stress_of_a_body_of_revolution_is_that_of_hookes_law(cells):
    """All points move away from the axis by 0.7 beside the gradient, which alone widens rings by as much as cells."""
    strain, off_axis = np.array([2e-3, -7e-4, 2e-3]), {"plane": "axisymmetric", "cells": cells, "at": [2.0, 0.0]}
    moved = stress_of(np.zeros((2, 2)), **off_axis)
    found = stress_of(np.diag(strain[:2]), **off_axis) - moved
    expected = YOUNG / (1.0 + NU) * (strain + NU / (1.0 - 2.0 * NU) * strain.sum())
    assert np.abs(found - np.diag(expected)).max() < 1e-8 * np.abs(expected).max()
    assert moved[:, 2, 2].min() > YOUNG * 0.7 / 3.0


def test_a_turn_under_large_strains_turns_cauchys_stress():
    material = {"name": "neo-hookean", "young": YOUNG, "density": 1.0, "poisson": NU}
    stretch, (c, s) = np.array([[1.2, 0.1, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.0]]), (np.cos(0.7), np.sin(0.7))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    before, after = (stress_of((motion - np.eye(3))[:2, :2], material=material) for motion in (stretch, turn @ stretch))
    first, second = YOUNG * NU / (1.0 + NU) / (1.0 - 2.0 * NU), 0.5 * YOUNG / (1.0 + NU)
    volume, left = np.linalg.det(stretch), stretch @ stretch.T
    expected = (second * (left - np.eye(3)) + first * np.log(volume) * np.eye(3)) / volume
    assert np.abs(before - expected).max() < 1e-12
    assert np.abs(after - turn @ expected @ turn.T).max() < 1e-12


def test_a_material_that_does_not_say_the_stress_across_has_no_von_mises(tmp_path):
    """It is that of the page."""
    page = (Path(__file__).parents[2] / "plugins" / "SOLID.md").read_text(encoding="utf-8")
    (tmp_path / "soft.py").write_text(page.split("```python\n")[1].split("```")[0], encoding="utf-8")
    material = {"name": "blatz-ko", "shear": 1.0, "density": 1.0}
    found = stress_of(np.array([[0.2, 0.1], [0.0, -0.1]]), [str(tmp_path / "soft.py")], material=material)
    assert np.isfinite(found[:, :2, :2]).all()
    assert np.isnan(von_mises(found)).all()


def test_von_mises_is_that_of_plain_states():
    tension, shear = np.diag([2.0, 0.0, 0.0]), np.array([[0.0, 1.5, 0.0], [1.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert von_mises(np.array([tension, shear, 7.0 * np.eye(3)])) == pytest.approx([2.0, 1.5 * 3**0.5, 0.0])


@pytest.fixture(scope="module", params=["wu-predictor-corrector", "central-difference", "noh-bathe"])
def impact(request, tmp_path_factory):
    """Return the impact of two bars of quadrilaterals, read back from its file."""
    case = {
        "percuss": 1, "bodies": {"left": block(0.0, 0.5, [20, 4]), "right": block(1.0, -0.5, [20, 6], cells="tri3")},
        "contacts": {"tip": {"between": ["left.right", "right.left"]}},
        "method": {"integrator": request.param, "contact": {"name": "penalty", "beta_s": 0.5}, "pairing": "mortar"},
        "time": {"step": 0.005, "steps": 300}, "record": {"fields": 10, "probes": ["left.left"]},
    }  # fmt: skip
    result = percuss.run(percuss.load(case))
    path = tmp_path_factory.mktemp("made") / "made.nc"
    result.save(path)
    read = percuss.open_result(path)
    assert read.fields.identical(result.fields)
    assert read.histories.identical(result.histories)
    return read


def test_snapshots_hold_the_motion_of_the_histories(impact):
    fields, time = impact.field_arrays, impact.arrays["time"]
    rows = [int(np.flatnonzero(np.isclose(time, t))[0]) for t in fields["time"]]
    assert rows == list(range(0, 301, 30))
    ends = np.flatnonzero(fields["node_position"][:, 0] == 0.0)
    shares = np.array([0.125, 0.25, 0.25, 0.25, 0.125])
    for name in ("displacement", "velocity"):
        mean = np.einsum("n,tnd->td", shares, fields[name][:, ends])
        assert np.abs(mean - impact.arrays[name][rows, 0]).max() < 1e-14
    assert fields["cell_nodes"].shape == (20 * 4 + 2 * 20 * 6, 4)
    assert [fields["cell_nodes"][k, 3] >= 0 for k in (0, -1)] == [True, False]
    assert fields["node_body"][0] == "left"
    assert fields["body"][-1] == "right"


def test_pressures_make_up_the_force_and_their_points_the_area(impact):
    fields, arrays = impact.field_arrays, impact.arrays
    force = fields["contact_pressure"] @ fields["point_area"]
    assert np.abs(force - arrays["contact_force"][::30, 0]).max() < 1e-14
    assert force.max() > 0.09
    pressed = (fields["contact_pressure"] != 0.0) @ fields["point_area"]
    assert arrays["contact_area"][::30, 0] == pytest.approx(pressed)
    assert arrays["contact_area"].max() == pytest.approx(0.2)
    assert fields["point_contact"] == ["tip"] * 5
    assert np.array_equal(fields["point_normal"], [[1.0, 0.0]] * 5)
    on_face = np.flatnonzero((fields["node_position"][:, 0] == 1.0) & (np.array(fields["node_body"]) == "left"))
    places = fields["node_position"] + fields["displacement"]
    assert np.abs(fields["point_position"] - places[:, on_face]).max() < 1e-12


def test_stress_behind_the_front_is_that_of_the_exact_solution(impact):
    fields = impact.field_arrays
    middle = (fields["time"] > 0.8) & (fields["time"] < 1.0)
    near = (np.abs(fields["position"][:, 0] - 1.0) < 0.5) & (np.array(fields["body"]) == "left")
    assert fields["stress"][middle][:, near, 0].mean() == pytest.approx(-0.5, rel=0.02)
    assert fields["von_mises"][middle][:, near].mean() == pytest.approx(0.5, rel=0.02)


def test_units_and_dimensions_of_fields(impact):
    fields = impact.fields
    assert fields["stress"].dims == ("time", "element", "stress_component")
    assert list(fields["stress_component"].to_numpy()) == ["xx", "yy", "xy"]
    assert fields["contact_pressure"].dims == ("time", "point")
    assert fields["velocity"].attrs["units"] == "length/time"
    assert fields["point_area"].attrs["units"] == "length^2"
    assert impact.histories["contact_area"].dims == ("time", "contact")
