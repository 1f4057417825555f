"""The criterion of a Lanczos run, for solids whose matrices take long to factor: it needs the march's products alone.

Closed contacts of laws at the current state add ``N D N^T`` to K, with ``D = (D_s - (4/dt^2) D_m)_+`` for the worst
set. Central difference is stable where the largest eigenvalue of ``M^-1 (K + N D N^T)`` is below ``4/dt^2``. The Ritz
value of a Lanczos run is at most this eigenvalue, so that one above ``4/dt^2`` proves growth. From a random start it
falls short of the eigenvalue by more than a share e, after k products, with a probability of at most
``1.648 sqrt(n) exp(-sqrt(e) (2k - 1))``, n the number of motions [Kuczynski and Wozniakowski, SIAM Journal on Matrix
Analysis and Applications 13 (1992), doi:10.1137/0613066]. A step is called stable where that is below `CHANCE` for what
is missing to ``4/dt^2``.

Laws evaluated at the predicted gap need ``theta <= 1`` besides, of which `percuss.certificate.bounds` has a bound.
"""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from percuss.certificate.assessment import MARGINAL_DISTANCE, Assessment, largest_step_below, signed_distance
from percuss.certificate.bounds import Bounds
from percuss.certificate.closed_laws import closed_laws
from percuss.certificate.matrices import columns_at_nodes, held_throughout
from percuss.mesh.loads import directions_at_nodes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats

CHANCE = 1e-9  # largest probability that a step called stable is not
MARGIN = 0.01  # share of the eigenvalue by which the Ritz value may fall short, but for this chance
MOST_PRODUCTS = 10  # times those for `MARGIN` that are made for a step within it
SEARCHED_TO = 1e-3  # relative, of the longest step
NO_MORE_MOTIONS = 1e-14  # relative size of what is left of a motion where the start has no part in others
TAKING_PART = (1.0, 0.5, 0.1, 0.01)  # of the largest force of a contact in a motion, above which it is named
WITHIN = "it lies so near to the critical one that {} products do not tell them apart; `percuss check` does"
THETA = "theta of contacts evaluated at the predicted gap may be above 1; `percuss check` tells it"


def products_for(margin: float, size: int) -> int:
    """Return the number of products by which a Ritz value falls short by more than `margin` with `CHANCE` at most."""
    return math.ceil(0.5 * (1.0 + math.log(1.648 * math.sqrt(size) / CHANCE) / math.sqrt(margin)))


def why_not_covered(model: Model) -> str:
    """Return why a Lanczos run does not cover a model; empty if it does."""
    bodies = model.bodies
    reasons = {
        "the mass couples nodes": bodies.couples_nodes,
        "an end has no mass": bool((bodies.mass == 0.0).any()),
        "contacts are tied throughout": bool(model.tied_points),
        "bodies have steps of their own": model.period > 1,
        "springs stand at ends": bool(model.facts.springs(model)),
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


class Lanczos:
    """Criterion of one stretch of a run from Lanczos runs, where `Bounds` do not prove its step stable.

    Parameters
    ----------
    model
        A stretch of a run, `percuss.march.model_of_case.stretches`, which `why_not_covered` does not exclude.
    """

    by: ClassVar[str] = "lanczos"

    def __init__(self, model: Model) -> None:
        self.model = model
        self.bounds = Bounds(model)
        self._found: dict[tuple[int, bytes], tuple[float, Floats]] = {}
        self._root = 1.0 / np.sqrt(model.bodies.mass_of_dofs)
        self._moved = np.empty(self._root.size)
        rows = model.contact_points.matrix(model.bodies.n_nodes).tocoo()
        self._touched = np.unique(rows.row)  # by contacts
        self._rows = rows.tocsr()[self._touched]
        self._across = self._rows.T.tocsr()
        held = directions_at_nodes(held_throughout(model))
        pairs = [(node, direction) for node, directions in held.items() for direction in directions]
        self._held = columns_at_nodes(model, [node for node, _ in pairs], [direction for _, direction in pairs])

    def _set_product(self, motion: Floats, stiffness: Floats, out: Floats) -> None:
        """Set `out` to ``M^-1/2 (K + N D N^T) M^-1/2`` times a motion that supports leave free."""
        moved = np.multiply(self._root, motion, out=self._moved)
        self.model.bodies.stiffness_times(moved, out)
        if stiffness.any():
            out[self._touched] += self._rows @ (stiffness * (self._across @ moved[self._touched]))
        out *= self._root
        self._release(out)

    def _release(self, motion: Floats) -> None:
        """Take away what supports hold of a motion."""
        if self._held.shape[1]:
            motion -= self._held @ (self._held.T @ motion)

    def _motions(self, stiffness: Floats, count: int) -> Iterator[tuple[Floats, float, float]]:
        """Yield the motions of a Lanczos run, each with the entries of its matrix on the diagonal and beside it.

        A motion holds until the next is asked for. There is none where supports hold everything.
        """
        now = np.random.default_rng(0).standard_normal(self._root.size)
        self._release(now)
        if (length := np.linalg.norm(now)) <= NO_MORE_MOTIONS * math.sqrt(now.size):
            return
        now /= length
        last, ahead, work, beside = np.zeros(now.size), np.empty(now.size), np.empty(now.size), 0.0
        for _ in range(count):
            self._set_product(now, stiffness, ahead)
            along = float(now @ ahead)
            ahead -= np.multiply(now, along, out=work)
            ahead -= np.multiply(last, beside, out=work)
            beside = float(np.linalg.norm(ahead))
            yield now, along, beside
            if beside <= NO_MORE_MOTIONS * abs(along):
                return
            ahead /= beside
            last, now, ahead = now, ahead, last

    def _highest(self, stiffness: Floats, count: int) -> tuple[float, Floats]:
        """Return the largest Ritz value of `count` products [1/time^2], and the weights of the motions in its motion.

        What was found is kept.
        """
        from scipy.linalg import eigh_tridiagonal

        key = count, stiffness.tobytes()
        if key not in self._found:
            entries = np.array([(along, beside) for _, along, beside in self._motions(stiffness, count)])
            if not entries.size:
                return 0.0, np.zeros(0)
            last = (len(entries) - 1, len(entries) - 1)
            values, vectors = eigh_tridiagonal(entries[:, 0], entries[:-1, 1], select="i", select_range=last)
            self._found[key] = max(float(values[0]), 0.0), vectors[:, 0]
        return self._found[key]

    def _limiting(self, stiffness: Floats, count: int, limit: float) -> list[int]:
        """Return the contacts that push most in the motion of the largest Ritz value and suffice for it to grow."""
        weights = self._highest(stiffness, count)[1]
        motion = sum(w * one for w, (one, *_) in zip(weights, self._motions(stiffness, len(weights)), strict=True))
        force = np.abs(stiffness * (self._across @ (self._root * motion)[self._touched]))
        for share in TAKING_PART:
            named = force > share * force.max(initial=0.0)
            if self._highest(np.where(named, stiffness, 0.0), count)[0] > limit:
                return np.flatnonzero(named).tolist()
        return np.flatnonzero(stiffness).tolist()

    def _limit(self, dt: float) -> float:
        """Return the square of the frequency up to which oscillators are stable at a step [1/time^2]."""
        return 4.0 * (self.bounds.ratio / dt) ** 2

    def _harmful(self, dt: float) -> Floats:
        """Return the stiffness that closed contacts add at a step, less their inertia, (P,)."""
        stiffness, inertia = closed_laws(self.model, dt).at_current_state()
        return np.maximum(stiffness - self._limit(dt) * inertia, 0.0)

    def assess_step(self, dt: float) -> Assessment:
        """Return the assessment of a step: that of the bounds where they prove it stable."""
        found = self.bounds.assess_step(dt)
        theta, doubt = self.bounds.theta(dt)
        if found.stable or doubt:
            return dataclasses.replace(found, by=self.bounds.by)
        limit, harmful, size = self._limit(dt), self._harmful(dt), self._root.size
        count = products_for(MARGIN, size)
        most = MOST_PRODUCTS * count
        while True:
            value, _ = self._highest(harmful, count)
            if value > limit * (1.0 + MARGINAL_DISTANCE):
                return Assessment("grows", self._limiting(harmful, count, limit))
            missing = 1.0 - value / limit
            if missing > 0.0 and products_for(missing, size) <= count:
                stable = theta < 1.0
                return Assessment("stable") if stable else Assessment("unknown", doubt=THETA)
            if count == most:
                return Assessment("unknown", doubt=WITHIN.format(most))
            count = min(most, products_for(missing, size)) if missing > 0.0 else most

    @cached_property
    def free(self) -> float:
        """Step above which the bodies alone are known to be unstable."""
        value, _ = self._highest(np.zeros(len(self.model.contact_points)), products_for(MARGIN, self._root.size))
        return 2.0 * self.bounds.ratio / math.sqrt(value) if value > 0.0 else math.inf

    @cached_property
    def critical_step(self) -> float:
        """Longest step that is stable but for the chance, within `MARGIN`; nan where none is known."""
        if self.bounds.theta(self.bounds.free)[1]:
            return math.nan
        if self.free in {0.0, math.inf}:
            return self.free

        def excess(dt: float) -> float:
            value, _ = self._highest(self._harmful(dt), products_for(MARGIN, self._root.size))
            return signed_distance(value / (1.0 - MARGIN) / self._limit(dt), self.bounds.theta(dt)[0])

        return largest_step_below(excess, self.free * math.sqrt(1.0 - MARGIN), SEARCHED_TO)
