"""The criterion of the sparse operator on a lattice in two dimensions, against full matrices."""

import itertools

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

from percuss.certificate.closed_laws import ClosedLaws
from percuss.certificate.linear_laws import LinearLaws
from percuss.certificate.operator import Operator, limiting_rows

NX, NY = 4, 3
STIFF = 12.0  # of a spring


def block(held_right, ny=NY):
    """Return K, the masses, and N of points on the left side with their shares of it, as full matrices.

    The block is a lattice of springs that couple both directions. Its points lie between nodes, so that each has rows
    at two nodes, in the direction of the wall.
    """
    counts = NX + 1, ny + 1
    along, up = (np.diff(np.eye(count), axis=0) for count in counts)
    both = STIFF * np.array([[1.0, 0.3], [0.3, 0.5]])
    stiffness = np.kron(np.kron(along.T @ along, np.eye(ny + 1)), both)
    stiffness += np.kron(np.kron(np.eye(NX + 1), up.T @ up), both[::-1, ::-1])
    halves = (np.convolve(np.ones(count - 1), [0.5, 0.5]) for count in counts)
    mass = np.kron(np.kron(*halves), [0.125, 0.125])
    normals = np.zeros((mass.size, 2 * ny))
    for p, (j, share) in enumerate(itertools.product(range(ny), (0.21, 0.79))):
        normals[[2 * j, 2 * j + 2], p] = 1.0 - share, share
    moving = slice(0, -2 * (ny + 1) if held_right else None)
    return stiffness[moving, moving], mass[moving], normals[moving], np.full(2 * ny, 0.5)


def laws(stiffness, inertia, predicted):
    count = stiffness.size
    share = np.divide(inertia, stiffness)
    return lambda dt: ClosedLaws(
        stiffness, inertia, np.full(count, predicted), share - dt * dt if predicted else np.full(count, np.nan),
        1.0 / stiffness, (), "", "",
    )  # fmt: skip


def criterion(matrices, stiffness, inertia, *, predicted=False, coupled=None):
    """The criterion of a block; `coupled` is M^-1 as a full matrix, of which C K C and C N are given."""
    bulk, mass, normals, _ = matrices
    if coupled is None:
        parts, inverse = (bulk, np.diag(mass), normals), np.diag(1.0 / mass)
    else:
        parts, inverse = (coupled @ bulk @ coupled, coupled, coupled @ normals), coupled
    delassus = normals.T @ inverse @ normals
    operator = Operator(*map(scipy.sparse.csc_array, parts))
    return LinearLaws(operator, scipy.sparse.csr_array(delassus), laws(stiffness, inertia, predicted))


def highest(stiffness, mass):
    return scipy.linalg.eigh(stiffness, mass, eigvals_only=True)[-1]


@pytest.mark.parametrize("held", [False, True])
def test_the_free_step_is_that_of_the_full_matrices(held):
    matrices = block(held)
    found = criterion(matrices, np.ones(2 * NY), np.zeros(2 * NY)).free
    assert found == pytest.approx(2.0 / np.sqrt(highest(matrices[0], np.diag(matrices[1]))), rel=1e-10)


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("beta", [0.5, 3.0, 40.0])
def test_the_critical_step_of_a_penalty_is_that_of_the_full_matrices(beta, held):
    matrices = bulk, mass, normals, lengths = block(held)
    stiffness = beta * STIFF * lengths
    found = criterion(matrices, stiffness, np.zeros_like(stiffness))
    expected = 2.0 / np.sqrt(highest(bulk + normals @ np.diag(stiffness) @ normals.T, np.diag(mass)))
    assert found.critical_step == pytest.approx(expected, rel=1e-9)
    assert expected < 0.999 * found.free or beta < 1.0
    below, above = (found.assess_step(share * expected) for share in (1.0 - 1e-8, 1.0 + 1e-8))
    assert (below.answer, above.answer) == ("stable", "grows")
    if above.worst:  # they suffice
        some = normals[:, above.worst]
        with_these = highest(bulk + some @ np.diag(stiffness[above.worst]) @ some.T, np.diag(mass))
        assert 2.0 / np.sqrt(with_these) < (1.0 + 1e-8) * expected


def test_an_inertia_of_contacts_counts_with_the_mass():
    """All contacts are closed in the worst set, as their eps_s / eps_m is above the highest frequency squared."""
    matrices = bulk, mass, normals, lengths = block(True)
    stiffness = 40.0 * STIFF * lengths
    inertia = stiffness / (4.0 * highest(bulk, np.diag(mass)))
    found = criterion(matrices, stiffness, inertia)
    closed = normals @ np.diag(stiffness) @ normals.T, normals @ np.diag(inertia) @ normals.T
    expected = 2.0 / np.sqrt(highest(bulk + closed[0], np.diag(mass) + closed[1]))
    assert expected < 0.99 * found.free
    assert found.critical_step == pytest.approx(expected, rel=1e-9)


def test_a_mass_that_couples_nodes_is_given_by_its_inverse():
    matrices = bulk, mass, normals, lengths = block(False)
    rng = np.random.default_rng(3)
    root = np.diag(1.0 / np.sqrt(mass)) + 0.02 * np.diag(rng.uniform(size=mass.size - 2), 2)
    coupled = root @ root.T
    stiffness = 10.0 * STIFF * lengths
    found = criterion(matrices, stiffness, np.zeros_like(stiffness), coupled=coupled)
    full = np.linalg.inv(coupled)
    expected = 2.0 / np.sqrt(highest(bulk + normals @ np.diag(stiffness) @ normals.T, 0.5 * (full + full.T)))
    assert found.critical_step == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("rows_of_squares", [NY, 20])
@pytest.mark.parametrize("ratio", [0.0, 0.3])
def test_at_the_predicted_gap_the_step_ends_where_theta_is_one(ratio, rows_of_squares):
    matrices = _, mass, normals, lengths = block(False, rows_of_squares)
    stiffness = 40.0 * STIFF * lengths
    found = criterion(matrices, stiffness, ratio * 0.01 * stiffness, predicted=True)
    delassus = normals.T @ np.diag(1.0 / mass) @ normals
    largest = np.linalg.eigvals(
        np.linalg.solve(np.eye(lengths.size) + 0.01 * ratio * delassus * stiffness, delassus * stiffness)
    ).real.max()
    assert found.assess_step(0.01).theta == pytest.approx(0.01**2 * largest, rel=1e-10)
    assert found.critical_step == pytest.approx(min(1.0 / np.sqrt(largest), found.free), rel=1e-9)


def test_a_factor_proves_what_it_says():
    bulk, mass, normals, _ = block(False)
    operator = Operator(*map(scipy.sparse.csc_array, (bulk, np.diag(mass), normals)))
    squared = highest(bulk, np.diag(mass))
    assert operator.factor(squared * (1.0 + 1e-9)) is not None
    assert operator.factor(squared * (1.0 - 1e-9)) is None
    assert operator.factor(0.5 * squared) is None


def test_an_unstable_set_keeps_what_it_cannot_spare():
    matrix = np.diag([0.9, 0.6, 0.3, 0.6, 0.5])
    matrix[1, 3] = matrix[3, 1] = 0.7  # 1.3 of the two together
    matrix[0, 4] = matrix[4, 0] = 0.1  # 0.92
    assert limiting_rows(matrix) == [1, 3]
    assert limiting_rows(np.diag([0.5, 1.1, 0.2])) == [1]


@pytest.mark.parametrize("blocks", [1, 3])
def test_a_banded_operator_has_the_numbers_of_full_matrices_in_any_order(blocks):
    rng = np.random.default_rng(5)
    size, count = 24, 4 * blocks
    pieces = []
    for _ in range(blocks):
        half = sum(np.diag(rng.uniform(-1.0, 0.0, size - k), k) for k in (1, 2))
        pieces.append(np.diag(rng.uniform(4.0, 6.0, size)) + half + half.T)
    order = rng.permutation(size * blocks)
    stiffness = scipy.linalg.block_diag(*pieces)[np.ix_(order, order)]
    mass = np.diag(rng.uniform(0.5, 2.0, size * blocks))
    rows = np.zeros((size * blocks, count))
    for k in range(count):
        rows[rng.choice(size * blocks, 2, replace=False), k] = 1.0, -1.0
    given = Operator(*map(scipy.sparse.csr_array, (stiffness, mass, rows, np.eye(size * blocks))))
    operator, top = given.banded(), highest(stiffness, mass)
    assert (operator._bands is None, given._bands is None) == (False, True)
    assert operator.highest_eigenvalue == pytest.approx(top, rel=1e-12)
    factor = operator.factor(2.0 * top)
    expected = rows.T @ np.linalg.solve(2.0 * top * mass - stiffness, rows)
    some = np.array([0, 2, count - 1])
    found = operator.compliance(factor, some).toarray()
    np.testing.assert_allclose(found, expected[np.ix_(some, some)], rtol=1e-9, atol=1e-12)
    (mode,) = operator.modes_at(top).T
    mode = operator.motions @ mode
    np.testing.assert_allclose(stiffness @ mode, top * (mass @ mode), rtol=1e-6, atol=1e-9 * top)
    assert operator.modes_at(1.001 * top).shape == (size * blocks, 0)
