"""Bars as an operator of few diagonals: the one file of the certificate about lines, and its fast path for them.

Bars stretch along their axes only, so that the axial displacements of the nodes are all motions with stiffness, and the
matrices of all bodies together are banded: with one diagonal beside the main one for two-node elements, for which
LAPACK has routines of their own. Bodies that nothing joins are blocks of these matrices.

An end without mass is condensed: while it is open its element has no stress, and while it is closed the element is a
spring in series with the contact (`percuss.certificate.closed_contacts`), at the node beside the end.

Bodies that are tied throughout a stretch are one block. A tie acts in every step, whatever the gap: the step without it
is never made, and a body that is part of a larger one may vibrate more slowly than it would alone. Tied ends, which
face each other on one line, are one node of their common mass; an end that is tied to a wall, or to an end that is
held, is held too.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.certificate.operator import SMALL_MATRIX, Factor, Operator, submatrix
from percuss.lapack import lapack
from percuss.mesh import banded_matrices
from percuss.mesh.banded_matrices import with_ends_held
from percuss.mesh.loads import directions_at_nodes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.march.model import Model
    from percuss.mesh.loads import Constraint
    from percuss.methods.interfaces import Floats, Integers

INVERSE_ITERATIONS = 8
WITHOUT_STRAIN = 1e-9  # force of a motion, relative to its largest part, below which it is round-off
ABOVE_HIGHEST = 1e-12  # relative distance from the highest eigenvalue at which a matrix is factorised for its mode


class Rows(NamedTuple):
    """Rows of N: the entry of each contact at the rows of the matrices."""

    row: Integers
    contact: Integers
    value: Floats


NO_ROWS = Rows(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))


class BandFactor(NamedTuple):
    """Factor of a positive definite banded matrix by LAPACK: two arrays of a tridiagonal one, else one."""

    parts: tuple[Floats, ...]

    def solve(self, columns: Floats) -> Floats:
        """Return the inverse of the matrix times (n, k) columns."""
        if not columns.size:
            return columns
        if len(self.parts) > 1:
            return lapack().dpttrs(*self.parts, columns)[0]  # type: ignore[no-any-return]
        return lapack().dpbtrs(*self.parts, columns, lower=1)[0]  # type: ignore[no-any-return]


@dataclass(frozen=True)
class LineOperator(Operator):
    """Operator of bars, as symmetric banded matrices (`percuss.mesh.banded_matrices`).

    Attributes
    ----------
    stiffness : (k + 1, n) array
        Bands of K, or of ``C K C`` with C = M^-1 where the mass couples nodes.
    mass : (1, n) or (k + 1, n) array
        Masses, or bands of C.
    rows
        Rows of N, or of C N.
    count
        Number of contacts.
    place, signs : (nodes,) arrays
        The row by which each node of the model moves, -1 of one that does not, and whether it moves along its axis or
        against it.
    """

    stiffness: Floats
    mass: Floats
    rows: Rows
    count: int
    place: Integers
    signs: Floats

    @property
    def tridiagonal(self) -> bool:
        """Whether LAPACK's routines for tridiagonal matrices and diagonal masses apply."""
        return bool(self.stiffness.shape[0] <= 2 and self.mass.shape[0] == 1)

    def factor(self, scale: float) -> BandFactor | None:
        """Return a factor of ``scale M - K``, None unless that is positive definite."""
        if not self.size:
            return BandFactor(())
        band = -self.stiffness
        band[: self.mass.shape[0]] += scale * self.mass
        if self.tridiagonal:
            beside = band[1, :-1] if band.shape[0] > 1 and self.size > 1 else np.zeros(1)
            *parts, failed = lapack().dpttrf(band[0], beside)
        else:
            *parts, failed = lapack().dpbtrf(band, lower=1)
        return None if failed else BandFactor(tuple(parts))

    def compliance(self, factor: Factor, contacts: Integers) -> Any:
        """Return ``N^T (scale M - K)^-1 N`` of some contacts, sparse from `SMALL_MATRIX` contacts on.

        Contacts are coupled through the blocks that they share, so that one column of right-hand sides serves a row of
        every block.
        """
        rows, column, pairs, contact_rows = self._touched
        units = np.zeros((self.size, int(column.max(initial=-1)) + 1))
        units[rows, column] = 1.0
        values = factor.solve(units)[rows[pairs[0]], column[pairs[1]]]
        inverse = self._matrix(values, pairs, rows.size, rows.size)
        return submatrix(contact_rows.T @ inverse @ contact_rows, contacts)

    @cached_property
    def _touched(self) -> tuple[Integers, Integers, Integers, Any]:
        """The rows at contacts, the number of each in its block, all pairs of one block, and N at these rows."""
        rows, place = np.unique(self.rows.row, return_inverse=True)
        block = np.searchsorted(self.starts, rows, side="right") - 1
        column = np.arange(rows.size) - np.searchsorted(block, block)
        pairs = [np.zeros((2, 0), dtype=np.int64)]
        for distance in range(int(column.max(initial=-1)) + 1):
            first = np.flatnonzero(block[: rows.size - distance] == block[distance:])
            pair = np.array([first, first + distance])
            pairs += [pair, pair[::-1]] if distance else [pair]
        at = place, self.rows.contact
        contact_rows = self._matrix(self.rows.value, at, rows.size, self.count)
        return rows, column, np.concatenate(pairs, axis=1), contact_rows

    def _matrix(self, values: Floats, places: Any, *shape: int) -> Any:
        """Return a matrix from its entries, those of one place added up; a sparse one with many contacts."""
        if self.count > SMALL_MATRIX:
            from scipy.sparse import csr_array

            return csr_array((values, tuple(places)), shape=shape)
        out = np.zeros(shape)
        np.add.at(out, tuple(places), values)
        return out

    @cached_property
    def starts(self) -> Integers:
        """First row of each block, to which no row before it is joined."""
        reach = np.arange(self.size)
        for k, beside in enumerate(self.stiffness[1 : self.size], start=1):
            reach = np.maximum(reach, np.where(beside != 0.0, np.arange(self.size) + k, 0))
        joined = np.maximum.accumulate(reach)
        return np.flatnonzero(np.concatenate([[-1], joined[:-1]]) < np.arange(self.size)).astype(np.int64)

    def blocks(self) -> Iterator[tuple[slice, LineOperator]]:
        """Yield the rows of each block, and its matrices without contacts."""
        for start, stop in itertools.pairwise([*self.starts.tolist(), self.size]):
            rows = slice(start, stop)
            bands = min(self.stiffness.shape[0], stop - start)
            stiffness, mass = self.stiffness[:bands, rows], self.mass[:bands, rows]
            yield rows, LineOperator(stiffness, mass, NO_ROWS, 0, NO_ROWS.row, NO_ROWS.value)

    @cached_property
    def highest_eigenvalue(self) -> float:
        """Return the largest eigenvalue of ``M^-1 K`` [1/time^2]."""
        return max((block.highest_of_block() for _, block in self.blocks()), default=0.0)

    def highest_of_block(self) -> float:
        """Return the largest eigenvalue of a single block."""
        if not self.tridiagonal:
            # The quotient of stiffness and mass of a single direction is no larger than the eigenvalue.
            low = float((self.stiffness[0] / self.mass[0]).max())
            return banded_matrices.highest_eigenvalue(low, lambda scale: self.factor(scale) is not None)
        root = 1.0 / np.sqrt(self.mass[0])
        squared = self.stiffness[0] * root**2
        scale = float(squared.max()) or 1.0  # LAPACK does not scale, and units may be of any size
        if self.size == 1:
            return scale * float(squared[0] / scale)
        beside = self.stiffness[1, :-1] * root[:-1] * root[1:] / scale
        count, values, *_, failed = lapack().dstebz(
            squared / scale, beside, 2, 0.0, 1.0, self.size, self.size, 0.0, "E"
        )  # 2: eigenvalues by their numbers
        if failed or count != 1:
            raise np.linalg.LinAlgError(f"LAPACK's dstebz failed with {failed} on {self.size} rows")
        return scale * float(values[0])

    def highest_mode(self, value: float) -> Floats:
        """Return the mode of the largest eigenvalue of a single block with diagonal masses, ``u^T M u = 1``, (n,)."""
        factor = self.factor(value * (1.0 + ABOVE_HIGHEST)) or self.factor(value * (1.0 + 1e3 * ABOVE_HIGHEST))
        if factor is None:
            raise np.linalg.LinAlgError(f"no factor just above the highest eigenvalue {value:.6g}")
        mode: Floats = np.random.default_rng(0).standard_normal(self.size)
        for _ in range(INVERSE_ITERATIONS):
            mode = factor.solve((self.mass[0] * mode)[:, None])[:, 0]
            mode = mode / np.sqrt(self.mass[0] @ mode**2)
        return mode

    def rigid(self) -> Floats:
        """Return the motions of blocks as a whole that strain nothing, one a column."""
        block = np.searchsorted(self.starts, np.arange(self.size), side="right") - 1
        motions = np.eye(self.starts.size)[block]
        if self.mass.shape[0] > 1:
            motions = np.asarray(np.linalg.solve(_full(self.mass), motions))
        force = banded_matrices.times(self.stiffness, motions)
        largest = banded_matrices.times(np.abs(self.stiffness), np.abs(motions))
        return motions[:, np.all(np.abs(force) <= WITHOUT_STRAIN * largest, axis=0)]

    def dense(self) -> tuple[Floats, Floats, Floats]:
        """Return stiffness, mass and contact rows as full matrices."""
        rows = np.zeros((self.size, self.count))
        np.add.at(rows, (self.rows.row, self.rows.contact), self.rows.value)
        return _full(self.stiffness), _full(self.mass), rows


def _full(band: Floats) -> Floats:
    return banded_matrices.times(band, np.eye(band.shape[1]))


# ------------------------------------------------------------------------------------------------- bars of a model


def held_throughout(model: Model) -> list[Constraint]:
    """Return the supports and drives that act in the first step and in the last; others count as absent."""
    first, last = 0.5 * model.dt, (model.steps - 0.5) * model.dt
    return [support for support in model.loads.constraints if support.active(first) and support.active(last)]


class _Bars(NamedTuple):
    """The nodes that move along all bodies, and their axial matrices; `inverse` has no rows with diagonal masses."""

    moving: Any  # (nodes,), whether each node of the model moves
    mass: Floats
    stiffness: Floats
    inverse: Floats


def _bars(model: Model) -> _Bars:
    moving = model.bodies.mass > 0.0
    for node, directions in directions_at_nodes(held_throughout(model)).items():
        axis = model.bodies.at(node).mesh.direction
        moving[node] &= all(abs(float(direction @ axis)) < 1e-9 for direction in directions)
    # m-fold forces in every m-th step are stable where m^2 K is in every step
    bars = model.bodies.bars.values()
    stiffness = _side_by_side([body.axial_band * float(model.leaps[body.number] ** 2) for body in bars])
    for node, spring in model.facts.springs().items():
        stiffness[0, node] += spring
    inverses = []
    for body in model.bodies.bars.values():
        for end, beside in body.ends_without_mass.items():
            stiffness[0, beside] -= body.stiffness[body.end_element(end)]
        kept = moving[body.start : body.stop]
        if body.inverse.size and kept.any():
            inverses.append(with_ends_held(body.inverse, first=not kept[0], last=not kept[-1]))
        elif model.bodies.couples_nodes:
            inverses.append(1.0 / body.mass[None, kept])
    for k, beside in enumerate(stiffness):
        beside[: beside.size - k][~moving[k:]] = 0.0
    return _Bars(moving, model.bodies.mass[moving], stiffness[:, moving], _side_by_side(inverses))


def _side_by_side(matrices: Sequence[Floats]) -> Floats:
    """Return the banded matrix of which the given ones are the blocks."""
    count = max((len(band) for band in matrices), default=0)
    return np.concatenate(
        [np.zeros((count, 0)), *(np.pad(band, ((0, count - len(band)), (0, 0))) for band in matrices)], axis=1
    )


def _along(model: Model, gradient: Iterable[tuple[int, Floats]]) -> Iterator[tuple[int, float]]:
    """Yield derivatives by the displacement of nodes along their axes; an end without mass has its neighbour."""
    for node, vector in gradient:
        body = model.bodies.at(node)
        yield body.carrier(node), float(vector @ body.mesh.direction)


def with_rows(operator: LineOperator, model: Model, gradients: Iterable[Iterable[tuple[int, Floats]]]) -> LineOperator:
    """Return an operator of the bars of a model with other rows, of the derivatives by the displacements of nodes."""
    found = [
        (operator.place[node], number, operator.signs[node] * along)
        for number, gradient in enumerate(gradients)
        for node, along in _along(model, gradient)
        if operator.place[node] >= 0
    ]
    row, number, value = np.array(found).reshape(-1, 3).T
    rows = Rows(row.astype(np.int64), number.astype(np.int64), value)
    if operator.mass.shape[0] > 1:  # with C N in place of N
        from scipy.sparse import csr_array

        normals: Any = csr_array((rows.value, (rows.row, rows.contact)), shape=(operator.size, operator.count))
        product = (banded_matrices.sparse(operator.mass) @ normals).tocoo()
        rows = Rows(product.row.astype(np.int64), product.col.astype(np.int64), product.data)
    return dataclasses.replace(operator, rows=rows)


def line_operator(model: Model, *, tied: bool = True) -> LineOperator:
    """Return the operator of the bars of a stretch of a run, those as one that are tied throughout it if `tied`.

    Of a whole run, a drive that is off at any time counts as absent.
    """
    moving, mass, stiffness, inverse = bars = _bars(model)
    place, signs = np.where(moving, np.cumsum(moving) - 1, -1), moving.astype(float)
    gradients = [contact_point.gradient for contact_point in model.contact_points]
    sides = [
        [(int(place[node]), along) for node, along in _along(model, gradients[p]) if moving[node]]
        for p in (model.tied_points if tied and model.period == 1 else ())
    ]
    if any(sides):
        motions, mass, stiffness, inverse = _tied(bars, list(filter(None, sides)))
        nodes = np.flatnonzero(moving)[motions.row]
        place, signs = np.full(moving.size, -1), np.zeros(moving.size)
        place[nodes], signs[nodes] = motions.col, motions.data
    mass = mass[None]
    if inverse.size:
        mass, stiffness = banded_matrices.pencil_bands(inverse, stiffness)
    return with_rows(LineOperator(stiffness, mass, NO_ROWS, len(gradients), place, signs), model, gradients)


# ----------------------------------------------------------------------------------------------------- tied bodies


def _tied(bars: _Bars, ties: Sequence[Sequence[tuple[int, float]]]) -> tuple[Any, Floats, Floats, Floats]:
    """Return the motions of bars that leave the gaps of their ties unchanged, and mass, stiffness and C of these.

    Parameters
    ----------
    bars
        The bars of a stretch of a run.
    ties
        For each tie the sides that are not held: row of the node and N along the axis of its body.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    motions, stiffness = _motions(bars.mass.size, ties), banded_matrices.sparse(bars.stiffness)
    if motions.shape[1]:
        motions = motions[:, reverse_cuthill_mckee(csr_array(motions.T @ stiffness @ motions), symmetric_mode=True)]
    inverse = np.zeros((0, motions.shape[1]))
    if bars.inverse.size:
        full = motions.T @ np.linalg.inv(_full(bars.inverse)) @ motions
        inverse = banded_matrices.bands(csr_array(np.linalg.inv(full)), motions.shape[1])
    bands = banded_matrices.bands(csr_array(motions.T @ stiffness @ motions), 2)
    return motions.tocoo(), np.abs(motions).T @ bars.mass, bands, inverse


def _motions(count: int, ties: Sequence[Sequence[tuple[int, float]]]) -> Any:
    """Return the motions of `count` rows of bars that ties leave, one a column: 1 or -1 in each row, 0 of a held one.

    Each row stands twice in a graph, along its axis and against it, and ties join what moves together: a row that is
    joined to its own opposite cannot move.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    joined = []
    for tie in ties:
        (one, normal), (other, opposite) = tie[0], tie[-1]
        against = count if normal * opposite > 0.0 else 0
        joined += [(one, other + against), (one + count, other + count - against)]
    first, second = np.array(joined).T
    graph = csr_array((np.ones(first.size), (first, second)), shape=(2 * count, 2 * count))
    along, against = connected_components(graph, directed=False)[1].reshape(2, -1)
    moving = np.flatnonzero(along != against)
    column = np.unique(np.minimum(along, against)[moving], return_inverse=True)[1]
    signs = np.sign(against - along)[moving].astype(float)
    return csr_array((signs, (moving, column)), shape=(count, int(column.max(initial=-1)) + 1))
