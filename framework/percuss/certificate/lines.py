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
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.certificate.operator import SMALL_MATRIX, Factor, Operator, submatrix
from percuss.lapack import lapack
from percuss.mesh import banded_matrices
from percuss.mesh.banded_matrices import with_ends_held

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.march.model import Model
    from percuss.mesh.loads import Constraint
    from percuss.methods.interfaces import Floats, Integers

INVERSE_ITERATIONS = 8
ABOVE_HIGHEST = 1e-12  # relative distance from the highest eigenvalue at which a matrix is factorised for its mode


class Rows(NamedTuple):
    """Rows of N: the entry of each contact at the rows of the matrices."""

    row: Integers
    contact: Integers
    value: Floats


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
    starts : (blocks,) array
        First row of each block.
    nodes, place, signs : (m,) arrays
        The nodes that move, the row by which each of them moves, and whether along its axis or against it.
    floating
        Numbers of the blocks that are bodies with all their nodes free, unless ties join bodies.
    """

    stiffness: Floats
    mass: Floats
    rows: Rows
    count: int
    starts: Integers
    nodes: Integers
    place: Integers
    signs: Floats
    floating: Sequence[int] = ()

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

    def blocks(self) -> Iterator[tuple[slice, LineOperator]]:
        """Yield the rows of each block, and its matrices without contacts."""
        nothing = np.zeros(0, dtype=np.int64)
        for start, stop in itertools.pairwise([*self.starts.tolist(), self.size]):
            rows = slice(start, stop)
            bands = min(self.stiffness.shape[0], stop - start)
            stiffness, mass = self.stiffness[:bands, rows], self.mass[:bands, rows]
            no_rows = Rows(nothing, nothing, np.zeros(0))
            yield rows, LineOperator(stiffness, mass, no_rows, 0, nothing[:1], nothing, nothing, np.zeros(0))

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
        """Return the motions of those bodies as a whole that have all their nodes free, one a column."""
        stops = [*self.starts[1:].tolist(), self.size]
        out = np.zeros((self.size, len(self.floating)))
        for column, block in enumerate(self.floating):
            out[int(self.starts[block]) : stops[block], column] = 1.0
        if self.mass.shape[0] > 1:
            out = np.asarray(np.linalg.solve(_full(self.mass), out))
        return out

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


def held_directions(model: Model) -> dict[int, list[Floats]]:
    """Return the directions in which nodes are held throughout, by node."""
    held: dict[int, list[Floats]] = {}
    for constraint in held_throughout(model):
        held.setdefault(constraint.node, []).append(constraint.direction)
    return held


class _Bars(NamedTuple):
    """Axial matrices of the free nodes of all bodies, side by side; `inverse` is empty with diagonal masses."""

    nodes: Integers
    starts: Integers
    mass: Floats
    stiffness: Floats
    inverse: Floats
    floating: list[int]  # numbers of those bodies of which all nodes are free


def _bars(model: Model) -> _Bars:
    held, springs = held_directions(model), model.facts.springs()
    nodes, mass = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    bands: list[Floats] = []
    inverses: list[Floats] = []
    floating: list[int] = []
    for body in model.bodies.bars.values():
        axis, ends = body.mesh.direction, (body.start, body.stop - 1)
        carried = [node for node in ends if body.carrier(node) != node]
        band = body.axial_band.copy()
        # m-fold forces in every m-th step are stable where m^2 K is in every step
        band *= float(model.leaps[body.number] ** 2)
        for node in set(ends) & springs.keys():
            band[0, node - body.start] += springs[node]
        for node in carried:
            band[0, body.carrier(node) - body.start] -= body.stiffness[body.end_element(node)]
        left_out = [
            node in carried or not all(abs(float(direction @ axis)) < 1e-9 for direction in held.get(node, []))
            for node in ends
        ]
        lo, hi = int(left_out[0]), body.mass.size - int(left_out[1])
        if hi <= lo:
            continue
        band = band[:, lo:hi]
        for k, off in enumerate(band):
            off[max(hi - lo - k, 0) :] = 0.0
        inverse = 1.0 / body.mass[None, lo:hi] if model.bodies.couples_nodes else np.zeros((0, hi - lo))
        if body.inverse.size:
            inverse = with_ends_held(body.inverse, first=left_out[0], last=left_out[1])
        if not any(left_out):
            floating.append(len(bands))
        nodes.append(np.arange(body.start + lo, body.start + hi))
        mass.append(body.mass[lo:hi])
        bands.append(band)
        inverses.append(inverse)
    starts = np.cumsum([part.size for part in nodes])[:-1]
    return _Bars(
        np.concatenate(nodes), starts, np.concatenate(mass), _side_by_side(bands), _side_by_side(inverses), floating
    )


def _side_by_side(matrices: Sequence[Floats]) -> Floats:
    """Return the banded matrix of which the given ones are the blocks."""
    out = np.zeros((max((band.shape[0] for band in matrices), default=1), sum(band.shape[1] for band in matrices)))
    first = 0
    for band in matrices:
        out[: band.shape[0], first : first + band.shape[1]] = band
        first += band.shape[1]
    return out


def _contacts_at(model: Model) -> dict[int, list[tuple[int, float]]]:
    """Return the contacts of each node, with N along the axis of its body; an end without mass has its neighbour."""
    at_node: dict[int, list[tuple[int, float]]] = {}
    for p, contact_point in enumerate(model.contact_points):
        for node, normal in contact_point.gradient:
            body = model.bodies.at(node)
            along = float(normal @ body.mesh.direction)
            at_node.setdefault(body.carrier(node), []).append((p, along))
    return at_node


def rows_along(operator: LineOperator, entries: Mapping[int, Sequence[tuple[int, float]]]) -> Rows:
    """Return rows from their entries along the axes of bars, (number, value) by node, without held nodes."""
    count = 1 + max([*entries, *operator.nodes.max(initial=-1, keepdims=True).tolist()])
    place, signs = np.full(count, -1), np.zeros(count)
    place[operator.nodes], signs[operator.nodes] = operator.place, operator.signs
    nodes = [node for node in sorted(entries) if place[node] >= 0]
    found = [(place[node], number, signs[node] * value) for node in nodes for number, value in entries[node]]
    row, number, value = np.array(found).reshape(-1, 3).T
    return Rows(row.astype(np.int64), number.astype(np.int64), value)


def bars_alone(model: Model) -> LineOperator:
    """Return the operator of the bars of a stretch of a run, each by itself: ties count as contacts.

    Of a whole run, a drive that is off at any time counts as absent.
    """
    bars = _bars(model)
    return _operator(model, bars, np.arange(bars.mass.size), np.ones(bars.mass.size))


def line_operator(model: Model) -> LineOperator:
    """Return the operator of the bars of a stretch of a run, those as one that are tied throughout it."""
    tied = () if model.period > 1 else model.tied_points
    if not tied:
        return bars_alone(model)
    bars, ties = _bars(model), dict[int, list[tuple[int, float]]]()
    moving = set(bars.nodes.tolist())
    for node, contacts in _contacts_at(model).items():
        for p, along in contacts if node in moving else ():
            if p in tied:
                ties.setdefault(p, []).append((node, along))
    return _tied(model, bars, list(ties.values())) if ties else bars_alone(model)


def _operator(model: Model, bars: _Bars, place: Integers, signs: Floats) -> LineOperator:
    stiffness, mass = bars.stiffness, bars.mass[None]
    if bars.inverse.size:
        mass, stiffness = banded_matrices.pencil_bands(bars.inverse, stiffness)
    nothing, count = Rows(bars.starts, bars.starts, signs), len(model.contact_points)
    operator = LineOperator(stiffness, mass, nothing, count, bars.starts, bars.nodes, place, signs, bars.floating)
    rows = rows_along(operator, _contacts_at(model))
    return dataclasses.replace(operator, rows=_times(bars.inverse, rows) if bars.inverse.size else rows)


def _times(inverse: Floats, rows: Rows) -> Rows:
    """Return the rows of C N from those of N."""
    from scipy.sparse import csr_array

    shape = inverse.shape[1], int(rows.contact.max(initial=-1)) + 1
    normals: Any = csr_array((rows.value, (rows.row, rows.contact)), shape=shape)
    found = (banded_matrices.sparse(inverse) @ normals).tocoo()
    return Rows(found.row.astype(np.int64), found.col.astype(np.int64), found.data)


# ----------------------------------------------------------------------------------------------------- tied bodies


def _tied(model: Model, bars: _Bars, ties: Sequence[Sequence[tuple[int, float]]]) -> LineOperator:
    """Return the operator of bars that are tied: of the motions that leave the gaps of their ties unchanged.

    Parameters
    ----------
    model, bars
        The stretch of the run and its bars.
    ties
        For each tie the sides that are not held: node and N along the axis of its body.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    motion, signs = _motions(bars.nodes, ties)
    moving = np.flatnonzero(signs)
    place = np.unique(motion[moving], return_inverse=True)[1]
    size = int(place.max(initial=-1)) + 1
    basis: Any = csr_array((signs[moving], (moving, place)), shape=(signs.size, size))
    stiffness = csr_array(basis.T @ banded_matrices.sparse(bars.stiffness) @ basis)
    order = reverse_cuthill_mckee(stiffness, symmetric_mode=True) if size else place
    mass = (np.abs(basis).T @ bars.mass)[order]
    stiffness, inverse = banded_matrices.bands(stiffness[order][:, order], 2), np.zeros((0, size))
    if bars.inverse.size:
        full = basis.T @ np.linalg.inv(_full(bars.inverse)) @ basis
        inverse = banded_matrices.bands(csr_array(np.linalg.inv(full[np.ix_(order, order)])), size)
    starts = _starts(inverse if inverse.size else stiffness)
    joined = _Bars(bars.nodes[moving], starts, mass, stiffness, inverse, [])
    return _operator(model, joined, np.argsort(order)[place], signs[moving])


def _starts(band: Floats) -> Integers:
    """Return the first row of each block of a banded matrix, to which no row before it is joined."""
    size = band.shape[1]
    reach = np.arange(size)
    for k in range(1, min(band.shape[0], size)):
        reach = np.maximum(reach, np.where(band[k] != 0.0, np.arange(size) + k, 0))
    joined = np.maximum.accumulate(reach)
    return np.flatnonzero(np.concatenate([[-1], joined[:-1]]) < np.arange(size)).astype(np.int64)


def _motions(nodes: Integers, ties: Sequence[Sequence[tuple[int, float]]]) -> tuple[Integers, Floats]:
    """Return the motion that each node makes and its sign there, 0 of a node that is held.

    Each node stands twice in a graph, along its axis and against it, and ties join what moves together: a node that is
    joined to its own opposite cannot move.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    row = {int(node): k for k, node in enumerate(nodes)}
    joined = []
    for tie in ties:
        (one, normal), (other, opposite) = ((row[node], along) for node, along in (tie[0], tie[-1]))
        against = nodes.size if normal * opposite > 0.0 else 0
        joined += [(one, other + against), (one + nodes.size, other + nodes.size - against)]
    first, second = np.array(joined).T
    graph = csr_array((np.ones(first.size), (first, second)), shape=(2 * nodes.size,) * 2)
    along, against = connected_components(graph, directed=False)[1].reshape(2, -1)
    return np.minimum(along, against), np.sign(against - along).astype(float)
