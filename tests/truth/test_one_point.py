"""Cells with one point and hourglass control, against a dense form of it, the theory of beams, and bars."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

import percuss
from blocks import alone, block
from marks import deep
from percuss import BodyMesh
from percuss.mesh.cell_stiffness import stiffness_of_cells
from percuss.mesh.element_probe import ElementProbe
from percuss.methods.registry import Registry
from percuss.testing.demands.bodies import patch

YOUNG, POISSON = 1.0, 0.3
SHEAR, FIRST = YOUNG / 2.6, YOUNG * POISSON / (1.3 * 0.4)


def made(family, name, **options):
    return Registry.load().get(family, name)(**options)


def body_of(mesh, poisson=POISSON, name=None, **options):
    dim = mesh.nodes.shape[1]
    element = made("elements", name or ("quad4-one-point", "hex8-one-point")[dim - 2], **options)
    material = made("materials", "elastic", young=YOUNG, density=1.0, poisson=poisson)
    return element, material, BodyMesh(mesh, 1.0, "strain" if dim == 2 else "")


def grid(counts, size):
    shape = made("shapes", "block", size=size, elements=counts)
    return shape.mesh(np.zeros(len(counts)), 1)


def centre_rule(corners):
    """Return the stiffness of the mean strain, and the hourglass vectors with the squares of the slopes, of a cell."""
    nodes, dim = corners.shape
    signs = np.where(corners > np.median(corners, axis=0), 1.0, -1.0)  # of a cell near a box with sides along the axes
    points = signs / np.sqrt(3.0)
    volume, mean = 0.0, np.zeros((nodes, dim))
    for point in points:
        factors = 1.0 + point * signs
        slopes = np.stack([
            signs[:, d] * np.prod(np.delete(factors, d, axis=1), axis=1) / nodes for d in range(dim)
        ], axis=1)  # fmt: skip
        jacobian = corners.T @ slopes
        weight = np.linalg.det(jacobian)
        volume, mean = volume + weight, mean + weight * slopes @ np.linalg.inv(jacobian)
    mean /= volume
    pairs = [(0, 1)] if dim == 2 else [(1, 2), (2, 0), (0, 1), (0, 1, 2)]
    modes = np.array([np.prod(signs[:, list(pair)], axis=1) for pair in pairs])
    return volume, mean, (modes - modes @ corners @ mean.T) / nodes


@pytest.mark.parametrize("cell", ["quad", "hexahedron"])
def test_the_stiffness_is_that_of_the_mean_strain_and_of_the_dense_hourglass_form(cell):
    mesh = patch(cell, Registry.load())
    element, material, body = body_of(mesh, hourglass=0.07)
    count, dim = mesh.nodes.shape
    expected = np.zeros((count * dim, count * dim))
    for nodes in mesh.cells[cell]:
        volume, mean, vectors = centre_rule(mesh.nodes[nodes])
        own = np.zeros((nodes.size * dim, nodes.size * dim))
        for one in range(dim):
            for other in range(dim):
                block = FIRST * np.outer(mean[:, one], mean[:, other]) + SHEAR * np.outer(mean[:, other], mean[:, one])
                if one == other:
                    block = block + SHEAR * mean @ mean.T + 4.0 * 0.07 * SHEAR * (mean**2).sum() * vectors.T @ vectors
                own[one::dim, other::dim] = volume * block
        place = (nodes[:, None] * dim + np.arange(dim)).ravel()
        expected[np.ix_(place, place)] += own
    found = stiffness_of_cells(element, material, body).toarray()
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def bent(name, along, across, poisson=0.0):
    """Return the deflection of a slender beam over that of Euler and Bernoulli."""
    length, height, flat = 20.0, 1.0, name.startswith("quad")
    counts, size = ((along, across), (length, height)) if flat else ((along, 1, across), (length, 0.5, height))
    mesh = grid(counts, size)
    stiffness = stiffness_of_cells(*body_of(mesh, poisson=poisson, name=name)).tocsr()
    count, dim = mesh.nodes.shape
    free, tip = (mesh.nodes[:, 0] > 1e-9).repeat(dim), mesh.nodes[:, 0] > length - 1e-9
    load, moved = np.zeros((count, dim)), np.zeros(count * dim)
    load[tip, -1] = 1e-3 / tip.sum()
    moved[free] = spsolve(stiffness[free][:, free].tocsc(), load.ravel()[free])
    modulus, width = (YOUNG / (1.0 - poisson**2), 1.0) if flat else (YOUNG, 0.5)
    expected = 1e-3 * length**3 / (3.0 * modulus * width * height**3 / 12.0)
    return moved.reshape(count, dim)[tip, -1].mean() / expected


@pytest.mark.parametrize(("full", "one_point"), [("quad4", "quad4-one-point"), ("hex8", "hex8-one-point")])
def test_a_slender_beam_bends_as_that_of_euler_and_bernoulli(full, one_point):
    """Long cells of the full rule lock, those of one point less; one cell across is held by hourglass control alone."""
    assert bent(full, 20, 4) < 0.7
    assert 0.93 < bent(one_point, 20, 4) < 1.07
    assert bent(full, 5, 1) < 0.12
    assert bent(one_point, 5, 1) > 2.5 * bent(full, 5, 1)


@pytest.mark.parametrize(("full", "one_point"), [("quad4", "quad4-one-point"), ("hex8", "hex8-one-point")])
def test_an_almost_incompressible_beam_bends_with_one_point_and_locks_with_the_full_rule(full, one_point):
    """With fine cells along it both bend as a beam if the material is compressible."""
    assert bent(full, 80, 4, 0.3) > 0.9
    assert bent(full, 80, 4, 0.4999) < 0.5
    assert 0.9 < bent(one_point, 80, 4, 0.4999) < 1.1


def pushed(elements, **record):
    """Return the run of a block that is held on its left, and pushed across on its right."""
    dim = len(elements)
    element = ("quad4-one-point", "hex8-one-point")[dim - 2]
    body = block(0.0, 0.0, elements, POISSON, size=[1.0, 0.2, 0.2][:dim], fixed=["left"], element=element)
    load = {"ramp": {"value": 1e-4, "duration": 1.0}, "on": "a.right", "as": "force", "direction": [0, 1, 0][:dim]}
    return percuss.run(alone(body, loads={"push": load}, record=record, time={"steps": 200, "courant": 0.8}))


@pytest.mark.parametrize("elements", [[6, 2], deep([5, 2, 2])])
def test_hourglass_energy_is_that_of_the_dense_form(elements):
    """It is part of the elastic energy, in space by the lengths before and after a step, and the ledger closes."""
    result = pushed(elements, fields=200)
    fields, held = result.fields, np.zeros(200)
    u = fields["displacement"].values
    for nodes in fields["cell_nodes"].values:
        volume, mean, vectors = centre_rule(fields["node_position"].values[nodes])
        q = np.einsum("ma,tai->tmi", vectors, u[:, nodes])
        length = np.linalg.norm(q, axis=2)
        both = (q[:-1] * q[1:]).sum(axis=(1, 2)) if len(elements) == 2 else (length[:-1] * length[1:]).sum(axis=1)
        held += 2.0 * 0.05 * SHEAR * volume * (mean**2).sum() * both
    found = result.arrays["hourglass_energy"][:200]
    assert np.abs(found - held).max() < 1e-9 * held.max()
    assert 0.0 < held.max() < result.arrays["elastic_energy"].max()
    assert result.summary["energy"]["ledger_error"] < 1e-12


@pytest.mark.parametrize(("elements", "told"), [([8, 1], True), ([24, 6], False)])
def test_a_large_share_of_hourglass_energy_is_told(elements, told):
    result = pushed(elements)
    energy = result.arrays
    assert (energy["hourglass_energy"].max() > 0.05 * energy["elastic_energy"].max()) is np.bool_(told)
    assert any("hourglass control holds up to" in note for note in result.summary["notes"]) is told


@pytest.mark.parametrize("steps", [1, 3, 100])
def test_round_off_of_a_body_in_free_flight_is_no_hourglass_energy(steps):
    """Elastic energy, of which it is part, may then be exactly zero."""
    body = block([0.5, 0.5], [0.03, 0.0], [6, 6], POISSON, size=[0.7, 0.7], element="quad4-one-point")
    assert percuss.run(alone(body, time={"steps": steps, "courant": 0.5})).summary["notes"] == []


@pytest.mark.parametrize("cell", ["quad", "hexahedron"])
def test_hourglass_modes_have_no_stress(cell):
    element, material, body = body_of(patch(cell, Registry.load()))
    corners = body.mesh.nodes[body.mesh.cells[cell][0]]
    _, mean, vectors = centre_rule(corners)
    assert np.abs(vectors @ corners).max() < 1e-14  # linear displacements are no hourglass
    pure = vectors[0] - mean @ np.linalg.solve(mean.T @ mean, mean.T @ vectors[0])  # it has no mean strain
    probe = ElementProbe(element, material, body)
    stretched = 1e-3 * corners * np.eye(corners.shape[1])[0]
    for hourglass in (0.0, 1e-3):
        stress = probe.stresses(np.array([0]), (stretched + hourglass * pure[:, None])[None, None])[0, 0]
        assert stress[0, 0] == pytest.approx(1e-3 * (FIRST + 2.0 * SHEAR), rel=1e-12)
        assert stress[1, 1] == pytest.approx(1e-3 * FIRST, rel=1e-12)
        assert abs(stress[0, 1]) < 1e-15
