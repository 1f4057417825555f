"""The stepper of implicit schemes, in NumPy and SciPy: displacement, velocity and acceleration at t_n.

Bodies are linear. The effective matrix ``K_eff = M / (beta dt^2) + (1 + alpha) K`` is factorised once, as a banded one.
A step moves the bodies without contact and adds ``K_eff^-1 N lambda``; the multipliers follow from the laws at the end
of the step with ``S = N^T K_eff^-1 N``, by SciPy's non-negative least squares where some of them must not pull.

A record has the state, the multipliers and the energies at t_n. The impulse of a force over a step is
``dt ((1 - gamma) f_n + gamma f_{n+1})``, f the force that the equation of motion has at each time, and its work is that
impulse times the mean of the velocities: works and kinetic energy balance to round-off whatever the scheme, and what
the work of the internal forces does not leave in the bodies the scheme has dissipated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.march.starting_state import initial_velocity
from percuss.mesh.loads import amplitude
from percuss.step.account import account, join_points
from percuss.step.record import is_recorded, snapshot, write_record

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.march.model import Model
    from percuss.methods.interfaces import Floats, Implicit
    from percuss.step.build import Kernels
    from percuss.step.part import Part
    from percuss.step.record import Record
    from percuss.step.records import Step


class ImplicitAmplitudes(NamedTuple):
    """Amplitudes of the loads for T consecutive steps, one column for each load; column 0 is zero."""

    force: Floats  # (T, columns) at t_{n+1}


class ImplicitStepper:
    """The stepper of an implicit scheme, an implementation of `percuss.march.stepper.Stepper`.

    Parameters
    ----------
    model
        The model to integrate in time.
    implicit
        The scheme as the integrator of the model defines it.
    """

    energy_at = 0.0
    force_at = 0.0
    levels = 3

    def __init__(self, model: Model, implicit: Implicit) -> None:
        self.model, self.implicit = model, implicit
        self.dt, self.gamma = model.dt, implicit.gamma
        self.mass: Floats = model.bodies.mass_of_dofs
        self.u: Floats = np.zeros(self.mass.size)
        self.v: Floats = initial_velocity(model).ravel().astype(np.float64)
        self.acceleration: Floats = np.zeros(self.mass.size)
        self.stiffness = stiffness_matrix(model)
        self.patterns = self._load_patterns()
        self.held = np.array(
            [c.node * model.dim + int(np.argmax(np.abs(c.direction))) for c in model.loads.constraints], dtype=np.int64
        )
        self.order = [point for bound_law in model.laws for point in bound_law.where]
        self.normals = np.ascontiguousarray(
            model.rows.normals()[:, self.order]
        )  # N of all points in the order of the loop
        self.initial_gap = np.array([model.contact_points[point].gap for point in self.order])
        self._factorise()
        self._bind_laws()
        # What acts at t_n: loads as given, and as the equation of motion has them; internal forces, reactions, contact.
        self.given: Floats = np.zeros(self.mass.size)
        self.load: Floats = np.zeros(self.mass.size)
        self.internal: Floats = np.zeros(self.mass.size)
        self.reaction: Floats = np.zeros(self.held.size)
        self.multiplier: Floats = np.zeros(len(self.order))
        self._impulse = model.bodies.no_impulse()
        self.step: Step

    # -- arrays that stay as they are ------------------------------------------------------------------------

    def _load_patterns(self) -> Floats:
        """Return the nodal forces of each load at amplitude 1, (columns, nodes * dim); column 0 is zero."""
        model, dim = self.model, self.model.dim
        loads = list(model.case.loads.values())
        patterns = np.zeros((len(loads) + 1, model.bodies.n_nodes, dim))
        for nodal_force in model.loads.nodal_forces:
            patterns[nodal_force.column, nodal_force.node] += nodal_force.force
        bodies = list(model.bodies.values())
        for body_force in model.loads.body_forces:
            body = bodies[body_force.body]
            force = np.outer(body.mass, body_force.acceleration)
            patterns[loads.index(body_force.load) + 1, body.start : body.stop] += force
        return patterns.reshape(len(loads) + 1, -1)

    def _factorise(self) -> None:
        """Factorise the effective matrix and set K_eff^-1 N and S; held degrees of freedom do not move."""
        from scipy.linalg import cholesky_banded

        free = np.ones(self.mass.size)
        free[self.held] = 0.0
        lower = self.stiffness.tocoo()
        bands = np.zeros((int((lower.row - lower.col).max(initial=0)) + 1, self.mass.size))
        kept = (lower.row >= lower.col) & (free[lower.row] > 0.0) & (free[lower.col] > 0.0)
        rows, columns = lower.row[kept], lower.col[kept]
        np.add.at(bands, (rows - columns, columns), (1.0 + self.implicit.alpha) * lower.data[kept])
        bands[0] += self.mass / (self.implicit.beta * self.dt**2)
        self.free = free
        self.factor = cholesky_banded(bands, lower=True)
        self.answers = self._solve(self.normals)
        self.delassus = self.normals.T @ self.answers

    def _solve(self, forces: Floats) -> Floats:
        from scipy.linalg import cho_solve_banded

        free = self.free if forces.ndim == 1 else self.free[:, None]
        return np.asarray(free * cho_solve_banded((self.factor, True), free * forces), dtype=np.float64)

    def _bind_laws(self) -> None:
        """Set for each point, in the order of the loop, the coefficients of its law over that of its multiplier."""
        linear = [bound_law.linear for bound_law in self.model.laws if bound_law.linear is not None]

        def column(name: str) -> Floats:
            return np.concatenate([np.zeros(0), *(np.asarray(getattr(law, name), dtype=float) for law in linear)])

        gap, rate = column("gap"), column("rate")
        scale = gap + rate * self.gamma / (self.implicit.beta * self.dt)
        self.weight_gap, self.weight_rate, self.compliance = gap / scale, rate / scale, column("sigma") / scale
        # An explicit law that presses where the gap is closed does so at the end of the step here.
        pushes = [
            np.full(len(bound_law.where), law.sign == ">= 0" or law.active == "gap < 0")
            for bound_law, law in zip(self.model.laws, linear, strict=True)
        ]
        self.pushes = np.concatenate([np.zeros(0, dtype=bool), *pushes])

    # -- the protocol of steppers ----------------------------------------------------------------------------

    def changing_arrays(self) -> list[Any]:
        """Return state and forces at t_n, and the impulse of the loads."""
        return [
            self.u, self.v, self.acceleration, self.given, self.load, self.internal, self.reaction, self.multiplier,
            self._impulse,
        ]  # fmt: skip

    def set_step(self, step: Step, parts: Sequence[Part[Any]], kernels: Kernels, midpoint: float) -> None:  # noqa: ARG002
        """Use the arrays of the next stretch of the run."""
        self.step = step
        self.acting = np.flatnonzero(~np.isin(self.order, self.model.inactive_points(midpoint)))

    def start(self) -> None:
        """Set the acceleration by the loads at t = 0; nothing presses before the first step."""
        self.given[:] = self.load[:] = self._amplitudes(np.zeros(1))[0] @ self.patterns
        self.acceleration[:] = self.free * self.load / self.mass
        self.reaction[:] = -self.load[self.held]

    def amplitudes(self, first: int, count: int) -> ImplicitAmplitudes:
        """Return forces at the ends of the steps."""
        times = np.asarray((first + 1.0 + np.arange(count)) * self.dt, dtype=np.float64)
        return ImplicitAmplitudes(self._amplitudes(times))

    def _amplitudes(self, times: Floats) -> Floats:
        loads = list(self.model.case.loads.values())
        out = np.zeros((times.size, len(loads) + 1))
        for column, spec in enumerate(loads, start=1):
            out[:, column] = amplitude(spec, times, self.dt, average=True)
        return out

    def advance(self, amplitudes: Any, record: Record, first: int, count: int) -> int:
        """Make `count` steps; return `count`, or the number of steps before the first one that failed a check."""
        step, boundary, state = self.step, self.step.boundary, self.step.points.state
        total = step.totals[0]
        for s in range(count):
            n = first + s
            boundary["old_u"] = self.u[boundary["dof"]]
            boundary["old_v"] = self.v[boundary["dof"]]
            state["gap"] = self.initial_gap + self.normals.T @ self.u
            state["rate"] = self.normals.T @ self.v
            snapshot(record, step, n, self.u, self.v)
            if is_recorded(record, n):
                state["multiplier"] = self.multiplier
                join_points(step.points)
                total.kinetic_energy = 0.5 * float(self.v @ (self.mass * self.v))
                total.elastic_energy = 0.5 * float(self.u @ (self.stiffness @ self.u))
                write_record(record, step, n, self.u, self.v, 0.0)
            if not self._step(amplitudes.force[s] @ self.patterns, n):
                return s
        return count

    def _step(self, given: Floats, n: int) -> bool:
        """Make step n with the loads at its end; return whether it is sound."""
        scheme, dt, step = self.implicit, self.dt, self.step
        load = (1.0 + scheme.alpha) * given - scheme.alpha * self.given
        guess = self.u + dt * self.v + dt**2 * (0.5 - scheme.beta) * self.acceleration
        speed = self.v + dt * (1.0 - self.gamma) * self.acceleration
        lagging = (1.0 + scheme.alpha) * guess - scheme.alpha * self.u
        moved = self._solve(load - self.stiffness @ lagging)
        to_speed = self.gamma / (scheme.beta * dt)
        multiplier, sound = self._multipliers(
            self.initial_gap + self.normals.T @ (guess + moved), self.normals.T @ (speed + to_speed * moved)
        )
        moved += self.answers @ multiplier
        internal = self.stiffness @ (lagging + (1.0 + scheme.alpha) * moved)
        velocity = speed + to_speed * moved
        reaction = (internal - load - self.normals @ multiplier)[self.held]

        def mean(before: Floats, after: Floats) -> Floats:
            return (1.0 - self.gamma) * before + self.gamma * after

        step.boundary["new_v"] = velocity[step.boundary["dof"]]
        middle = 0.5 * (self.v + velocity)
        mean_load, mean_reaction = mean(self.load, load), mean(self.reaction, reaction)
        step.points.state["multiplier"] = mean(self.multiplier, multiplier)
        step.loads.constraints["reaction"] += mean_reaction
        total = step.totals[0]
        total.internal_work += dt * float(mean(self.internal, internal) @ middle)
        single = (dt * mean_reaction) ** 2 / self.mass[self.held]
        total.step_energy = max(total.step_energy, float(single.max(initial=0.0)))
        bodies = self.model.bodies
        self._impulse += dt * bodies.with_moment(bodies.nodes, mean_load.reshape(bodies.nodes.shape)).sum(axis=0)
        sound = account(step, dt * float(mean_load @ middle), n, self.u, self.v) and sound
        contacts = step.points.contacts
        force = np.bincount(step.points.law["contact"], multiplier, contacts.size)
        contacts["peak"] = np.maximum(contacts["peak"], force)
        self.u[:], self.v[:], self.acceleration[:] = guess + moved, velocity, moved / (scheme.beta * dt**2)
        self.given[:], self.load[:], self.internal[:] = given, load, internal
        self.reaction[:], self.multiplier[:] = reaction, multiplier
        return sound

    def _multipliers(self, gap: Floats, rate: Floats) -> tuple[Floats, bool]:
        """Return the multipliers at the end of a step, (P,), from what it would be without; and whether they are sound.

        ``(compliance + S) lambda + gap = 0``, or where a law only pushes both sides of ``lambda >= 0`` and that sum
        ``>= 0`` with one of them zero.
        """
        multiplier = np.zeros(len(self.order))
        acting = self.acting
        if acting.size == 0:
            return multiplier, True
        matrix = self.delassus[np.ix_(acting, acting)] + np.diag(self.compliance[acting])
        right = (self.weight_gap * gap + self.weight_rate * rate)[acting]
        try:
            multiplier[acting] = solved(matrix, right, self.pushes[acting])
        except (np.linalg.LinAlgError, RuntimeError):
            return multiplier, False
        return multiplier, bool(np.isfinite(multiplier).all())

    def step_without_loads(self, record: Record, state: Floats) -> Floats:
        """Raise an error, as an implicit step is not examined by its amplification."""
        raise NotImplementedError

    def load_impulse(self, amplitudes: Any) -> Floats:  # noqa: ARG002  it is summed step by step
        """Return the impulse of the loads on all bodies so far, with its moment."""
        return self._impulse.copy()


def solved(matrix: Floats, right: Floats, pushes: Any) -> Floats:
    """Return x with ``matrix x + right = 0``; where `pushes`, with x and that sum at least 0 and one of them zero.

    Parameters
    ----------
    matrix : (n, n)
        Symmetric and positive definite. With its Cholesky factor L, ``matrix = L L^T``, the complementarity problem is
        the least squares problem of ``L^T x + L^-1 right`` over x >= 0.
    right : (n,)
        Right side, with the sign of a gap.
    pushes : (n,) bool array
        Which of the x must not be negative; the others are eliminated.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is not positive definite.
    """
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    root = np.sqrt(np.diag(matrix))
    scaled, target = matrix / np.outer(root, root), right / root
    free = ~pushes
    inverse = np.linalg.inv(np.linalg.cholesky(scaled[np.ix_(free, free)]))
    across = inverse.T @ inverse @ scaled[np.ix_(free, pushes)]
    x = np.zeros(right.size)
    if pushes.any():
        lower = np.linalg.cholesky(scaled[np.ix_(pushes, pushes)] - scaled[np.ix_(pushes, free)] @ across)
        x[pushes], _ = nnls(lower.T, -solve_triangular(lower, target[pushes] - across.T @ target[free], lower=True))
    x[free] = -(inverse.T @ (inverse @ target[free])) - across @ x[pushes]
    return np.asarray(x / root)


def stiffness_matrix(model: Model) -> Any:
    """Return the stiffness of linear bodies along their axes, a sparse matrix (nodes * dim, nodes * dim)."""
    from scipy import sparse

    blocks = [body.stiffness_matrix() for body in model.bodies.values()]
    return sparse.block_diag(blocks, format="csr")
