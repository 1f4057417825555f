"""Bodies in three dimensions against the bars that they are, spheres of Hertz, and figures of another program."""

import numpy as np
import pytest

import percuss
from blocks import alone, block, impact, loaded, plane_at
from hertz import WHOLE, over_hertz
from marks import deep
from percuss.march.model_of_case import model_of

WU = "wu-predictor-corrector"


def turned(bodies, turn, angle, axis):
    """Return boxes turned as one about the origin."""
    made = {}
    for name, one in bodies.items():
        middle = np.array(one["at"]) + 0.5 * np.array(one["block"]["size"])
        at = turn @ middle - 0.5 * np.array(one["block"]["size"])
        velocity = (turn @ one["velocity"]).tolist()
        made[name] = {**one, "at": at.tolist(), "velocity": velocity, "angle": angle, "axis": axis}
    return made


def keeps_its_accounts(found):
    summary = found.summary
    assert summary["energy"]["ledger_error"] < 2e-14
    assert summary["momentum"]["balanced"]
    assert summary["angular_momentum"]["balanced"]


def test_boxes_that_are_turned_about_an_oblique_axis_have_the_same_forces():
    pair = {"left": block(0.0, 0.5, [10, 2, 3]), "right": block(1.0, -0.5, [10, 3, 5])}
    found = impact(pair, WU, "regularised-lagrange", 0.03, "mortar")
    keeps_its_accounts(found)
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # by 120 degrees about the diagonal
    again = impact(turned(pair, turn, 120.0, [1.0, 1.0, 1.0]), WU, "regularised-lagrange", 0.03, "mortar")
    force = found.arrays["contact_force"]
    assert np.abs(again.arrays["contact_force"] - force).max() < 1e-10 * force.max()


@pytest.mark.parametrize("integrator", ["central-difference", WU])
def test_mortar_between_boxes_of_one_cell_in_thickness_is_that_of_plane_strain(integrator):
    """Rollers hold both sides; the faces have 3 and 4 edges, and the upper box stands out over the lower one."""
    law, forces = {"central-difference": "penalty", WU: "regularised-lagrange"}[integrator], []
    rollers = [{"on": side, "along": "z"} for side in ("bottom", "top")]
    for dim in (2, 3):
        bodies = {
            name: block(at, speed, [8, count, 1][:dim], 0.3, size=[1.0, width, 0.1][:dim], **more)
            for name, at, speed, count, width in (("left", 0.0, 0.3, 3, 0.3), ("right", 1.0, -0.3, 4, 0.42))
            for more in [{"fixed": rollers} if dim == 3 else {"plane": "strain", "thickness": 0.1}]
        }
        for one in bodies.values():
            one["block"]["cells"] = "quad4" if dim == 2 else "hex8"
            one |= {"at": one["at"][:dim], "velocity": one["velocity"][:dim]}
        bodies["right"]["at"][1] = -0.05
        found = impact(bodies, integrator, law, 0.05, "mortar")
        forces.append(found.arrays["contact_force"])
        assert found.summary["certificate"]["stable"] == "yes"
        keeps_its_accounts(found)
    assert forces[0].max() > 1e-3
    assert np.abs(forces[1] - forces[0]).max() < 1e-10 * forces[0].max()


def test_a_box_that_stands_out_over_another_keeps_its_accounts_with_mortar():
    """With dual functions of whole facets a node could have a negative area there."""
    small, large = ((3, 3, 3), (0.6, 0.2, 0.3)), ((3, 4, 5), (0.6, 0.3, 0.35))
    for (left, size), (right, other) in ((small, large), (large, small)):
        bodies = {
            "left": block(0.0, 0.1, left, 0.3, size=size),
            "right": {**block(0.6, -0.1, right, 0.3, size=other), "at": [0.6, 0.05, -0.13]},
        }
        found = impact(bodies, WU, "regularised-lagrange", 0.03, "mortar")
        keeps_its_accounts(found)
        assert found.summary["certificate"]["energy"] == "never grows"
        assert found.summary["energy"]["max"] <= found.summary["energy"]["initial"] * (1.0 + 1e-12)


@pytest.mark.parametrize("cells", ["hex8", "tet4"])
def test_a_body_turns_about_its_axis(cells):
    """Spin about an oblique axis: kinetic energy and momentum of a body that turns about its centre of mass."""
    spin, size = np.array([0.02, -0.01, 0.03]), np.array([1.0, 0.4, 0.6])
    body = block(0.0, 0.0, [10, 4, 6], 0.3, cells, size.tolist(), spin=spin.tolist())
    a = model_of(alone(body)).bodies["a"]
    velocity, arm = a.nodal_velocity, a.mesh.nodes - a.mass @ a.mesh.nodes / a.mass.sum()
    assert velocity == pytest.approx(np.cross(spin, arm), abs=1e-15)
    assert np.abs(a.mass @ velocity).max() < 1e-15
    assert a.mass @ a.mesh.nodes / a.mass.sum() == pytest.approx(size / 2, abs=1e-12)


# ---------------------------------------------------------------------------------------------- balls


def ball(elements, cells, **more):
    """Return a ball of unit radius."""
    material = {"young": 1.0, "density": 1.0, "poisson": 0.3}
    return {"ball": {"radius": 1.0, "elements": elements, "cells": cells, **more}, "material": material}


@pytest.mark.parametrize("cells", ["hex8", "tet4"])
def test_balls_have_the_volume_of_their_polyhedron_and_no_slivers(cells):
    """The volume tends to that of the ball with the second order, and cells stay alike."""
    volumes = []
    for elements in (8, 16):
        a = model_of(alone({**ball(elements, cells), "at": [0, 0, 0]})).bodies["a"]
        volumes.append(a.volumes_of_cells.sum())
        assert a.volumes.min() > 0.1 * a.volumes.max()
        assert a.mass.sum() == pytest.approx(volumes[-1], rel=1e-12)
    errors = 4.0 / 3.0 * np.pi - np.array(volumes)
    assert errors[1] / errors[0] == pytest.approx(0.25, abs=0.02)


@pytest.mark.parametrize("grading", [deep(4.0), 16.0, deep(1 / 16.0)])
def test_graded_balls_keep_the_sphere_and_the_shapes_of_cells(grading):
    """At the lowest point lengths are grading^(1/2) times smaller, in all directions alike."""
    graded, even = (model_of(alone({**ball(16, "hex8", grading=one), "at": [0, 0, 0]})).bodies["a"].mesh
                    for one in (grading, 1.0))  # fmt: skip
    skin = graded.nodes[list(graded.regions["skin"].nodes)]
    assert np.linalg.norm(skin, axis=1) == pytest.approx(1.0, rel=1e-14)
    lowest, cells = int(np.argmin(even.nodes[:, 2])), even.cells["hexahedron"]
    near = np.setdiff1d(cells[(cells == lowest).any(axis=1)], [lowest])
    found, before = (np.linalg.norm(one.nodes[near] - one.nodes[lowest], axis=1) for one in (graded, even))
    assert found / before == pytest.approx(grading**-0.5, rel=0.25)


@pytest.mark.parametrize(("cells", "elements"), [deep("hex8", 24), pytest.param("tet4", 48, marks=pytest.mark.nightly)])
def test_a_ball_on_a_wall_is_within_the_tolerances_of_two_programs(cells, elements):
    """Duration, force at the middle, approach and restitution, as those of the body of revolution (test_disk)."""
    body = {**ball(elements, cells, grading=16.0), "at": [0, 0, 1], "velocity": [0, 0, -0.01]}
    floor = {"floor": {"body": "ball.skin", "wall": plane_at([0, 0, 0], [0, 0, 1])}}
    method = {"integrator": WU, "contact": "lagrange", "pairing": "node-to-segment"}
    case = loaded({"ball": body}, floor, method, {"courant": 0.8, "end": 12.0}, record={"probes": []})
    mass = float(model_of(case).bodies.mass.sum())
    result = percuss.run(case.with_overrides({"bodies.ball.material.density": WHOLE / mass}))
    duration, middle, approach, restitution = over_hertz(result, WHOLE, 0.01, 0.3)
    assert duration == pytest.approx(0.9375, rel=3e-3)
    assert middle == pytest.approx(1.098, rel=7e-3)
    assert approach == pytest.approx(0.9347, rel=2e-3)
    assert restitution == pytest.approx(0.9985, abs=5e-4)
    assert result.summary["energy"]["ledger_closed"]
