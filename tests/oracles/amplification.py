"""The step of bars in contact as a full matrix, for any set of closed contacts: what certificates are held against.

Written from the formulas of the methods alone, upon the matrices of `dense.py`. One dimension, penalties, `lagrange`
and `tied`; supports, and drives that hold for a time.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from dense import System
from formulas import ends_of_noh_bathe, noh_bathe

CD, WU, NOH_BATHE = "central-difference", "wu-predictor-corrector", "noh-bathe"


class Bodies(System):
    """A case in full matrices, and which of its nodes are held when."""

    def __init__(self, case, mass=None):
        super().__init__(case, mass=mass)
        self.drives = [
            (self.bars.node(load["on"]), load.get("from", 0.0), load.get("until", math.inf))
            for load in case.get("loads", {}).values()
            if "prescribed-velocity" in load
        ]
        self.fixed = set(self.held) - {node for node, *_ in self.drives}

    def held_at(self, time):
        """The nodes whose velocity is prescribed at a time."""
        return self.fixed | {node for node, start, stop in self.drives if start < time < stop}

    def times(self, dt, end):
        """A time in each stretch of the run with drives of its own: in the middle of a step."""
        edges = sorted({0.0, end, *(t for _, start, stop in self.drives for t in (start, stop) if 0.0 < t < end)})
        return [0.5 * (a + b) for a, b in itertools.pairwise(edges) if b - a > 2.0 * dt]


def step_matrix(bodies, integrator, dt, held, closed):
    """The matrix of the step on (u, dt v, and dt^2 a where the scheme keeps it), the given contacts closed."""
    M, K = bodies.bars.M, bodies.bars.K
    free = ~np.isin(np.arange(len(M)), list(held))
    inverse = np.zeros_like(M)
    inverse[np.ix_(free, free)] = np.linalg.inv(M[np.ix_(free, free)])
    # ties act always
    acting = [p for p, law in enumerate(bodies.laws) if p in closed or law["name"] == "tied"]
    n, laws, both = bodies.N[:, acting], [bodies.laws[p] for p in acting], bodies.penalties(dt)
    delassus = n.T @ inverse @ n

    def multipliers(gap, rate, acceleration, look):
        """Solve the contact equation; `look` is how far ahead: the motion of the gap by its rate and acceleration."""
        by_rate, by_acceleration = look
        sigma, weight, right = np.zeros(len(laws)), np.zeros(len(laws)), np.zeros(len(laws))
        ahead = gap + by_rate * rate + by_acceleration * acceleration
        for k, law in enumerate(laws):
            if law["name"] == "lagrange":
                weight[k], right[k] = by_acceleration, -ahead[k]
            elif law["name"] == "tied":  # the rate at the end
                weight[k] = by_acceleration / by_rate
                right[k] = -rate[k] - weight[k] * acceleration[k]
            else:
                stiffness, inertia = both[acting[k]]
                sigma[k], weight[k] = 1.0 / stiffness, inertia / stiffness
                right[k] = -ahead[k] if integrator == WU else -gap[k] - weight[k] * acceleration[k]
        if not laws:
            return np.zeros(0)
        return np.linalg.lstsq(np.diag(sigma) + weight[:, None] * delassus, right, rcond=None)[0]

    def accelerations(u, v, look):
        bulk = -inverse @ (K @ u)
        return bulk + inverse @ (n @ multipliers(n.T @ u, n.T @ v, n.T @ bulk, look))

    def step(u, v, a=None):
        if integrator == NOH_BATHE:
            looks = ends_of_noh_bathe(dt)
            return noh_bathe(lambda u, v, _t, stage: accelerations(u, v, looks[stage]), None, u, v, a, 0.0, dt)
        a = accelerations(u, v, (dt, dt * dt))
        return u + dt * (v + dt * a), v + dt * a

    size, parts = len(M), 3 if integrator == NOH_BATHE else 2
    scale = [1.0, 1.0 / dt, 1.0 / dt**2][:parts]
    keep = np.tile(free, parts)
    columns = []
    for k in np.flatnonzero(keep):
        state = np.zeros((parts, size))
        state[k // size, k % size] = scale[k // size]
        columns.append((np.array(step(*state)) / np.array(scale)[:, None]).ravel()[keep])
    return np.array(columns).T


def radius(bodies, integrator, dt, held, closed):
    """Largest modulus of the eigenvalues of the step."""
    return float(np.abs(np.linalg.eigvals(step_matrix(bodies, integrator, dt, held, closed))).max(initial=0.0))


def subsets(count):
    return [c for k in range(count + 1) for c in itertools.combinations(range(count), k)]


def largest_radius(bodies, integrator, dt, end):
    """The largest radius over all stretches of a run and all subsets of closed contacts, and where it is."""
    found = (-1.0, None, None)
    for time in bodies.times(dt, end):
        held = bodies.held_at(time)
        for closed in subsets(len(bodies.laws)):
            found = max(found, (radius(bodies, integrator, dt, held, closed), time, closed), key=lambda one: one[0])
    return found
