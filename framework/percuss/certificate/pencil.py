"""Stability of the closed linear step from the linear laws, with banded matrices of the bars and no dense ones.

Bars stretch along their axes only, so the stiffness of each body is one symmetric matrix of few diagonals in the axial
displacements of its nodes. An end without mass is condensed: while it is open its element has no stress, and while it
is closed the element is a spring in series with the contact (`percuss.certificate.closed_contacts`), at the node beside
the end. By Sylvester's law of inertia, central difference is stable at a step dt where
``(4/dt^2)(M + M_p) - (K + K_p)`` is positive definite for the worst combination of closed contacts, which closes
exactly the contacts with a negative ``4 eps_m / dt^2 - eps_s``. Each of them is factorised by itself, and the contacts
enter through the small matrix ``N^T ((4/dt^2) M - K)^-1 N``. Bodies that are tied throughout are one part, as the step
without their ties is never made (`percuss.certificate.tied_bodies`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.blas import one_blas_thread
from percuss.certificate.axial_matrix import AxialMatrix
from percuss.certificate.following_loads import end_stiffness
from percuss.certificate.tied_bodies import parts_of
from percuss.mesh.banded_matrices import pencil_bands, with_ends_held

if TYPE_CHECKING:
    from percuss.march.model import Model
    from percuss.methods.interfaces import Floats, Integers

# Relative distance from the limit within which a step is marginal.
MARGINAL_DISTANCE = 1e-9
SMALL_MATRIX = 32  # rows up to which a matrix is taken as full
FULL_EIGENVECTORS = 200  # rows up to which all eigenvectors of a matrix are found to have the last one
MOST_TRIALS = 200  # steps tried in the search for the critical one
SMALLEST_NUMBER = float(np.finfo(float).tiny)
SMALLEST_RELATIVE_TOLERANCE = 4.0 * float(np.finfo(float).eps)  # the least that SciPy accepts
# Largest number of contacts of which each is tried whether it can be left out, to bound the time.
MOST_TRIED_CONTACTS = 24


class Pencil:
    """Mass and stiffness of the bodies of a model along their axes, and the contacts that join them.

    Parameters
    ----------
    model
        A stretch of a run (`percuss.march.model.Model.stretches`); of a whole run, a drive that is off at any time
        counts as absent.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        first, last = 0.5 * model.dt, (model.steps - 0.5) * model.dt
        self.constraints = [
            constraint for constraint in model.constraints if constraint.active(first) and constraint.active(last)
        ]
        held: dict[int, list[Floats]] = {}
        for constraint in self.constraints:
            held.setdefault(constraint.node, []).append(constraint.direction)
        self.held = held
        springs = end_stiffness(model)
        self.bodies: list[AxialMatrix] = []
        for body in model.bodies.values():
            diagonal, off = body.axial_band
            if model.own_steps:  # m-fold forces in every m-th step are stable where m^2 K is in every step
                square = float(model.own_steps[body.number] ** 2)
                diagonal, off = square * diagonal, square * off
            for node in {body.start, body.stop - 1} & springs.keys():
                diagonal = diagonal.copy()
                diagonal[node - body.start] += springs[node]
            axis, without_mass = body.mesh.direction, body.ends_without_mass
            for node, beside in without_mass.items():
                diagonal = diagonal.copy()
                diagonal[beside - body.start] -= body.stiffness[body.end_element(node)]
            left_out = [
                node in without_mass or not all(abs(float(direction @ axis)) < 1e-9 for direction in held.get(node, []))
                for node in (body.start, body.stop - 1)
            ]
            lo, hi = int(left_out[0]), body.mass.size - int(left_out[1])
            if hi > lo:
                off = off[lo : hi - 1] if off.ndim == 1 else off[: hi - lo - 1, lo:hi]
                coupled = np.zeros((2, 0, hi - lo))
                if body.inverse.size:
                    inverse = with_ends_held(body.inverse, first=left_out[0], last=left_out[1])
                    coupled = np.stack(pencil_bands(inverse, diagonal[lo:hi], off))
                self.bodies.append(AxialMatrix(body.start + lo, body.mass[lo:hi], diagonal[lo:hi], off, coupled))

        # Nodes in contact, and for each its contacts with their N along the axis of the body.
        at_node: dict[int, list[tuple[int, float]]] = {}
        for p, contact_pair in enumerate(model.contact_pairs):
            for node, normal in contact_pair.gap_gradient():
                body = model.body_of(node)
                along = float(normal @ body.mesh.direction)
                at_node.setdefault(body.ends_without_mass.get(node, node), []).append((p, along))
        self._at_node = at_node
        moving = {node for body in self.bodies for node in (body.first, body.first + body.mass.size - 1)}
        ties: dict[int, list[tuple[int, float]]] = {}
        for node in at_node.keys() & moving:
            for p, along in at_node[node]:
                if p in model.tied_points and not model.own_steps:
                    ties.setdefault(p, []).append((node, along))
        self.parts = parts_of(self.bodies, list(ties.values()))

    def factors(self, dt: float) -> list[Any] | None:
        """Return a factor of ``(4/dt^2) M - K`` of each part; None unless all are positive definite."""
        factors = []
        for part in self.parts:
            factor = part.matrix.factor(4.0 / dt**2)
            if factor is None:
                return None
            factors.append(factor)
        return factors

    def normals(self, first: int, count: int) -> Floats:
        """Return N of all contacts along the axis of a body, for `count` of its nodes from `first` on, (count, P)."""
        columns = np.zeros((count, len(self.model.contact_pairs)))
        for node, contacts in self._at_node.items():
            for p, normal in contacts if first <= node < first + count else ():
                columns[node - first, p] += normal
        return columns

    def compliance(self, factors: list[Any]) -> Any:
        """Return ``N^T ((4/dt^2) M - K)^-1 N``, (P, P).

        A contact is coupled to those on the same bodies only: from `SMALL_MATRIX` contacts on the matrix is sparse.
        """
        couplings, places = self._couplings
        values = []
        for part, touched, entries in couplings:
            matrix = self.parts[part].matrix
            normals = np.zeros((matrix.mass.size, touched))
            for row, column, normal in entries:
                normals[row, column] += normal
            values.append((normals.T @ matrix.solve(factors[part], normals)).ravel())
        count = len(self.model.contact_pairs)
        if not values:
            return np.zeros((count, count))
        if count > SMALL_MATRIX:
            from scipy.sparse import csr_array

            return csr_array((np.concatenate(values), places), shape=(count, count))  # adds values of equal places
        out = np.zeros((count, count))
        np.add.at(out, places, np.concatenate(values))
        return out

    @cached_property
    def _couplings(self) -> tuple[list[tuple[int, int, list[tuple[int, int, float]]]], tuple[Integers, Integers]]:
        """The contacts of each part, and the places of their pairs in `compliance`, which are the same for every step.

        Each part in contact has its number, the number of its contacts, and row, column and N along its motion for each
        side of them. The places are rows and columns, one of each for every pair of contacts on a part.
        """
        couplings, rows, columns = [], [], []
        in_contact = np.array(sorted(self._at_node), dtype=np.int64)
        for number, part in enumerate(self.parts):
            contacts = [
                (row, p, sign * normal) for node, row, sign in part.at(in_contact) for p, normal in self._at_node[node]
            ]
            touched = sorted({p for _, p, _ in contacts})
            if touched:
                column = {p: k for k, p in enumerate(touched)}
                couplings.append((number, len(touched), [(row, column[p], n) for row, p, n in contacts]))
                rows += [p for p in touched for _ in touched]
                columns += touched * len(touched)
        return couplings, (np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64))

    def definite(self, dt: float, stiffness: Floats, inertia: Floats) -> tuple[bool, list[int]]:
        """Return whether ``(4/dt^2)(M + M_p) - (K + K_p)`` is positive definite for every set of closed contacts.

        The worst combination closes exactly the contacts with ``eps_s > 4 eps_m / dt^2``.

        Parameters
        ----------
        dt
            Time step.
        stiffness, inertia : (P,) arrays
            eps_s and eps_m of the contacts evaluated at the current state, 0 for the others.

        Returns
        -------
        definite
            Whether the matrix is positive definite.
        limiting
            Contacts that suffice to make it indefinite while they are closed; if they are at most
            `MOST_TRIED_CONTACTS`, none can be left out. Empty where the matrix is definite, or indefinite without
            contact.
        """
        harmful, softening = self._softening(dt, stiffness, inertia)
        if softening is None:
            return False, []
        if not harmful.size or largest_eigenvalue(softening) < 1.0:
            return True, []
        return False, [int(p) for p in harmful[_limiting_rows(softening)]]

    def largest_softening(self, dt: float, stiffness: Floats, inertia: Floats) -> float:
        """Return the number that is below 1 where `definite` is true; inf where no contact is needed to make it false.

        It is the largest share of the dynamic stiffness ``(4/dt^2) M - K`` that closed contacts take away, and varies
        continuously with dt.
        """
        harmful, softening = self._softening(dt, stiffness, inertia)
        if softening is None:
            return np.inf
        return largest_eigenvalue(softening) if harmful.size else 0.0

    def _softening(self, dt: float, stiffness: Floats, inertia: Floats) -> tuple[Any, Any]:
        """Return the contacts that soften the step, and their softening; None where it is unstable without contact."""
        factors = self.factors(dt)
        if factors is None:
            return np.zeros(0, dtype=np.int64), None
        excess = stiffness - 4.0 * inertia / dt**2
        harmful = np.flatnonzero(excess > 0)
        if harmful.size == 0:
            return harmful, np.zeros((0, 0))
        root = np.sqrt(excess[harmful])
        softening = _submatrix(self.compliance(factors), harmful)
        if isinstance(softening, np.ndarray):
            return harmful, root[:, None] * softening * root
        from scipy.sparse import diags_array

        return harmful, (diags_array(root) @ softening @ diags_array(root)).tocsr()

    def free_step(self) -> float:
        """Return the largest step that is stable with no contact closed but ties, 2 over the highest frequency."""
        highest = max([0.0, *(part.matrix.highest_eigenvalue() for part in self.parts)])
        return 2.0 / math.sqrt(highest) if highest > 0.0 else math.inf


def _submatrix(matrix: Any, rows: Any) -> Any:
    """Return the rows and columns `rows` of a matrix, full or sparse."""
    return matrix[np.ix_(rows, rows)] if isinstance(matrix, np.ndarray) else matrix[rows][:, rows]


def largest_eigenvalue(matrix: Any) -> float:
    """Return the largest eigenvalue of a symmetric matrix; a large one, full or sparse, has zeros in most places.

    A contact is coupled to those on the same bodies only, so that a suitable order of the contacts gives a matrix with
    few diagonals.
    """
    size = matrix.shape[0]
    if size <= SMALL_MATRIX:
        return float(np.linalg.eigvalsh(_full(matrix))[-1])
    from scipy.linalg import eigh, eigvals_banded
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    last = (size - 1, size - 1)
    entries = coo_array(matrix)
    place = np.empty(size, dtype=np.int64)
    place[reverse_cuthill_mckee(csr_array(matrix), symmetric_mode=True)] = np.arange(size)
    rows, columns = place[entries.row], place[entries.col]
    width = int(np.abs(rows - columns).max(initial=0))
    if width > size // 8:
        with one_blas_thread():  # once more, of the library that this import may have brought
            return float(eigh(_full(matrix), eigvals_only=True, subset_by_index=last)[0])
    lower = rows >= columns
    band = np.zeros((width + 1, size))
    band[(rows - columns)[lower], columns[lower]] = entries.data[lower]
    return float(eigvals_banded(band, lower=True, select="i", select_range=last)[0])


def _full(matrix: Any) -> Floats:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


def _last_eigenvector(matrix: Any) -> Floats:
    """Return an eigenvector of the largest eigenvalue of a symmetric matrix; of a large one, approximately."""
    size = matrix.shape[0]
    if size <= FULL_EIGENVECTORS:
        return np.linalg.eigh(_full(matrix))[1][:, -1]
    from scipy.sparse.linalg import ArpackNoConvergence, eigsh

    diagonal = matrix.diagonal()
    try:
        return eigsh(matrix, k=1, which="LA", v0=np.sqrt(np.abs(diagonal)), tol=1e-6)[1][:, 0]  # type: ignore[no-any-return]
    except ArpackNoConvergence:
        return diagonal  # type: ignore[no-any-return]


def _limiting_rows(matrix: Any) -> list[int]:
    """Return a small set of rows of a symmetric matrix whose submatrix has an eigenvalue of 1 or more.

    The rows with the largest components in the last eigenvector come first, the fewest of them that suffice; of up to
    `MOST_TRIED_CONTACTS` rows, each that can be left out is then left out.
    """

    def unstable(rows: list[int]) -> bool:
        return bool(rows) and largest_eigenvalue(_submatrix(matrix, rows)) >= 1.0

    component = np.abs(_last_eigenvector(matrix))
    order = [int(row) for row in np.argsort(-component, kind="stable")]
    lo, hi = 0, len(order)  # The first `hi` rows are unstable, the first `lo` rows are not.
    while hi - lo > 1:
        middle = (lo + hi) // 2
        lo, hi = (lo, middle) if unstable(order[:middle]) else (middle, hi)
    kept = order[:hi]
    for row in kept[::-1] if hi <= MOST_TRIED_CONTACTS else ():
        rest = [other for other in kept if other != row]
        if unstable(rest):
            kept = rest
    return sorted(kept)


def largest_step_below(excess: Callable[[float], float], free: float) -> float:
    """Return the largest stable step, `free` where contact does not lower it; `excess` is that of `largest_step`."""
    just_below = free * (1.0 - 0.1 * MARGINAL_DISTANCE)
    return free if excess(just_below) <= 0.0 else largest_step(excess, just_below)


def largest_step(
    excess: Callable[[float], float], start: float, tolerance: float = 1e-11, *, guess: float | None = None
) -> float:
    """Return the largest step, within a relative `tolerance`, up to which steps are stable, searching from `start`.

    Parameters
    ----------
    excess
        A number at most 0 where a step is stable, and above 0 where it is not, between -1 and 1. Where it varies
        continuously with the step a few trials suffice; where it is only -1 or 1 each trial halves the bracket.
    start
        Step at which the search begins.
    tolerance
        Relative distance from the limit within which the returned step lies. It is stable itself.
    guess
        A step that may be the limit: if the steps just below and above it show that it is, two trials are enough.
    """
    from scipy.optimize import brentq

    trials: dict[float, float] = {}

    def tried(dt: float) -> float:
        if dt not in trials:
            value = excess(dt)
            # The search ends where a value is 0, although longer steps may be stable, too.
            trials[dt] = 1.0 if math.isnan(value) else value if value > 0.0 else min(value, -SMALLEST_NUMBER)
        return trials[dt]

    if guess is not None:
        below, above = guess * (1.0 - 0.4 * tolerance), guess * (1.0 + 0.4 * tolerance)
        if tried(below) <= 0.0 < tried(above):
            return below
    lo = hi = start
    while tried(lo) > 0.0:
        hi, lo = lo, 0.5 * lo
        if lo < 1e-12 * start:
            return 0.0
    while tried(hi) <= 0.0:
        lo, hi = hi, 2.0 * hi
        if hi > 1e3 * start:
            return math.inf
    distance = 0.25 * tolerance * lo
    root, _ = brentq(
        tried,
        lo,
        hi,
        xtol=distance,
        rtol=SMALLEST_RELATIVE_TOLERANCE,
        maxiter=MOST_TRIALS,
        full_output=True,
        disp=False,
    )
    # The limit may have been approached from one side only.
    near = [root - 2.0 * distance, root + 2.0 * distance]
    while True:
        unstable = min(dt for dt, value in trials.items() if value > 0.0)
        stable = max(dt for dt, value in trials.items() if value <= 0.0 and dt < unstable)
        middle = 0.5 * (stable + unstable)
        if unstable - stable <= tolerance * unstable or middle in (stable, unstable):
            return stable
        inside = [dt for dt in near if stable < dt < unstable]
        tried(inside[0] if inside else middle)
