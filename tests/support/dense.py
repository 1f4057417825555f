"""Rows of bars with contact, marched with full matrices and `numpy.linalg.solve`: what the methods are held against.

Written from the formulas alone and knowing nothing of percuss but the layout of a case: a mapping in, histories out.
One dimension, bars along x; ends fixed or driven at a constant velocity, constant forces on ends, gravity, walls.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Bars:
    """All bars in full matrices; `start` and `stop` are each bar's first node and one past its last."""

    K: np.ndarray
    M: np.ndarray
    x: np.ndarray
    v: np.ndarray
    start: dict[str, int] = field(default_factory=dict)
    stop: dict[str, int] = field(default_factory=dict)
    lengths: dict[str, np.ndarray] = field(default_factory=dict)
    given: dict[str, dict] = field(default_factory=dict)

    def node(self, address):
        body, _, end = address.partition(".")
        return self.start[body] if end == "left" else self.stop[body] - 1

    def end(self, address):
        """Return EA/h, 2c/h and rho A h / 2 of the element at an end."""
        body, _, end = address.partition(".")
        one = self.given[body]
        h = self.lengths[body][0 if end == "left" else -1]
        young, rho, area = one["material"]["young"], one["material"]["density"], one["area"]
        return young * area / h, 2.0 * math.sqrt(young / rho) / h, 0.5 * rho * area * h


@dataclass
class Outcome:
    """Histories at t_n, n = 0 ... N: forces and gaps (time, contact), displacements and velocities (time, node)."""

    bars: Bars
    dt: float
    force: np.ndarray
    gap: np.ndarray
    end_force: np.ndarray
    u: np.ndarray
    v: np.ndarray
    energy: np.ndarray  # at t_n+1/2
    penalties: list[tuple[float, float]]

    def displacement(self, address):
        return self.u[:, self.bars.node(address)]

    def velocity(self, address):
        return self.v[:, self.bars.node(address)]


def lengths_of(bar, refine=1):
    n = bar["elements"] * refine
    if n == 1 or bar.get("grading", 1.0) == 1.0:
        return np.full(n, bar["length"] / n)
    h = bar["grading"] ** (np.arange(n) / (n - 1))
    return h * bar["length"] / h.sum()


def assemble(case):
    sizes = {name: lengths_of(one["bar"], case.get("refine", 1)) for name, one in case["bodies"].items()}
    total = sum(h.size + 1 for h in sizes.values())
    bars = Bars(np.zeros((total, total)), np.zeros((total, total)), np.zeros(total), np.zeros(total))
    bars.given = case["bodies"]
    at = 0
    for name, one in case["bodies"].items():
        h = sizes[name]
        bars.lengths[name], bars.start[name], bars.stop[name] = h, at, at + h.size + 1
        young, rho, area = one["material"]["young"], one["material"]["density"], one["area"]
        for e in range(h.size):
            i = at + e
            bars.K[i : i + 2, i : i + 2] += young * area / h[e] * np.array([[1.0, -1.0], [-1.0, 1.0]])
            bars.M[i : i + 2, i : i + 2] += 0.5 * rho * area * h[e] * np.eye(2)
        bars.x[at : at + h.size + 1] = one.get("at", 0.0) + np.append(0.0, np.cumsum(h))
        bars.v[at : at + h.size + 1] = one.get("velocity", 0.0)
        at += h.size + 1
    return bars


def penalties(law, sides, dt):
    """Return eps_s and eps_m of a contact between `sides`, each (EA/h, 2c/h, rho A h / 2)."""
    softest = min(sides)
    eps_s = law["epsilon_s"] if "epsilon_s" in law else law["beta_s"] * softest[0]
    if law["name"] == "penalty":
        return eps_s, 0.0
    if "epsilon_m" in law:
        return eps_s, law["epsilon_m"]
    if "beta_m" in law:
        return eps_s, law["beta_m"] * softest[2]
    ratio = law.get("ratio", "matched")
    if ratio in {"matched", "free-step"}:
        return eps_s, eps_s * dt**2 * (1.0 if ratio == "matched" else 0.25)
    return eps_s, eps_s / (ratio * min(side[1] for side in sides) ** 2)


def constrained(A, b, N, g, S):
    """Solve A a = b + N x, 0 <= x, g + S' a >= 0, x . (g + S' a) = 0 by trying every active set.

    `S` maps a to the gaps: gaps = g + S.T @ a.
    """
    count = N.shape[1]
    solved = np.linalg.solve(A, np.column_stack([b, N]))
    free, pushed = solved[:, 0], solved[:, 1:]
    own, shares = g + S.T @ free, S.T @ pushed  # gaps without x, and what each x adds to them
    scale = np.abs(g).max(initial=0.0) + np.abs(own - g).max(initial=0.0) + 1e-300
    best = None
    for size in range(count + 1):
        for some in itertools.combinations(range(count), size):
            active = list(some)
            x = np.zeros(count)
            if active:
                x[active] = np.linalg.solve(shares[np.ix_(active, active)], -own[active])
            gaps = own + shares @ x
            miss = max(-x.min(initial=0.0) * np.abs(shares).max(initial=0.0), -gaps.min(initial=0.0))
            if best is None or miss < best[0] - 1e-14 * scale:
                best = (miss, free + pushed @ x, x)
    assert best[0] <= 1e-10 * scale, "no active set satisfies the conditions"
    return best[1], best[2]


def march(case, integrator=None, contact=None, mass=None):
    """March a case given as a mapping; `integrator` (a name) and `contact` (a mapping) replace its own.

    `mass` gives another mass matrix than the lumped one, from the bars.
    """
    bars = assemble(case)
    if mass is not None:
        bars.M = mass(bars)
    method = case.get("method", {})
    integrator = integrator or method["integrator"]
    fastest = max(2.0 * math.sqrt(b["material"]["young"] / b["material"]["density"]) / bars.lengths[n].min()
                  for n, b in case["bodies"].items())  # fmt: skip
    time = case["time"]
    dt = time["step"] if "step" in time else time["courant"] * 2.0 / fastest
    steps = time["steps"] if "steps" in time else max(1, math.ceil(time["end"] / dt * (1 - 1e-12) - 1e-9))
    total = bars.x.size

    # what holds, what pushes
    held = {}
    for name, one in case["bodies"].items():
        for end in one.get("fixed", ()):
            held[bars.node(f"{name}.{end}")] = 0.0
    force, weight = np.zeros(total), np.zeros(total)
    for load in case.get("loads", {}).values():
        if "gravity" in load:
            weight += bars.M @ np.full(total, load["gravity"])
        elif "prescribed-velocity" in load:
            held[bars.node(load["on"])] = load["prescribed-velocity"]
        else:
            force[bars.node(load["on"])] += load["constant"]
    # a body with a step of its own feels its forces in every m-th step, m-fold
    own = np.ones(total, dtype=int)
    if integrator == "asynchronous":
        for name, one in case["bodies"].items():
            frequency = (
                2.0 * math.sqrt(one["material"]["young"] / one["material"]["density"]) / bars.lengths[name].min()
            )
            own[bars.start[name] : bars.stop[name]] = math.floor(fastest / frequency * (1.0 + 1e-9))
    free = np.array([i for i in range(total) if i not in held])
    prescribed = np.array(list(held), dtype=int)

    # contacts: columns of N and gaps
    contacts = case.get("contacts", {})
    N, g0, laws = np.zeros((total, len(contacts))), np.zeros(len(contacts)), []
    for k, one in enumerate(contacts.values()):
        law = contact or one.get("method") or method["contact"]
        laws.append({"name": law} if isinstance(law, str) else law)
        ends = one["between"] if "between" in one else [one["body"]]
        sign = 1.0 if ends[0].endswith(".right") else -1.0
        here = bars.node(ends[0])
        N[here, k] = -sign
        if len(ends) == 2:
            N[bars.node(ends[1]), k] = sign
            g0[k] = sign * (bars.x[bars.node(ends[1])] - bars.x[here])
        else:
            g0[k] = sign * (one["wall"] - bars.x[here])
        smallest = min(bars.lengths[e.partition(".")[0]][0 if e.endswith("left") else -1] for e in ends)
        g0[k] = 0.0 if abs(g0[k]) <= 1e-9 * smallest else g0[k]
    both = [
        (0.0, 0.0)
        if law["name"] == "lagrange"
        else penalties(law, [bars.end(e) for e in one.get("between", [one.get("body")])], dt)
        for law, one in zip(laws, contacts.values(), strict=True)
    ]
    exact = np.array([law["name"] == "lagrange" for law in laws], dtype=bool)

    v0 = bars.v.copy()
    u = np.zeros(total)
    for node, value in held.items():
        v0[node] = value
    v = v0.copy()
    v[free] -= 0.5 * dt * np.linalg.solve(bars.M[np.ix_(free, free)], (force + own * weight)[free])
    for node, value in held.items():
        v[node] = value
    Mf, Nf = bars.M[np.ix_(free, free)], N[free]
    out = {name: [] for name in ("force", "gap", "end_force", "u", "v", "energy")}
    for n in range(steps + 1):
        bulk = (force + np.where(n % own == 0, own, 0) * (weight - bars.K @ u))[free]
        drift = np.zeros(total)  # motion of this step without contact
        drift[free] = v[free] + dt * np.linalg.solve(Mf, bulk)
        for node, value in held.items():
            drift[node] = value
        predicted = u + dt * drift
        gap, gap_predicted = g0 + N.T @ u, g0 + N.T @ predicted
        current = integrator in {"central-difference", "asynchronous"}
        judged = gap if current else gap_predicted
        active = [k for k in range(len(laws)) if not exact[k] and judged[k] < 0.0]
        K_p, M_p = np.zeros((free.size, free.size)), np.zeros((free.size, free.size))
        push = np.zeros(free.size)
        for k in active:
            eps_s, eps_m = both[k]
            M_p += eps_m * np.outer(Nf[:, k], Nf[:, k])
            push -= eps_s * judged[k] * Nf[:, k]
            K_p += eps_s * np.outer(Nf[:, k], Nf[:, k])
        lam = np.zeros(len(laws))
        some = np.flatnonzero(exact)
        if current:
            # the whole acceleration at once; exact contacts see the end of the step
            right = bulk + push
            start = g0 + N.T @ (u + dt * np.where(np.isin(np.arange(total), prescribed), drift, v))
            a, x = constrained(Mf + M_p, right, Nf[:, some], start[some], dt * dt * Nf[:, some])
            contact_part = a
        else:
            a, x = constrained(Mf + M_p, push, Nf[:, some], gap_predicted[some], dt * dt * Nf[:, some])
            contact_part = a
            a = np.linalg.solve(Mf, bulk) + a
        lam[some] = x
        for k in active:
            eps_s, eps_m = both[k]
            lam[k] = -eps_s * judged[k] - eps_m * Nf[:, k] @ contact_part
        after = drift.copy()
        after[free] = v[free] + dt * a
        u_next = u + dt * after
        gap_next = g0 + N.T @ u_next
        out["force"].append(lam)
        out["gap"].append(gap)
        out["end_force"].append([np.nan if exact[k] else both[k][0] * max(-gap_next[k], 0.0) for k in range(len(laws))])
        out["u"].append(u)
        out["v"].append(0.5 * (v + after))
        ahead = u_next + (-(n + 1) % own) * dt * after  # at the next action of the forces of the body
        out["energy"].append(0.5 * after @ bars.M @ after + 0.5 * (ahead - own * dt * after) @ bars.K @ ahead)
        u, v = u_next, after
    return Outcome(bars, dt, *(np.array(out[n]) for n in ("force", "gap", "end_force", "u", "v", "energy")), both)
