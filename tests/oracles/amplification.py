"""The step of bars in contact as a full matrix, for any set of closed contacts: what certificates are held against.

Written from the formulas of the methods alone; knows nothing of percuss but the layout of a case. One dimension, laws
with absolute penalties (`epsilon_s`, `epsilon_m`), `lagrange` and `tied`; supports, and drives that hold for a time.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

CD, WU, NOH_BATHE = "central-difference", "wu-predictor-corrector", "noh-bathe"


class Bodies:
    """Masses, stiffness and contact normals of a case in full matrices."""

    def __init__(self, case):
        sizes = [bar["bar"]["elements"] + 1 for bar in case["bodies"].values()]
        total = sum(sizes)
        self.stiffness, self.mass, self.node = np.zeros((total, total)), np.zeros(total), {}
        self.fixed, self.frequency, first = set(), 0.0, 0
        for (name, bar), size in zip(case["bodies"].items(), sizes, strict=True):
            h = bar["bar"]["length"] / (size - 1)
            young, density, area = bar["material"]["young"], bar["material"]["density"], bar["area"]
            for e in range(first, first + size - 1):
                self.stiffness[e : e + 2, e : e + 2] += young * area / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
                self.mass[e : e + 2] += 0.5 * density * area * h
            self.node |= {f"{name}.left": first, f"{name}.right": first + size - 1}
            self.fixed |= {self.node[f"{name}.{end}"] for end in bar.get("fixed", [])}
            self.frequency = max(self.frequency, 2.0 * math.sqrt(young / density) / h)
            first += size
        self.laws = [contact.get("method", case["method"]["contact"]) for contact in case["contacts"].values()]
        self.normal = np.zeros((total, len(case["contacts"])))
        for p, contact in enumerate(case["contacts"].values()):
            ends = contact.get("between") or [contact["body"]]
            sign = 1.0 if ends[0].endswith(".right") else -1.0
            for end, side in zip(ends, (-sign, sign), strict=False):
                self.normal[self.node[end], p] = side
        self.drives = [
            (self.node[load["on"]], load.get("from", 0.0), load.get("until", math.inf))
            for load in case.get("loads", {}).values()
            if "prescribed-velocity" in load
        ]

    def held(self, time):
        """The nodes whose velocity is prescribed at a time."""
        return self.fixed | {node for node, start, stop in self.drives if start < time < stop}

    def times(self, dt, end):
        """A time in each stretch of the run with drives of its own: in the middle of a step."""
        edges = sorted({0.0, end, *(t for _, start, stop in self.drives for t in (start, stop) if 0.0 < t < end)})
        return [0.5 * (a + b) for a, b in itertools.pairwise(edges) if b - a > 2.0 * dt]


def kind(law):
    return law if isinstance(law, str) else law["name"]


def responses(laws, closed):
    """Contacts that act: the closed ones, and ties, which act always."""
    return [p for p, law in enumerate(laws) if p in closed or kind(law) == "tied"]


def step_matrix(bodies, integrator, dt, held, closed):
    """The matrix of the step on (u, dt v, and dt^2 a where the scheme keeps it), the given contacts closed."""
    free = np.array([node not in held for node in range(bodies.mass.size)])
    inverse = np.where(free, 1.0 / bodies.mass, 0.0)
    acting = responses(bodies.laws, closed)
    n = bodies.normal[:, acting]
    laws = [bodies.laws[p] for p in acting]
    delassus = n.T @ (inverse[:, None] * n)

    def multipliers(gap, rate, acceleration, look):
        """Solve the contact equation; `look` is how far ahead: gap and rate of an acceleration, and of a rate."""
        by_acceleration, to_rate, by_rate = look
        sigma, weight, right = np.zeros(len(laws)), np.zeros(len(laws)), np.zeros(len(laws))
        ahead = gap + by_rate * rate + by_acceleration * acceleration
        for k, law in enumerate(laws):
            if kind(law) == "lagrange":
                weight[k], right[k] = by_acceleration, -ahead[k]
            elif kind(law) == "tied":
                weight[k], right[k] = to_rate, -(rate[k] + to_rate * acceleration[k])
            else:
                share = law.get("epsilon_m", 0.0) / law["epsilon_s"]
                sigma[k], weight[k] = 1.0 / law["epsilon_s"], share
                right[k] = -ahead[k] if integrator == WU else -gap[k] - share * acceleration[k]
        if not laws:
            return np.zeros(0)
        return np.linalg.lstsq(np.diag(sigma) + weight[:, None] * delassus, right, rcond=None)[0]

    def accelerations(u, v, look):
        bulk = -inverse * (bodies.stiffness @ u)
        return bulk + inverse * (n @ multipliers(n.T @ u, n.T @ v, n.T @ bulk, look))

    def leap_frog(u, v):
        a = accelerations(u, v, (dt * dt, dt, dt))
        return u + dt * (v + dt * a), v + dt * a

    def noh_bathe(u, v, a, p=0.54):
        q1 = (1 - 2 * p) / (2 * p * (1 - p))
        q2 = 0.5 - p * q1
        q0 = 0.5 - q1 - q2
        d, e = p * dt, (1 - p) * dt
        looks = [(0.5 * e * e, 0.5 * e, e), ((e * q2 + 0.5 * d) * d, e * q2 + 0.5 * d, d)]
        u = u + d * v + 0.5 * d * d * a
        v = v + 0.5 * d * a
        between = accelerations(u, v, looks[0])
        v = v + 0.5 * d * between
        u = u + e * v + 0.5 * e * e * between
        v = v + e * (q0 * a + (0.5 + q1) * between)
        last = accelerations(u, v, looks[1])
        return u, v + e * q2 * last, last

    size, parts = bodies.mass.size, 3 if integrator == NOH_BATHE else 2
    scale = [1.0, 1.0 / dt, 1.0 / dt**2][:parts]
    keep = np.tile(free, parts)
    columns = []
    for k in np.flatnonzero(keep):
        state = np.zeros((parts, size))
        state[k // size, k % size] = scale[k // size]
        made = noh_bathe(*state) if integrator == NOH_BATHE else leap_frog(*state)
        columns.append((np.array(made) / np.array(scale)[:, None]).ravel()[keep])
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
        held = bodies.held(time)
        for closed in subsets(len(bodies.laws)):
            found = max(found, (radius(bodies, integrator, dt, held, closed), time, closed), key=lambda one: one[0])
    return found
