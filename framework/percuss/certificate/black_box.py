"""The criterion of the black box: amplification matrices measured from the solver's own time step, for any method.

A law with a kernel may be linear deep in contact and follow another line elsewhere, as one that softens, yields or
remembers its largest overlap does. The step is therefore examined about other states too: at small overlaps, and while
the contact opens after a larger overlap. Where these steps differ, growth on one of the lines tells that the step is
unstable, but nothing tells that it is stable, as a run changes from one line to another.

Motions that grow linearly in time without being an instability are deflated (`percuss.certificate.closed_step`). Under
a multi-stage scheme each mode without contact is an oscillator by itself, and the kernel of the scheme tells its limit
(`percuss.certificate.oscillator`).
"""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from percuss.certificate.assessment import MARGINAL_DISTANCE, Assessment, largest_step, quoted
from percuss.certificate.closed_laws import why_unlike
from percuss.certificate.closed_step import LINEARITY_TOLERANCE, ClosedStep, Motions, deflated
from percuss.certificate.oscillator import limit_ratio
from percuss.contact.law_trials import changes_with_time
from percuss.errors import PercussError
from percuss.mesh.eigenvalues import without_chance
from percuss.methods.blame import described

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats

# Further states about which the step with a kernel law is examined: the unit in shortest elements, and whether contacts
# open after a larger overlap.
OTHER_STATES = ((1.0, True), (2.0**-12, False), (2.0**-12, True), (2.0**-24, False), (2.0**-24, True))
# Largest state of which all eigenvalues are computed; of a larger one Arnoldi's iteration finds the largest only.
LARGEST_DENSE_STATE = 240
# Number of vectors that Arnoldi's iteration keeps.
KRYLOV_VECTORS = 24
# Number of restarts of Arnoldi's iteration, halved for states of `LARGE_STATE` entries or more to bound the time.
ARNOLDI_RESTARTS = 12
LARGE_STATE = 5000
FEW_RESTARTS = 3  # where a run looks for growth, about as many products as it has steps
CLEAR_GROWTH = 1e-4  # in a step: no round-off, nor the highest mode of a free body at its limit
# Growth in a step below which it cannot be told from rounding with certainty.
GROWTH_RESOLUTION = 1e-7
# Relative change by contact below which a motion counts as unaffected by contact.
CONTACT_EFFECT_TOLERANCE = 1e-7
# Largest number of contacts of which every combination is tried, as the number of combinations doubles with each
# contact; of more contacts, none, each one alone and all of them are closed.
MOST_TOGETHER = 3
# Largest number of contacts of which each one is closed alone, as the time grows with their square and more; of more
# contacts, none and all of them are closed.
MOST_ALONE = 30
NONE_AND_ALL = "no contact and all"
# Relative tolerance of the critical step in a search by the black box, where each trial is expensive.
SEARCH_TOLERANCE = 1e-6
# Share of the free step below which a critical step counts as none, as growth may be too slow to show in one step.
SMALLEST_SHARE_OF_FREE_STEP = 1e-4
TOO_SLOW = "the step may grow, too slowly to distinguish from rounding"


@dataclass(frozen=True)
class ClosedStepStability:
    """Stability of the step with a given combination of closed contacts.

    Attributes
    ----------
    radius
        Largest modulus of the eigenvalues left after deflation; nan where the step is not linear.
    theta
        Largest share of the predicted overlap that contact takes back in a step; None unless the contact force follows
        from the predicted overlap alone.
    doubt
        Why the radius is not certain, in words; empty where it is.
    felt_radius
        Above theta = 1 the largest modulus of the motions that contact changes; infinite where it was not computed.
    """

    radius: float
    theta: float | None
    doubt: str = ""
    felt_radius: float = np.inf

    @property
    def linear(self) -> bool:
        """Whether the step is linear in the state with these contacts closed."""
        return not np.isnan(self.radius)

    @property
    def stable(self) -> bool:
        """Whether no growth was found.

        Above theta = 1 growth starts so slowly that a modulus of 1 may hide it, so the motions that contact changes
        must decay there. The other motions are those of free bodies.
        """
        return not self.radius > 1.0 + MARGINAL_DISTANCE and not (
            _above_one(self.theta) and self.felt_radius > 1.0 - MARGINAL_DISTANCE
        )

    @property
    def too_slow_to_tell(self) -> bool:
        """Whether the growth that was found may be one of round-off."""
        return self.theta is None and MARGINAL_DISTANCE < self.radius - 1.0 <= GROWTH_RESOLUTION


def _above_one(theta: float | None) -> bool:
    """Return whether contact takes back more than the predicted overlap."""
    return theta is not None and theta > 1.0 + MARGINAL_DISTANCE


def examine(motions: Motions, dt: float, closed: Sequence[int]) -> ClosedStepStability:
    """Return the stability of the step of length `dt` with the given contacts closed; parameters as of `ClosedStep`."""
    which = _named(motions, closed)
    try:
        step = ClosedStep(motions, dt, closed)
        linear = step.linear()
    except (PercussError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001  A kernel need not be made for overlaps this deep.
        return ClosedStepStability(np.nan, None, f"with {which} held closed a kernel fails ({described(error)})")
    if not linear:
        return ClosedStepStability(np.nan, None, f"the step is not linear with {which} closed")
    found = _stability(step)
    for other in _other_lines(step):
        if not found.stable:
            break
        # Where an open contact attracts less and less, bodies come apart at any step: this is no matter of the step.
        if other.linear() and set(other.acting) <= set(step.closed):
            on_this = _stability(other)
            # A curved force counts as a line up to this tolerance: less growth may be that of its slopes.
            only_curved = on_this.theta is None and on_this.radius <= 1.0 + LINEARITY_TOLERANCE
            if not (on_this.stable or only_curved):
                return on_this
        another = "the step is another one at other overlaps or while they open"
        doubt = f"with {which} closed {another}; on none of these lines growth was found"
        found = dataclasses.replace(found, doubt=doubt)
    return found


def grows_clearly(motions: Motions, dt: float, closed: Sequence[int]) -> bool:
    """Return whether few products show that the step grows with the given contacts closed, as they load or unload.

    It may grow where they do not.
    """
    try:
        step = ClosedStep(motions, dt, closed)
        lines = [step, *itertools.islice(_other_lines(step), 1)]
        return any(_grows_clearly(line) for line in lines if set(line.acting) <= set(closed) and line.linear())
    except (PercussError, MemoryError):
        raise
    except Exception:  # noqa: BLE001  A kernel need not be made for overlaps this deep.
        return False


def _grows_clearly(step: ClosedStep) -> bool:
    idle: Floats = np.kron(np.eye(step.parts), step.motions.without_strain(step.acting)).astype(np.float64)
    if step.parts * step.size <= LARGEST_DENSE_STATE:
        radius = float(np.abs(np.linalg.eigvals(deflated(step.matrix(), idle))).max(initial=0.0))
    else:
        radius = _largest_modulus(step, idle, FEW_RESTARTS)
    return radius > 1.0 + CLEAR_GROWTH


def _named(motions: Motions, closed: Sequence[int]) -> str:
    """Return some contacts in words."""
    return f"contacts {quoted(motions.model.contact_points.names, closed) or 'none'}"


def _other_lines(step: ClosedStep) -> Iterator[ClosedStep]:
    """Yield the steps about other states which are none of the steps about the first, with whichever contacts closed.

    A contact without a force, or with a constant one, is one that is open.
    """
    motions, dt = step.motions, step.model.dt
    if all(bound_law.linear is not None for bound_law in step.model.laws):
        return
    state = np.random.default_rng(2).uniform(-1.0, 1.0, step.parts * step.size)
    images = {tuple(step.acting): step(state)}
    for unit, opening in OTHER_STATES:
        other = ClosedStep(motions, dt, step.closed, unit=unit, opening=opening)
        acting = tuple(other.acting)
        if acting not in images:
            images[acting] = ClosedStep(motions, dt, acting)(state)
        image = images[acting]
        if not np.abs(other(state) - image).max() <= LINEARITY_TOLERANCE * np.abs(image).max():
            yield other


def _stability(step: ClosedStep) -> ClosedStepStability:
    """Return the stability of a linear step, as `examine` does."""
    motions, dt = step.motions, step.model.dt
    one_force = not step.model.multistage and step.model.period == 1
    theta = _theta(step, ClosedStep(motions, dt, ())) if step.closed and one_force else None
    size = step.parts * step.size
    if size > LARGEST_DENSE_STATE and theta is not None and not step.model.facts.forces:
        # Up to theta = 1 the closed step is bounded wherever the free step is.
        return ClosedStepStability(1.0 if motions.operator.factor(4.0 / dt**2) is not None else np.inf, theta)
    idle: Floats = np.kron(np.eye(step.parts), motions.idle(dt, step.acting)).astype(np.float64)
    if size > LARGEST_DENSE_STATE:
        closed = f" with {NONE_AND_ALL} of its contacts closed" if len(motions.not_tied) > MOST_ALONE else ""
        doubt = f"the model is large: growth{closed} was looked for by a Krylov iteration, and none found"
        return ClosedStepStability(_largest_modulus(step, idle), theta, doubt)
    matrix, felt_radius = step.matrix(), np.inf
    without_idle = deflated(matrix, idle)
    if not _above_one(theta):
        values = np.linalg.eigvals(without_idle)
    else:
        values, vectors = np.linalg.eig(without_idle)
        # The gaps of the eigenvectors cannot tell which ones contact changes, because they vanish at theta = 1.
        change = matrix - ClosedStep(motions, dt, ()).matrix()
        felt = np.linalg.norm(change @ vectors, axis=0) > CONTACT_EFFECT_TOLERANCE * np.linalg.norm(change)
        felt_radius = float(np.abs(values[felt]).max(initial=0.0))
    return ClosedStepStability(float(np.abs(values).max(initial=0.0)), theta, felt_radius=felt_radius)


def _theta(closed: ClosedStep, free: ClosedStep) -> float | None:
    """Return theta of a step whose contact force follows from the predicted overlap alone, or None for any other step.

    Such a step is the free step followed by ``I - [X, 0; X, 0]``, where X is symmetric in the weighted displacements
    and zero except between the ends in contact; its determinant is the product of all ``1 - theta`` over the
    eigenvalues theta of X. The largest of them is returned.
    """
    n = closed.size
    ends = np.linalg.qr(closed.motions.gaps.T)[0]
    x = np.zeros((ends.shape[1], ends.shape[1]))
    size = 0.0
    for k, end in enumerate(ends.T):
        velocity = free(np.concatenate([end, np.zeros(n)]))[n:]
        # The closed step starts from the two states that the free step takes to (end, 0) and to (0, end).
        place = closed(np.concatenate([end, -velocity])) - np.concatenate([end, np.zeros(n)])
        rate = closed(np.concatenate([-end, end + velocity])) - np.concatenate([np.zeros(n), end])
        x[:, k] = -ends.T @ place[:n]
        size = max(size, float(np.abs(place).max()))
        local = max(np.abs(place[:n] - place[n:]).max(), np.abs(place[:n] + ends @ x[:, k]).max())
        if max(local, np.abs(rate).max()) > LINEARITY_TOLERANCE * size:
            return None
    if size < LINEARITY_TOLERANCE or np.abs(x - x.T).max() > LINEARITY_TOLERANCE * size:
        return None
    return float(np.linalg.eigvalsh(0.5 * (x + x.T))[-1])


def _largest_modulus(step: ClosedStep, idle: Floats, most_restarts: int = ARNOLDI_RESTARTS) -> float:
    """Return the largest eigenvalue modulus that Arnoldi's iteration finds, or 0 if no eigenvalue converges."""
    size = step.parts * step.size

    def product(state: Floats) -> Floats:
        state = step(state - idle @ (idle.T @ state))
        return state - idle @ (idle.T @ state)

    operator: Any = LinearOperator((size, size), matvec=product, dtype=float)
    search: Any = {"k": 2, "ncv": KRYLOV_VECTORS, "which": "LM", "tol": 1e-9, "return_eigenvectors": False}
    search |= {"v0": np.random.default_rng(0).standard_normal(size), **without_chance(eigs)}
    restarts = most_restarts if size < LARGE_STATE else most_restarts // 2
    values: Any
    try:
        values = eigs(operator, maxiter=restarts, **search)
    except ArpackNoConvergence as stopped:
        values = stopped.eigenvalues
    return float(np.abs(values).max(initial=0.0))


def combinations(count: int) -> list[tuple[int, ...]]:
    """Return the combinations of closed contacts to be tried among `count` contacts, beginning with none closed."""
    contacts = range(count)
    if count <= MOST_TOGETHER:
        return [closed for k in range(count + 1) for closed in itertools.combinations(contacts, k)]
    alone = contacts if count <= MOST_ALONE else ()
    return [(), *((p,) for p in alone), tuple(contacts)]


class BlackBox:
    """Criterion from the amplification matrix of the solver's own step, for any integrator and contact law.

    Parameters
    ----------
    model
        A stretch of a run, `percuss.march.model_of_case.stretches`.
    """

    by: ClassVar[str] = "black-box"

    def __init__(self, model: Model) -> None:
        self.model = model
        self.motions = Motions(model)
        # Whether contacts that share an end differ in eps_m / eps_s, so that growth may set in at any step.
        self._unlike = bool(why_unlike(model))
        self._examined: dict[tuple[float, tuple[int, ...]], ClosedStepStability] = {}

    @cached_property
    def free(self) -> float:
        """Largest step that is stable with no contact closed but ties."""
        return self.motions.operator.free_step() * limit_ratio(self.model)

    @cached_property
    def _combinations(self) -> list[tuple[int, ...]]:
        """Combinations of closed contacts to be tried, ties in each of them.

        Under a multi-stage scheme `free` covers that of no contact, but no load that follows the motion of an end, and
        not what a tie does to the velocities of its ends.
        """
        tied, others = self.model.tied_points, self.motions.not_tied
        closed_sets = [(*tied, *(others[k] for k in closed)) for closed in combinations(len(others))]
        return closed_sets if self.model.stages is None or self.model.facts.forces or tied else closed_sets[1:]

    @property
    def _why_not_all(self) -> str:
        """Why the combinations that are tried are not all; empty if they are."""
        count = len(self.motions.not_tied)
        if count <= MOST_TOGETHER:
            return ""
        tried = NONE_AND_ALL if count > MOST_ALONE else "no contact, each one and all"
        return f"no growth was found with {tried} of them closed; other combinations can be worse"

    def assess_step(self, dt: float) -> Assessment:
        """Return the assessment of a step over the combinations of closed contacts that are tried."""
        if self.model.stages is not None and dt > self.free * (1.0 + MARGINAL_DISTANCE):
            return Assessment("grows")
        doubt, radius = self._why_not_all, -1.0
        theta: float | None = None
        worst: list[int] = []
        for closed in self._combinations:
            found = self._examine(dt, closed)
            if not found.linear:
                return Assessment("unknown", list(closed), doubt=found.doubt)
            theta = max((known for known in (theta, found.theta) if known is not None), default=None)
            not_tied = [p for p in closed if p in self.motions.not_tied]
            if self._unlike and found.too_slow_to_tell:
                too_slow = f"with {_named(self.motions, closed)} closed {TOO_SLOW}"
                return Assessment("unknown", not_tied, theta, too_slow)
            if not found.stable:
                return Assessment("grows", not_tied, theta)
            doubt = found.doubt or doubt
            if found.radius > radius * (1.0 + 1e-6):
                radius, worst = found.radius, not_tied
        doubt = self._why_not_always or doubt
        return Assessment("no growth found" if doubt else "stable", worst, theta, doubt)

    def excess(self, dt: float) -> float:
        """Return -1 where a step is certain to be stable, else 1."""
        found = (self._examine(dt, closed) for closed in self._combinations)
        return -1.0 if not self._why_not_all and all(one.stable and not one.doubt for one in found) else 1.0

    @cached_property
    def _why_not_always(self) -> str:
        """Why the step says nothing of later ones; empty unless the force of a law with a kernel changes with time."""
        end = self.model.whole.steps * self.model.whole.dt
        with_kernel = [one for one in self.model.laws if one.linear is None]
        names = [
            one.law.name
            for one in with_kernel
            if changes_with_time(one.law, one.kernel_data, one.points, self.model.dt, end)
        ]
        return f"{', '.join(names)} changes with time, and no growth was found as it acts at the start" if names else ""

    @cached_property
    def critical_step(self) -> float:
        """Largest stable step within the relative tolerance `SEARCH_TOLERANCE`, or nan where the step is not linear.

        It is nan too where bodies have steps of their own, and 0 where growth only becomes slower at shorter steps.

        A combination of closed contacts that is stable at the free step is taken as stable at all shorter steps.
        """
        at_no_or_any_step = self.free in {0.0, np.inf}
        # Steps of different lengths resonate: a longer step may be stable, and a shorter one not.
        if at_no_or_any_step or self.model.period > 1:
            return self.free if at_no_or_any_step else np.nan
        just_below = self.free * (1.0 - MARGINAL_DISTANCE)
        found = {closed: self._examine(just_below, closed) for closed in self._combinations}
        if not all(one.linear for one in found.values()):
            return np.nan
        unstable = [closed for closed, one in found.items() if not one.stable]
        if not unstable:
            return self.free
        unclear: list[float] = []

        def excess(dt: float) -> float:
            tried = [self._examine(dt, closed) for closed in unstable]
            unclear.extend(dt for one in tried if not one.linear)
            return -1.0 if all(one.linear and one.stable for one in tried) else 1.0

        critical = largest_step(excess, self.free, SEARCH_TOLERANCE)
        if self._unlike and self._only_becomes_slower(critical, unstable):
            return 0.0
        return np.nan if unclear else critical

    def _only_becomes_slower(self, critical: float, unstable: Sequence[tuple[int, ...]]) -> bool:
        """Return whether growth goes on at shorter steps than the one at which it is lost in round-off."""
        if critical < SMALLEST_SHARE_OF_FREE_STEP * self.free:
            return True
        twice = [self._examine(2.0 * critical, closed) for closed in unstable]
        return all(found.stable or found.too_slow_to_tell for found in twice)

    def _examine(self, dt: float, closed: tuple[int, ...]) -> ClosedStepStability:
        """Return the stability of a step, which is kept, as a search ends where an assessment begins."""
        if (dt, closed) not in self._examined:
            self._examined[dt, closed] = examine(self.motions, dt, closed)
        return self._examined[dt, closed]
