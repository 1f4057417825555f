"""The table of elements: a strip that bends, a square almost incompressible, a wave of ten cells, Taylor's foot."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import spsolve

import places
from accounts import ran
from percuss import BodyMesh
from percuss.mesh.cell_stiffness import stiffness_of_cells
from percuss.mesh.cells import element_masses, lumping_of, volumes_of
from percuss.mesh.surfaces import surface_of
from percuss.methods.registry import Registry
from solid_figures import FEET, OF_ELEMENTS

REGISTRY = Registry.load()


def made(family, name, **options):
    return REGISTRY.get(family, name)(**options)


def body_of(name, size, counts, poisson):
    """Return element, material and body of a block; in space it is one cell thick."""
    cells = name.partition("-")[0]
    if cells in {"hex8", "tet4"}:
        size, counts = (size[0], size[0] / counts[0], size[1]), (counts[0], 1, counts[1])
    mesh = made("shapes", "block", size=size, elements=counts, cells=cells).mesh(np.zeros(len(size)), 1)
    material = made("materials", "elastic", young=1.0, density=1.0, poisson=poisson)
    return made("elements", name), material, BodyMesh(mesh, 1.0, "strain" if len(size) == 2 else "")


def tip(name, size, counts, poisson):
    """Return how far a uniform shear moves the right end of a block that is held at its left, between rollers."""
    parts = element, _, body = body_of(name, size, counts, poisson)
    x = body.mesh.nodes
    end = surface_of(body, "right", 0, volumes_of(element, body).sum(axis=1))
    free = np.repeat((x[:, 0] > 0.0)[:, None], x.shape[1], axis=1)
    free[:, 1] &= x.shape[1] == 2  # across
    load, moved = np.zeros(x.shape), np.zeros(x.shape)
    load[end.surface.nodes, -1] = size[1] * end.shares * (1.0 if x.shape[1] == 2 else size[0] / counts[0])
    stiffness = stiffness_of_cells(*parts).tocsr()[free.ravel()][:, free.ravel()]
    moved[free] = spsolve(stiffness.tocsc(), load[free])
    return end.shares @ moved[end.surface.nodes, -1]


def wave(name):
    """Return the frequency of a wave along ten cells, which rollers hold across, over the exact one."""
    parts = element, material, body = body_of(name, (10.0, 1.0), (10, 1), 0.3)
    along = np.arange(len(body.mesh.nodes)) * body.mesh.nodes.shape[1]
    masses = lumping_of(element, body).at_nodes(element_masses(element, body, 1.0))
    stiffness = stiffness_of_cells(*parts).tocsr()[along][:, along].toarray()
    exact = 0.2 * np.pi * np.sqrt(material.wave_modulus(body.plane))
    squares, modes = eigh(stiffness, np.diag(masses))
    cosine = masses * np.cos(0.2 * np.pi * body.mesh.nodes[:, 0])
    return np.sqrt(squares[np.abs(cosine @ modes).argmax()]) / exact


@pytest.fixture(scope="module")
def converged():
    """Return the tip of the square on meshes of 32 and of 64 cells a side."""
    return [tip("quad4-mean", (1.0, 1.0), (count, count), 0.4999) for count in (32, 64)]


@pytest.mark.parametrize("name", OF_ELEMENTS)
def test_errors_of_elements_are_those_of_the_page(name, converged):
    """A strip of 10 by 1 against the theory of beams that shear, the square against a mesh eight times as fine."""
    beam = 4.0 * 10.0**3 + 1.2 * 2.0 * 10.0
    assert converged[0] == pytest.approx(converged[1], rel=5e-3)
    found = (
        tip(name, (10.0, 1.0), (20, 4), 0.0) / beam,
        tip(name, (1.0, 1.0), (8, 8), 0.4999) / converged[1],
        wave(name),
    )
    assert 100.0 * (np.array(found) - 1.0) == pytest.approx(OF_ELEMENTS[name][:3], abs=0.06)


@pytest.mark.deep
@pytest.mark.parametrize("name", FEET)
def test_the_foot_of_taylors_bar_is_that_of_the_page(name):
    bar = ran(places.CASES / "taylor-bar.yaml", **{"bodies.bar.element": name, "record.fields": 2, "record.every": 100})
    start, moved = bar.field_arrays["node_position"], bar.field_arrays["displacement"][-1]
    foot = np.isclose(start[:, 1], 0.0)
    assert (start + moved)[foot, 0].max() == pytest.approx(FEET[name], abs=0.006)
