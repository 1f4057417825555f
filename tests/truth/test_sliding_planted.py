"""Surfaces that slide far, with mistakes planted in the framework: each makes an identity or a bound fail."""

import numpy as np
import pytest
from test_sliding import MEETINGS, SOLID, assert_as_paired, balanced, the_part, two_blocks

import percuss
from percuss.contact import near
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.step.loop import keep
from percuss.step.parts import friction, sliding

renew, search, write = sliding.renew_rows, sliding.search, sliding.write_row


# ------------------------------------------------------------------------------------------------------------ partners


def rows_of_the_last_step(data, n, u, v, a):
    if n % 2 == 0:
        renew(data, n, u, v, a)


def too_few_candidates(data, s):
    """Return how far nodes may move with the neighbours of the nearest facet, and keep this one alone."""
    far = search(data, s)
    squares = [near.place_on(data, f, data.trial) for f in data.candidates[s, : data.candidate_count[s]]]
    data.candidates[s, 0], data.candidate_count[s] = data.candidates[s, int(np.argmin(squares))], 1
    return far


@pytest.mark.parametrize(
    ("kernel", "wrong"),
    [("renew_rows", renew), ("renew_rows", rows_of_the_last_step), ("search", too_few_candidates)],
)
def test_old_rows_and_too_few_candidates_are_seen(monkeypatch, kernel, wrong):
    """A body moves by less than asks for a new search: partners and rows are those that the pairing finds there."""
    monkeypatch.setattr(sliding, kernel, wrong)
    model = model_of(percuss.load(MEETINGS["tetrahedra"]))
    march = March(model, compiled=False)
    data, way = the_part(march), np.zeros((model.bodies.n_nodes, 3))
    way[model.bodies["b"].surface("bottom").surface.nodes] = [-0.1, -0.05, 0.0]
    for n, moved in enumerate((np.zeros(way.size), way.ravel())):
        march.u[:] = moved
        keep(march.arrays.step.boundary, march.u, march.v)
        sliding.renew_rows(data, n, march.u, march.v, march.v)
    if wrong is renew:
        assert_as_paired(model, data, moved)
    else:
        with pytest.raises(AssertionError):
            assert_as_paired(model, data, moved)


# -------------------------------------------------------------------------------------------------- points that return


def thrown_out(data, s, count, gap):
    write(data, s, count, gap - data.offset[s])


@pytest.mark.parametrize("law", ["lagrange", "regularised-lagrange"])
def test_points_that_come_back_are_not_thrown_out(monkeypatch, loop_anew, law):
    """Three nodes of a block turn into the end of another one beside its upper face, and slide under it."""
    case = two_blocks(
        law=law,
        velocity=(-0.6, -0.02),
        at=(0.6, 0.5),
        sizes=((1.0, 0.5), (1.0, 0.5)),
        elements=((5, 2), (5, 2)),
        end=1.6,
    )
    case["bodies"]["upper"]["spin"] = -0.3
    rises = []
    for wrong in (write, thrown_out):
        monkeypatch.setattr(sliding, "write_row", wrong)
        loop_anew()
        result = balanced(percuss.run(percuss.load(case), compiled=False))
        assert any("came back 3 times" in note for note in result.summary["notes"])
        assert result.summary["energy_growth"]["kept"] is True  # the bound holds of any rows
        rises.append((result.arrays["contact_work"] + result.arrays["contact_energy"]).max())
    energy = result.summary["energy"]["initial"]
    assert rises[0] <= 1e-12 * energy
    assert rises[1] > 0.01 * energy


# ------------------------------------------------------------------------------------------------------- elastic slip

turn = friction.turn


def frame_anew(rows, n, u, v, a):
    """Build the tangents from an axis, as those of the start are, and carry the components of slip over."""
    turn(rows, n, u, v, a)
    rows.along[:] = friction.tangents_of(rows.turned)


def frame_that_stays(rows, n, u, v, a):
    rows.turned[:] = rows.points.normal[rows.tangents["point"]]


def turned_about(axis, angle):
    """Return the matrix of a turn."""
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) - np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


@pytest.mark.parametrize(("kernel", "right"), [(turn, True), (frame_anew, False), (frame_that_stays, False)])
def test_elastic_slip_turns_with_its_surfaces(kernel, right):
    """Two bodies turn as one about an axis along their contact: forces and slips along it turn with them."""
    bodies = {
        "a": {"block": {"size": [1, 1, 1], "elements": [2, 2, 1]}, "at": [0, 0, 1]},
        "b": {"block": {"size": [1, 1, 1], "elements": [1, 2, 1]}, "at": [0, 0, 0]},
    }
    seam = {"between": ["a.bottom", "b.top"], "sliding": "large", "friction": {"name": "coulomb", "mu": 0.3}}
    case = {
        "percuss": 1,
        "bodies": {name: body | {"material": SOLID} for name, body in bodies.items()},
        "contacts": {"seam": seam},
        "method": {"contact": "regularised-lagrange", "pairing": "node-to-segment"},
        "time": {"steps": 1, "courant": 0.5},
    }
    model = model_of(percuss.load(case))
    march = March(model, compiled=False)
    (rows,) = (one.data.rows for one in march.arrays.parts if isinstance(one, friction.Frictions))
    rows.slip[:] = np.random.default_rng(3).standard_normal(rows.slip.shape)
    before = np.einsum("jk,jkd->jd", rows.slip, rows.along)
    lengths = np.linalg.norm(rows.slip, axis=1)
    for n, angle in enumerate((0.0, 0.4, 0.9)):
        matrix = turned_about(np.array([0.6, 0.8, 0.0]), angle)
        march.u[:] = (model.bodies.nodes @ (matrix - np.eye(3)).T).ravel()
        keep(march.arrays.step.boundary, march.u, march.v)
        sliding.renew_rows(the_part(march), n, march.u, march.v, march.v)
        kernel(rows, n, march.u, march.v, march.v)
    after = np.einsum("jk,jkd->jd", rows.slip, rows.along)
    assert np.allclose(rows.turned, matrix[:, 2] * np.sign(rows.turned @ matrix[:, 2])[:, None], atol=1e-12)
    assert (np.abs(after - before @ matrix.T).max() < 1e-12 * lengths.max()) == right
