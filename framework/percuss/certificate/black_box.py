"""The amplification matrix of the actual step, contacts held closed: judges any integrator and law, and asks neither.

About a state deep in contact the step is affine, ``step(x0 + e) - step(x0) = A e``, whatever the law, so long as it is
linear there. Motions without strain that no closed gap feels (rigid translation, sideways mechanisms), and at the very
step 2/omega the highest mode of a free bar, grow linearly and are no instability: they are deflated. States are
weighted by the root of the mass, (u, dt v), in which the step without contact is close to orthogonal.

Of a scheme in stages what it keeps between steps, dt^2 times an acceleration, is part of the state, and contact is held
closed by the loop itself wherever the law is rows: in a stage the force may have driven the ends apart already. Without
contact each mode is an oscillator by itself, of which the kernel is asked.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.certificate.pencil import EDGE, Pencil
from percuss.errors import PercussError
from percuss.solver.march import March

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.methods.interfaces import Floats
    from percuss.solver.model import Model

DEPTH = 64.0  # of overlap and closing, over what a perturbation makes of either
FAR = 1e12  # of an open gap whose law is rows
DENSE = 240  # largest state of which all eigenvalues are found; above, the largest by Arnoldi's iteration
KRYLOV = 24  # vectors kept
RESTARTS = 12  # half as many for states above
HUGE = 5000
LINEAR = 1e-6
UNFELT = 1e-7  # relative: a motion that contact changes by less is one that it leaves alone
MOST_TOGETHER = 3  # contacts of which every combination is tried; above, none, each one, and all


@dataclass(frozen=True)
class Found:
    """What the step says of itself.

    Attributes
    ----------
    radius
        Largest modulus of the eigenvalues left after deflation; nan where the step is not linear.
    theta
        Of steps whose contact answers the predicted overlap alone: the largest part of it that is taken back, else
        None.
    whole
        Whether that is all there is to know; False: the radius is what a Krylov iteration found, 0 for nothing.
    """

    radius: float
    theta: float | None
    whole: bool
    failure: str = ""  # what a kernel raised deep in contact, where it did
    felt: float = np.inf  # above theta = 1 the largest modulus of motions that contact changes, where it is known

    @property
    def linear(self) -> bool:
        """Whether the step is linear with these contacts closed."""
        return not np.isnan(self.radius)

    @property
    def stable(self) -> bool:
        """Whether nothing was found to grow.

        Above theta = 1 growth starts so slowly that a modulus of 1 may hide it: motions that contact feels must decay.
        The others move as free bodies do.
        """
        return not self.radius > 1.0 + EDGE and not (_beyond(self.theta) and self.felt > 1.0 - EDGE)


def _beyond(theta: float | None) -> bool:
    """Return whether contact takes back more than what it answers."""
    return theta is not None and theta > 1.0 + EDGE


class ClosedStep:
    """The step of a model with some contacts held closed and the others open.

    Parameters
    ----------
    motions
        The motions in which states are given.
    dt
        Time step.
    closed
        Numbers of the closed contacts, in the order of the case.
    """

    def __init__(self, motions: Motions, dt: float, closed: Sequence[int]) -> None:
        self.motions = motions
        resting = motions.model.resting(0.5 * motions.model.dt)
        self.model = motions.model.still(dt, motions.pencil.constraints, resting)
        self.closed = sorted(closed)
        self.size = motions.basis.shape[1]
        self.march = March(self.model)
        self.march.compile()
        self.parts = self.march.stepper.levels
        self._record = self.march.record._replace(every=2**62, last=-1, field_every=0)
        self._boundary = self.march.boundary
        self._boundary.totals[0].floor = np.inf
        self._start = self._hold()
        self._after = self._step(self._start)
        # a law may be off at that time: its contact is as good as open
        acts = (self._boundary.points.multiplier != 0) | ((self._boundary.points.own == 0) & self.model.multistage)
        self.acting = [p for p, one in zip(self.march.order, acts, strict=True) if one and p in self.closed]

    def _hold(self) -> Floats:
        """Set the gaps deep in contact or far out of it; return the state from which all steps are made, (parts, n)."""
        signs = np.ones(len(self.model.contact_pairs))
        signs[self.closed] = -1.0
        nodes = [node for contact_pair in self.model.contact_pairs for node in contact_pair.nodes]
        lightest = min((self.model.mass[node] for node in nodes), default=float(self.model.mass.min()))
        self._scale = np.sqrt(lightest) / self.motions.root
        points, order = self._boundary.points, self.march.order
        points.initial_gap = DEPTH * signs[order]
        if self.model.multistage:
            closed, rows = signs[order] < 0, points.own == 0
            points.initial_gap[rows & (closed | ((points.always == 1) & (points.never_pulls == 0)))] = 0.0
            points.initial_gap[rows & (points.initial_gap > 0)] = FAR
            points.always[rows & closed], points.never_pulls[rows & closed] = 1, 0
            signs[np.array(order, dtype=np.int64)[rows]] = 0.0
        gaps = self.motions.gaps * np.sqrt(lightest)
        speed = np.linalg.lstsq(gaps, DEPTH * signs, rcond=1e-9)[0] if signs.size else np.zeros(self.size)
        out = np.zeros((self.parts, self._scale.size))
        out[1] = (self.motions.basis @ speed) * self._scale / self.model.dt
        return out

    def _step(self, state: Floats) -> Floats:
        return self.march.stepper.step_without_loads(self.march.kernels, self._record, state)

    def __call__(self, states: Floats) -> Floats:
        """Return what the step makes of weighted states (u, dt v, dt^2 kept), one a column, (parts n, k) or (parts n,).

        Only schemes in stages keep anything.
        """
        n, motions = self.size, self.motions
        scale = self._scale * self.model.dt ** -np.minimum(np.arange(self.parts), 2.0)[:, None]  # (parts, nodal)
        columns = states.reshape(self.parts, n, -1)
        made = np.empty_like(columns)
        for k in range(columns.shape[2]):
            moved = np.stack([motions.basis @ part for part in columns[:, :, k]]) * scale
            change = (self._step(self._start + moved) - self._after) / scale
            made[:, :, k] = np.stack([motions.read @ part for part in change])
        return made.reshape(states.shape)

    def matrix(self) -> Floats:
        """Return the amplification matrix, (parts n, parts n)."""
        return self(np.eye(self.parts * self.size))

    def linear(self) -> bool:
        """Return whether the step is linear in the state."""
        one = np.random.default_rng(0).uniform(-1.0, 1.0, self.parts * self.size)
        there, back = self(one), self(-0.5 * one)
        return bool(np.abs(there + 2.0 * back).max() <= LINEAR * np.abs(there).max())


class Motions:
    """The motions of a model in which its step is looked at, in displacements weighted by the root of the mass.

    Parameters
    ----------
    model
        The case as arrays; its loads are left out, its lasting drives stand still.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.pencil = Pencil(model)
        self.basis = _basis(model, self.pencil)
        self.read = self.basis.T.tocsr()
        self.root = np.sqrt(np.repeat(model.mass, model.dim))

    @cached_property
    def gaps(self) -> Floats:
        """N^T of all contacts on the weighted displacements, (P, n)."""
        out = np.zeros((len(self.model.contact_pairs), self.root.size))
        for p, contact_pair in enumerate(self.model.contact_pairs):
            for node, normal in contact_pair.rows():
                out[p, node * self.model.dim : (node + 1) * self.model.dim] += normal
        return np.asarray(self.read @ (out / self.root).T).T

    @cached_property
    def strainless(self) -> Floats:
        """Motions without strain: bars free along their axis, and what lies across it, (n, z)."""
        model, basis = self.model, self.basis
        columns = []
        along = np.zeros(basis.shape[1])
        for body in model.bodies.values():
            axis = np.zeros((model.n_nodes, model.dim))
            axis[body.start : body.stop] = body.mesh.direction
            along += np.abs(basis.T @ axis.ravel())
            held = [d for node in range(body.start, body.stop) for d in self.pencil.held.get(node, [])]
            if all(abs(float(d @ body.mesh.direction)) < 1e-9 for d in held):
                columns.append(basis.T @ (axis.ravel() * self.root))
        across = np.flatnonzero(along < 1e-9)
        sideways = np.zeros((basis.shape[1], across.size))
        sideways[across, np.arange(across.size)] = 1.0
        return np.concatenate([np.array(columns).reshape(-1, basis.shape[1]).T, sideways], axis=1)

    def highest(self, dt: float) -> Floats:
        """Return the highest modes of the bodies whose frequency is 2/dt, (n, z)."""
        from scipy.linalg import eigh_tridiagonal

        columns = []
        for first, mass, diagonal, off in self.pencil.bodies:
            top = mass.size - 1
            root = np.sqrt(mass)
            if abs(dt**2 * (diagonal / mass).max() / 2.0 - 1.0) > 0.5 or top == 0:
                continue  # by Gershgorin's bound nowhere near
            value, vector = eigh_tridiagonal(
                diagonal / mass, off / (root[:-1] * root[1:]), select="i", select_range=(top, top)
            )
            if abs(value[0] * dt**2 / 4.0 - 1.0) < 4.0 * EDGE:
                full = np.zeros((self.model.n_nodes, self.model.dim))
                full[first : first + mass.size] = vector * self.model.body_of(first).mesh.direction
                columns.append(self.read @ full.ravel())
        return np.array(columns).reshape(-1, self.basis.shape[1]).T

    def idle(self, dt: float, closed: Sequence[int]) -> Floats:
        """Return an orthonormal basis of the motions that grow linearly and are no instability, (n, w)."""
        gaps = self.gaps[sorted(closed)]
        out = []
        for group in (self.strainless, *(() if self.model.stages else (self.highest(dt),))):
            if gaps.size and group.size:
                _, size, right = np.linalg.svd(gaps @ group)
                rank = int((size > 1e-9 * np.linalg.norm(gaps)).sum())
                out.append(group @ right[rank:].T)
            else:
                out.append(group)
        kept = np.concatenate(out, axis=1)
        return np.linalg.qr(kept)[0] if kept.size else kept


def _basis(model: Model, pencil: Pencil) -> Any:
    """Return the motions in question as sparse orthonormal columns: along each bar, and every way where it touches."""
    from scipy import sparse

    touched = {node for contact_pair in model.contact_pairs for node in contact_pair.nodes}
    columns: list[tuple[int, Floats]] = []
    for body in model.bodies.values():
        axis = body.mesh.direction
        special = touched | set(pencil.held)
        for node in range(body.start, body.stop):
            if node not in special:
                columns.append((node, axis))
                continue
            free = np.eye(model.dim)
            for direction in pencil.held.get(node, []):
                free = free - np.outer(free @ direction, direction)
            found: list[Floats] = []
            for way in [free @ axis, *free] if node in touched else [free @ axis]:
                rest = way - sum(((way @ other) * other for other in found), np.zeros(model.dim))
                if np.linalg.norm(rest) > 1e-9:
                    found.append(rest / np.linalg.norm(rest))
            columns += [(node, way) for way in found]
    nodes = np.array([node for node, _ in columns], dtype=np.int64)
    dofs = (nodes[:, None] * model.dim + np.arange(model.dim)).ravel()
    values = np.array([way for _, way in columns]).ravel()
    place = np.repeat(np.arange(nodes.size), model.dim)
    return sparse.csr_array((values, (dofs, place)), shape=(model.n_nodes * model.dim, nodes.size))


def examine(motions: Motions, dt: float, closed: Sequence[int], *, sure: bool = False) -> Found:
    """Return what the step of length `dt` says of itself with given contacts closed.

    Parameters
    ----------
    motions, dt, closed
        As for `ClosedStep`.
    sure
        Whether a longer step was found to be stable: then a large model is not searched again for what grows.
    """
    try:
        step = ClosedStep(motions, dt, closed)
        linear = step.linear()
    except (PercussError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001  of a kernel that was never meant for overlaps as deep as these
        return Found(np.nan, None, whole=False, failure=f"{type(error).__name__}: {error}")
    if not linear:
        return Found(np.nan, None, whole=False)
    theta = _theta(step, ClosedStep(motions, dt, ())) if step.closed and not step.model.multistage else None
    size = step.parts * step.size
    if size > DENSE and theta is not None:  # then the closed step is bounded where that of the bodies is
        nothing = np.zeros(len(motions.model.contact_pairs))
        return Found(1.0 if motions.pencil.definite(dt, nothing, nothing)[0] else np.inf, theta, whole=True)
    idle: Floats = np.kron(np.eye(step.parts), motions.idle(dt, step.acting)).astype(np.float64)
    if size > DENSE:
        return Found(1.0 if sure else _largest(step, idle), theta, whole=False)
    matrix = step.matrix()
    rest = matrix - idle @ (idle.T @ matrix)
    rest -= (rest @ idle) @ idle.T
    if not _beyond(theta):
        return Found(float(np.abs(np.linalg.eigvals(rest)).max(initial=0.0)), theta, whole=True)
    values, motions_of = np.linalg.eig(rest)
    moduli = np.abs(values)
    changed = matrix - ClosedStep(motions, dt, ()).matrix()  # by contact; the gaps themselves vanish at theta = 1
    felt = np.linalg.norm(changed @ motions_of, axis=0) > UNFELT * np.linalg.norm(changed)
    return Found(float(moduli.max(initial=0.0)), theta, whole=True, felt=float(moduli[felt].max(initial=0.0)))


def _theta(closed: ClosedStep, free: ClosedStep) -> float | None:
    """Return theta of a step whose contact answers the predicted overlap alone.

    Such a step is the free one followed by ``I - [X, 0; X, 0]``, X symmetric in the weighted displacements and zero
    but between the ends in contact; its determinant is the product of all ``1 - theta``, theta the eigenvalues of X.
    """
    n = closed.size
    ends = np.linalg.qr(closed.motions.gaps.T)[0]
    x = np.zeros((ends.shape[1], ends.shape[1]))
    size = 0.0
    for k, end in enumerate(ends.T):
        turned = free(np.concatenate([end, np.zeros(n)]))[n:]
        # the states that the free step takes to (end, 0) and to (0, end)
        place = closed(np.concatenate([end, -turned])) - np.concatenate([end, np.zeros(n)])
        rate = closed(np.concatenate([-end, end + turned])) - np.concatenate([np.zeros(n), end])
        x[:, k] = -ends.T @ place[:n]
        size = max(size, float(np.abs(place).max()))
        local = max(np.abs(place[:n] - place[n:]).max(), np.abs(place[:n] + ends @ x[:, k]).max())
        if max(local, np.abs(rate).max()) > LINEAR * size:
            return None
    if size < LINEAR or np.abs(x - x.T).max() > LINEAR * size:
        return None
    return float(np.linalg.eigvalsh(0.5 * (x + x.T))[-1])


def _largest(step: ClosedStep, idle: Floats) -> float:
    """Return the largest eigenvalue modulus that Arnoldi's iteration finds, 0 where none stands out."""
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

    size = step.parts * step.size

    def product(state: Floats) -> Floats:
        state = step(state - idle @ (idle.T @ state))
        return state - idle @ (idle.T @ state)

    operator: Any = LinearOperator((size, size), matvec=product, dtype=float)
    values: Any
    try:
        values = eigs(
            operator,
            k=2,
            ncv=KRYLOV,
            which="LM",
            v0=np.random.default_rng(0).standard_normal(size),
            maxiter=RESTARTS if size < HUGE else RESTARTS // 2,
            tol=1e-9,
            return_eigenvectors=False,
        )
    except ArpackNoConvergence as stopped:
        values = stopped.eigenvalues
    return float(np.abs(values).max(initial=0.0))


def combinations(count: int) -> list[tuple[int, ...]]:
    """Return the combinations of closed contacts that are tried, none first."""
    every = range(count)
    if count <= MOST_TOGETHER:
        return [c for k in range(count + 1) for c in itertools.combinations(every, k)]
    return [(), *((p,) for p in every), tuple(every)]
