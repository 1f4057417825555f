"""The solver's own time step with some contacts held closed, as a map of states, for any integrator and law.

About a state x0 deep in contact the step is affine, ``step(x0 + e) - step(x0) = A e``, whatever the contact law, as
long as the law is linear there. States are weighted by the square root of the mass, (u, dt v), because the step without
contact is close to orthogonal in these coordinates.

The state of a multi-stage scheme includes the rows that the scheme keeps between steps, dt^2 times an acceleration.
Under such a scheme the time loop itself holds every contact with a linear law closed, because within a stage the
contact force may already have driven the ends apart. Where bodies have steps of their own, the step is the period after
which all of them act together, and contacts are held closed in the same way, as they would open and close within it.

Two kinds of motion grow linearly in time without being an instability: motions without strain that change no closed gap
(rigid translation, sideways mechanisms) and, at exactly the step 2/omega, the highest mode of a free bar.
"""

from __future__ import annotations

import itertools
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import null_space

from percuss.certificate.matrices import SAME_DIRECTION, columns_at_nodes, free_motions, held_throughout, operator_of
from percuss.contact.points import FROM_LINE, NEVER
from percuss.march.march import March
from percuss.march.model_of_case import without_loads
from percuss.mesh.loads import directions_at_nodes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.certificate.operator import Operator
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats

# Overlap and closing of the base state, relative to a unit perturbation, so that no perturbation opens a contact. The
# unit is the length of the shortest element: what is said of a law with a length of its own depends on no system of
# units, and an overlap of so many elements is deeper than any of a run.
BASE_OVERLAP = 64.0
# Overlap of a larger one beyond the base overlap, so that no perturbation brings a contact back to it.
LARGER_OVERLAP = 8.0
# Opening of such a contact in a step, in the same unit: no perturbation lets it close, nor does it open in the step.
OPENING = 4.0
# Gap of an open contact with a linear law under a multi-stage scheme, so that no stage closes it; in the same unit.
OPEN_GAP = 1e12
# Relative deviation from linearity that counts as round-off.
LINEARITY_TOLERANCE = 1e-6
# Relative change of a contact force by a perturbation below which it does not depend on the state.
FORCE_TOLERANCE = 1e-9
UNFELT = 1e-9  # relative size below which what rows see of a motion is round-off


class ClosedStep:
    """The time step of a model with some contacts held closed and the others open, as a map of weighted states.

    Parameters
    ----------
    motions
        Basis of the motions in which states are given.
    dt
        Time step.
    closed
        Numbers of the closed contacts, in the order of the case.
    unit
        The unit of overlaps and gaps, in shortest elements.
    opening
        Whether the contacts open, after an overlap larger than that of the base state.
    """

    def __init__(
        self, motions: Motions, dt: float, closed: Sequence[int], *, unit: float = 1.0, opening: bool = False
    ) -> None:
        self.motions = motions
        self.march = motions.march(dt)
        self.model = self.march.model
        self.closed = sorted(closed)
        self.size = motions.basis.shape[1]
        self.parts = self.march.stepper.levels
        self._order = np.array(self.march.arrays.order, dtype=np.int64)  # contact points as they stand in the loop
        points = motions.open_points.copy()
        self._unit = motions.shortest_element * unit
        self._start = self._hold_contacts(points)
        self._remembered: Floats = np.zeros(self.march.arrays.variables.laws)  # state variables of contact laws
        self._held = [(name, points[name]) for name in ("always", "never_pulls")]
        if opening:
            self._remember_a_larger_overlap()
        self._write_points()
        self._after = self._step(self._start)
        self.acting = np.sort(self._order[self._responds_to_state()]).tolist()

    def _remember_a_larger_overlap(self) -> None:
        """Close the contacts of this combination further, keep what the laws remember of it, and let them open."""
        self._write_points()
        self.march.arrays.step.points.row["initial_gap"] -= np.where(self._gap < 0.0, self._unit * LARGER_OVERLAP, 0.0)
        self._step(self._start)
        self._remembered = self.march.arrays.variables.after[: self._remembered.size].copy()
        self._start = -OPENING / (0.5 * BASE_OVERLAP) * self._start

    def _responds_to_state(self) -> Any:
        """Return which points have a force that depends on the state.

        A law may not act at that time though its contact is closed, or act though it is open, as a tie does; or its
        force may be constant, as where a contact yields.
        """
        points = self.march.arrays.step.points
        before = points.state.multiplier.copy()
        self(np.random.default_rng(1).uniform(-1.0, 1.0, self.parts * self.size))
        size = np.maximum(np.abs(before), np.abs(points.state.multiplier))
        responds = np.abs(points.state.multiplier - before) > FORCE_TOLERANCE * size
        return np.where(self._held_by_loop, points.row.initial_gap == 0.0, responds)

    def _hold_contacts(self, points: Any) -> Floats:
        """Set the gaps deep in contact or far out of it; return the base state of all steps, (parts, nodes * dim)."""
        signs = np.ones(len(self.model.contact_points))
        signs[self.closed] = -1.0
        nodes = self.model.contact_points.node.tolist()
        lightest = min((self.model.bodies.mass[node] for node in nodes), default=float(self.model.bodies.mass.min()))
        unit = self._unit
        self._scale = unit * np.sqrt(lightest) / self.motions.root
        # The gaps of open contacts stay as wide as they are: their laws act, if at all, where they are about to close.
        gap = self._gap = BASE_OVERLAP * np.where(signs > 0, self.motions.shortest_element, -unit)[self._order]
        # Over several stages or steps the loop holds contacts closed whose law is linear and acts at that time.
        several = self.model.multistage or self.model.period > 1
        linear = self._held_by_loop = (points.source == FROM_LINE) & (points.always != NEVER) & several
        closed = signs[self._order] < 0
        gap[linear & (closed | ((points.always == 1) & (points.never_pulls == 0)))] = 0.0
        gap[linear & (gap > 0)] = unit * OPEN_GAP
        points.always[linear & closed], points.never_pulls[linear & closed] = 1, 0
        signs[self._order[linear]] = 0.0
        gaps = self.motions.gaps * np.sqrt(lightest)
        # By half of the gap in a step, so that the gap one step before lies on the same side, for laws that weigh it.
        speed = np.linalg.lstsq(gaps, 0.5 * BASE_OVERLAP * signs, rcond=1e-9)[0] if signs.size else np.zeros(self.size)
        out = np.zeros((self.parts, self._scale.size))
        out[1] = (self.motions.basis @ speed) * self._scale / self.model.dt
        return out

    def _write_points(self) -> None:
        """Hold the contacts of this combination: another one may have used the march meanwhile."""
        points = self.march.arrays.step.points
        points.row["initial_gap"] = self._gap
        for name, values in self._held:
            points.law[name] = values

    def _step(self, state: Floats) -> Floats:
        # State variables stay as they are: the step is one of the bodies alone.
        self.march.arrays.variables.before[: self._remembered.size] = self._remembered
        after = self.march.stepper.step_without_loads(self.march.arrays.record, state)
        self.march.arrays.variables.before[:] = 0.0
        return after

    def __call__(self, states: Floats) -> Floats:
        """Return the weighted states (u, dt v, dt^2 kept) after the step, one a column, (parts n, k) or (parts n,).

        Only multi-stage schemes have kept rows. The result has the shape of `states`.
        """
        self._write_points()
        scale = self._scale * self.model.dt ** -np.minimum(np.arange(self.parts), 2.0)[:, None]  # (parts, nodal)
        columns = states.reshape(self.parts, self.size, -1).transpose(1, 0, 2).reshape(self.size, -1)
        moved = (self.motions.basis @ columns).T.reshape(self.parts, -1, self._scale.size).swapaxes(0, 1) * scale
        change = np.stack([self._step(self._start + one) - self._after for one in moved]) / scale  # (k, parts, nodal)
        images: Floats = self.motions.projection @ change.swapaxes(0, 1).reshape(-1, self._scale.size).T
        return images.reshape(self.size, self.parts, -1).transpose(1, 0, 2).reshape(states.shape)

    def matrix(self) -> Floats:
        """Return the amplification matrix, (parts n, parts n)."""
        return self(np.eye(self.parts * self.size))

    def linear(self) -> bool:
        """Return whether the step is linear in the state, and no perturbation opens or closes what a law sees."""
        state = np.random.default_rng(0).uniform(-1.0, 1.0, self.parts * self.size)
        image, opposite = self(state), self(-0.5 * state)
        return bool(np.abs(image + 2.0 * opposite).max() <= LINEARITY_TOLERANCE * np.abs(image).max())


class Motions:
    """Basis of the motions in which the step of a model is examined: displacements weighted by the root of the mass.

    Parameters
    ----------
    model
        The case as arrays; its loads are left out, and drives that last for the whole run are held at rest.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.constraints = held_throughout(model)
        self.basis = free_motions(model)
        self.projection = self.basis.T.tocsr()
        self.root = np.sqrt(model.bodies.mass_of_dofs)
        self.shortest_element = min(body.shortest for body in model.bodies.values())
        self.not_tied = [p for p in range(len(model.contact_points)) if p not in model.tied_points]  # may be open
        self._march: March | None = None
        self.open_points: Any = None  # contact points of that march before a combination holds some of them closed

    def march(self, dt: float) -> March:
        """Return the march of the model with the time step `dt`, ready for single steps, compiled where possible."""
        if self._march is None or self._march.model.dt != dt:
            inactive = self.model.inactive_points(0.5 * self.model.dt)
            march = March(without_loads(self.model, dt, self.constraints, inactive))
            march.compile()
            march.arrays.record = march.arrays.record._replace(every=2**62, last=-1, field_every=0)
            march.arrays.step.totals[0].floor = np.inf
            self._march, self.open_points = march, march.arrays.step.points.law.copy()
        return self._march

    @cached_property
    def operator(self) -> Operator:
        """Masses and stiffness of the bodies, those as one that are tied throughout."""
        return operator_of(self.model)

    @cached_property
    def gaps(self) -> Floats:
        """Gap matrix N^T of all contacts for weighted displacements, (P, n)."""
        return self._weighted(self.model.contact_points.matrix(self.model.bodies.n_nodes))

    @cached_property
    def followed(self) -> Floats:
        """The displacements on which forces depend, as rows for weighted displacements, (forces, n)."""
        forces = self.model.facts.forces
        return self._weighted(columns_at_nodes(self.model, [one.node for one in forces], [one.force for one in forces]))

    def _weighted(self, columns: Any) -> Floats:
        """Return rows for weighted displacements, (k, n), from sparse columns of derivatives by displacements."""
        return np.asarray(self.projection @ (columns.toarray() / self.root[:, None])).T

    @cached_property
    def strainless(self) -> Floats:
        """Motions without strain: those of bodies as a whole, and all motion across a bar, (n, z)."""
        model = self.model
        whole = np.asarray(self.projection @ (rigid_motions(model) * self.root[:, None]))
        if not model.bodies.of_lines:
            return whole
        bodies = model.bodies.values()
        axes = np.concatenate([np.tile(body.mesh.direction, (body.mass.size, 1)) for body in bodies])
        across = np.flatnonzero(np.abs(self.projection @ axes.ravel()) < SAME_DIRECTION)
        return np.concatenate([whole, np.eye(whole.shape[0])[:, across]], axis=1)

    def critical_modes(self, dt: float) -> Floats:
        """Return the highest mode of each body whose highest frequency is 2/dt, (n, z)."""
        modes = self.operator.motions @ self.operator.modes_at(4.0 / dt**2)
        return np.asarray(self.projection @ (self.root[:, None] * modes))

    def idle(self, dt: float, closed: Sequence[int]) -> Floats:
        """Return an orthonormal basis of the motions that grow linearly without being an instability, (n, w).

        They change no closed gap, and move no end that a load follows.
        """
        groups = [self.strainless] if self.model.stages else [self.strainless, self.critical_modes(dt)]
        return self._unfelt(groups, closed)

    def without_strain(self, closed: Sequence[int]) -> Floats:
        """Return those of the motions of `idle` that are without strain, at any step, (n, w)."""
        return self._unfelt([self.strainless], closed)

    def _unfelt(self, groups: Sequence[Floats], closed: Sequence[int]) -> Floats:
        gaps = np.concatenate([self.gaps[sorted(closed)], self.followed])
        kept = np.concatenate([unfelt(group, gaps) for group in groups], axis=1)
        return np.linalg.qr(kept)[0] if kept.size else kept


def rigid_motions(model: Model) -> Floats:
    """Return the motions of bodies as a whole that supports allow, one a column, (nodes * dim, k).

    A bar moves along its axis. Displacements of other bodies are small, so that a rotation moves a node across its
    distance from the middle of the body.
    """
    dim, held, columns = model.dim, directions_at_nodes(held_throughout(model)), []
    for body in model.bodies.values():
        inside = slice(body.start, body.stop)
        arm = model.bodies.nodes[inside] - model.bodies.nodes[inside].mean(axis=0)
        axes = np.eye(dim) if body.mesh.line is None else body.mesh.direction[None]
        fields = [np.tile(axis, (len(arm), 1)) for axis in axes]
        for first, second in itertools.combinations(range(dim if body.mesh.line is None else 0), 2):
            turned = np.zeros_like(arm)
            turned[:, first], turned[:, second] = -arm[:, second], arm[:, first]
            fields.append(turned / np.abs(arm).max())
        motions = np.zeros((len(fields), model.bodies.n_nodes, dim))
        motions[:, inside] = fields
        nodes = [node for node in held if body.start <= node < body.stop]
        caught = np.array([motions[:, node] @ direction for node in nodes for direction in held[node]])
        caught = caught[np.abs(caught).max(axis=1) > SAME_DIRECTION] if nodes else caught
        allowed = null_space(caught) if caught.size else np.eye(len(fields))
        columns.append(motions.reshape(len(fields), -1).T @ allowed)
    return np.concatenate(columns, axis=1)


def deflated(matrix: Floats, motions: Floats) -> Floats:
    """Return a matrix with zero in place of some motions, orthonormal columns, and of what it makes of these."""
    matrix = matrix - motions @ (motions.T @ matrix)
    return matrix - (matrix @ motions) @ motions.T


def unfelt(motions: Floats, rows: Floats) -> Floats:
    """Return the combinations of motions, one a column, that leave rows at zero."""
    if not (motions.size and rows.size):
        return motions
    _, size, right = np.linalg.svd(rows @ motions)
    kept: Floats = motions @ right[int((size > UNFELT * np.linalg.norm(rows)).sum()) :].T
    return kept
