"""Rows of differences against the stiffness added up from cells, and the digits of a body that has moved far."""

import numpy as np
import pytest
from scipy.sparse import block_diag, diags_array
from scipy.sparse.linalg import splu

from blocks import SEAM, alone, block, loaded
from percuss.jit import compiled_function
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.mesh.cell_stiffness import cell_stiffness, stiffness_of_cells
from percuss.mesh.stiffness_rows import compiled_forces, energy_of_rows

KINDS = [
    ("quad4", [5, 4], {}), ("quad4", [5, 4], {"plane": "stress"}), ("quad4-one-point", [5, 4], {}),
    ("tri3", [5, 4], {}), ("hex8", [3, 4, 2], {}), ("hex8-one-point", [3, 4, 2], {}), ("tet4", [3, 4, 2], {}),
]  # fmt: skip
ABOUT_AXIS = [(name, [5, 4], {"plane": "axisymmetric"}) for name in ("quad4-axisymmetric", "tri3-axisymmetric")]
FAR, STRAIN = 1000.0, 1e-3  # lengths of the body, and the strain that it has there


def body_of(element, count, more):
    """A turned block of some cells, about an axis not turned."""
    simplex = element[:4] in {"tri3", "tet4"}
    turned = {} if more.get("plane") == "axisymmetric" else {"angle": 20.0}
    turned |= {"axis": [1.0, 2.0, 0.5]} if len(count) == 3 else {}
    kind = {"cells": element[:4]} if simplex else {}
    body = block([0.3] + [0.0] * (len(count) - 1), 0.0, count, 0.3, **kind, **turned, **more, element=element)
    return model_of(alone(body)).bodies["a"]


def forces_of(body, motion):
    found = np.empty(motion.size)
    compiled_forces(body.mesh.nodes.shape[1])(body.stiffness_rows, motion, found)
    return found


def energy_at(body, motion, velocity, dt):
    """The staggered energy of a body that comes to `motion` in a step."""
    return compiled_function(energy_of_rows)(body.stiffness_rows, forces_of(body, motion), motion, velocity, dt)


@pytest.mark.parametrize(("element", "count", "more"), KINDS + ABOUT_AXIS)
def test_the_forces_are_those_of_the_stiffness_that_is_added_up(element, count, more):
    body = body_of(element, count, more)
    stiffness = stiffness_of_cells(body.spec.element, body.spec.material, body.view)
    motion = np.random.default_rng(1).standard_normal(body.mesh.nodes.size)
    size = np.abs(stiffness @ motion).max()
    assert forces_of(body, motion) == pytest.approx(-(stiffness @ motion), rel=0, abs=4e-15 * size)
    assert np.abs(body.stiffness_matrix() - stiffness).max() <= 4e-15 * np.abs(stiffness).max()


@pytest.mark.parametrize(("element", "count", "more"), KINDS)
def test_a_body_that_has_moved_far_keeps_the_digits_of_forces_and_energy(element, count, more):
    """With K u in place of differences the sum of forces is wrong by 1e-7 of a force there, and the energy by 1e-2."""
    body = body_of(element, count, more)
    nodes, dim = body.mesh.nodes, body.mesh.nodes.shape[1]
    strained = STRAIN * np.random.default_rng(1).standard_normal(nodes.shape)
    moved = np.full(nodes.shape, FAR) + strained
    near, far = forces_of(body, strained.ravel()), forces_of(body, moved.ravel())
    largest = np.abs(near).max()
    # the strain itself is rounded where the body stands: FAR times 2^-53 over the strain
    rounded = FAR * 2.0**-53 / STRAIN
    assert far == pytest.approx(near, rel=0, abs=30.0 * rounded * largest)
    assert np.abs(far.reshape(-1, dim).sum(axis=0)).max() <= 1e-14 * largest
    velocity, dt = np.ones(nodes.size), 1e-3
    energies = [energy_at(body, motion.ravel(), velocity, dt) for motion in (strained, moved)]
    assert energies[1] == pytest.approx(energies[0], rel=30.0 * rounded)


def test_each_linear_solid_marches_by_rows_and_no_other_body():
    case = alone(block([0.0, 0.0], 0.1, [4, 3]))
    march = March(model_of(case))
    assert [type(block.element).__name__ for block, *_ in march.arrays.blocks] == ["StiffnessRows"]


def test_the_stiffest_contact_of_a_large_solid_is_that_of_all_its_nodes(monkeypatch):
    """Only nodes near the surfaces are looked at; the limit is at most 1 % below that of a factor of the whole."""
    bodies = {"left": block([0.0, 0.0], 0.0, [60, 60]), "right": block([1.0, 0.0], 0.0, [60, 60], 0.3)}
    method = {"integrator": "central-difference", "contact": "penalty"}
    model = model_of(loaded(bodies, SEAM, method, {"courant": 0.7, "steps": 1}))
    points, stiffness = model.contact_points, block_diag([body.stiffness_matrix() for body in model.bodies.values()])
    reserve = diags_array(4.0 / model.dt**2 * model.bodies.mass_of_dofs) - stiffness
    rows = points.matrix(model.bodies.n_nodes) @ diags_array(np.sqrt(points.stiffness))
    compliance = rows.T @ splu(reserve.tocsc()).solve(rows.toarray())
    exact = points.stiffness / np.linalg.eigvalsh(compliance)[-1]
    found = model.stiffness_limits(model.dt)
    assert (0.99 * exact < found).all()
    assert (found <= exact).all()
    monkeypatch.setattr("percuss.contact.limits._products", lambda _: 1000)
    assert model_of(model.case).stiffness_limits(model.dt) == pytest.approx(found, rel=1e-12)


@pytest.mark.parametrize(("element", "count", "more"), KINDS + ABOUT_AXIS)
def test_cells_that_are_asked_some_at_a_time_have_the_same_bits(element, count, more, monkeypatch):
    body = body_of(element, count, more)
    monkeypatch.setattr("percuss.mesh.cell_stiffness.ALIKE", body.count + 1)
    cells = body.element_nodes(np.arange(body.count))
    monkeypatch.setattr("percuss.mesh.cell_stiffness.AT_A_TIME", 7 * (cells.shape[1] * len(count)) ** 2)
    in_parts = body_of(element, count, more)
    assert len(list(cell_stiffness(body.spec.element, body.spec.material, body.view))) == -(-body.count // 7)
    for ours, theirs in zip(in_parts.stiffness_rows, body.stiffness_rows, strict=True):
        assert np.array_equal(ours, theirs)
    assert np.array_equal(in_parts.frequency, body.frequency)
