"""Rows of bars with contact, marched with full matrices and `numpy.linalg.solve`: what the methods are held against.

Written from the formulas alone and knowing nothing of percuss but the layout of a case: a mapping in, histories out.
One dimension, bars along x; ends fixed or driven, forces on ends, gravity, walls. Leap-frog schemes take drives of
constant velocity alone. The formulas of schemes and laws are those of `formulas.py`.
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


def lengths_of(bar):
    n = bar["elements"]
    if n == 1 or bar.get("grading", 1.0) == 1.0:
        return np.full(n, bar["length"] / n)
    h = bar["grading"] ** (np.arange(n) / (n - 1))
    return h * bar["length"] / h.sum()


def assemble(case):
    sizes = {name: lengths_of(one["bar"]) for name, one in case["bodies"].items()}
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
    ratio = law.get("ratio", "matched")
    if ratio in {"matched", "free-step"}:
        return eps_s, eps_s * dt**2 * (1.0 if ratio == "matched" else 0.25)
    return eps_s, eps_s / (ratio * min(side[1] for side in sides) ** 2)


def complementary(S, gaps):
    """Solve 0 <= x, gaps + S x >= 0, x . (gaps + S x) = 0 by trying every active set."""
    scale, best = np.abs(gaps).max(initial=0.0) + 1e-300, None
    for size in range(gaps.size + 1):
        for active in map(list, itertools.combinations(range(gaps.size), size)):
            x = np.zeros(gaps.size)
            if active:
                x[active] = np.linalg.solve(S[np.ix_(active, active)], -gaps[active])
            miss = max(-x.min(initial=0.0) * np.abs(S).max(initial=0.0), -(gaps + S @ x).min(initial=0.0))
            if best is None or miss < best[0] - 1e-14 * scale:
                best = (miss, x)
    assert best[0] <= 1e-10 * scale, "no active set satisfies the conditions"
    return best[1]


def of_time(load):
    """Return the value of a load as a function of time."""
    if "half-sine" in load:
        pulse = load["half-sine"]
        peak, duration = pulse["peak"], pulse["duration"]
        return lambda t: peak * math.sin(math.pi * t / duration) if 0.0 <= t < duration else 0.0
    if "harmonic" in load:
        wave = load["harmonic"]
        return lambda t: wave.get("mean", 0.0) + wave["value"] * math.sin(2.0 * math.pi * wave["frequency"] * t)
    value = load["constant"] if "constant" in load else load["prescribed-velocity"]
    return lambda t: value


class System:
    """A case in full matrices: what holds its nodes, what pushes them, normals, gaps and laws of its contacts.

    `contact` is the law of all contacts without one of their own, `mass` another mass matrix, from the bars.
    """

    def __init__(self, case, contact=None, mass=None):
        self.bars = bars = assemble(case)
        if mass is not None:
            bars.M = mass(bars)
        total = bars.x.size
        self.held = {bars.node(f"{name}.{end}"): lambda t: 0.0
                     for name, one in case["bodies"].items() for end in one.get("fixed", ())}  # fmt: skip
        self.weight, self.pushes = np.zeros(total), []
        for load in case.get("loads", {}).values():
            if "gravity" in load:
                self.weight += bars.M @ np.full(total, load["gravity"])
            elif "prescribed-velocity" in load or load.get("as") == "velocity":
                self.held[bars.node(load["on"])] = of_time(load)
            else:
                self.pushes.append((bars.node(load["on"]), of_time(load)))
        self.free = np.array([i for i in range(total) if i not in self.held])
        self.driven = np.array(list(self.held), dtype=int)
        contacts = case.get("contacts", {})
        self.N, self.g0 = np.zeros((total, len(contacts))), np.zeros(len(contacts))
        self.laws, self.ends = [], []
        for k, one in enumerate(contacts.values()):
            law = contact or one.get("method") or case["method"]["contact"]
            self.laws.append({"name": law} if isinstance(law, str) else law)
            ends = one["between"] if "between" in one else [one["body"]]
            self.ends.append(ends)
            sign = 1.0 if ends[0].endswith(".right") else -1.0
            here = bars.node(ends[0])
            self.N[here, k] = -sign
            if len(ends) == 2:
                self.N[bars.node(ends[1]), k] = sign
            gap = sign * ((bars.x[bars.node(ends[1])] if len(ends) == 2 else one["wall"]) - bars.x[here])
            smallest = min(bars.lengths[e.partition(".")[0]][0 if e.endswith("left") else -1] for e in ends)
            self.g0[k] = 0.0 if abs(gap) <= 1e-9 * smallest else gap
        self.exact = np.array([law["name"] == "lagrange" for law in self.laws], dtype=bool)
        # of the smallest element of each body: c/h, whose inverse is the step at a Courant number of 1
        self.fastest = {name: math.sqrt(b["material"]["young"] / b["material"]["density"]) / bars.lengths[name].min()
                        for name, b in case["bodies"].items()}  # fmt: skip
        self.Mf, self.Nf = bars.M[np.ix_(self.free, self.free)], self.N[self.free]

    def force(self, t):
        """Return the forces on ends at a time."""
        out = np.zeros(self.bars.x.size)
        for node, value in self.pushes:
            out[node] += value(t)
        return out

    def penalties(self, dt):
        """Return eps_s and eps_m of each contact; a side that is held or driven is rigid."""
        moving = [[end for end in ends if self.bars.node(end) not in self.held] or ends for ends in self.ends]
        return [
            penalties(law, [self.bars.end(end) for end in ends], dt)
            if law["name"] in {"penalty", "bipenalty"}
            else (0, 0)
            for law, ends in zip(self.laws, moving, strict=True)
        ]

    def answer(self, bulk, eps, judged, ahead, share, rest=0.0):
        """Return accelerations of the free nodes under `bulk` and contact, and the contact forces.

        Penalties press where `judged` is negative, their masses feel the gap accelerate by ``N' a + rest``. Exact
        contacts keep ``ahead + share N' a`` from being negative.
        """
        active = [k for k in range(len(self.laws)) if not self.exact[k] and judged[k] < 0.0]
        rest = np.broadcast_to(rest, len(self.laws))
        mass, right = self.Mf.copy(), bulk.copy()
        for k in active:
            mass += eps[k][1] * np.outer(self.Nf[:, k], self.Nf[:, k])
            right -= (eps[k][0] * judged[k] + eps[k][1] * rest[k]) * self.Nf[:, k]
        some, force = np.flatnonzero(self.exact), np.zeros(len(self.laws))
        solved = np.linalg.solve(mass, np.column_stack([right, self.Nf[:, some]]))
        free, pushed, rows = solved[:, 0], solved[:, 1:], share * self.Nf[:, some].T
        force[some] = complementary(rows @ pushed, ahead[some] + rows @ free)
        a = free + pushed @ force[some]
        for k in active:
            force[k] = -eps[k][0] * judged[k] - eps[k][1] * (self.Nf[:, k] @ a + rest[k])
        return a, force


def march(case, mass=None, law=None, viscosity=0.0):
    """March a case by a leap-frog scheme.

    `law` gives all contact forces instead: from the gaps before, now and after a step without contact, the motion of
    each gap in a step under a force of 1 on it alone, the step and the displacement. `viscosity` is that of strain
    rates, over the step.
    """
    system = System(case, mass=mass)
    bars, free, N, g0 = system.bars, system.free, system.N, system.g0
    integrator, fastest, time = case["method"]["integrator"], max(system.fastest.values()), case["time"]
    dt = time["step"] if "step" in time else time["courant"] / fastest
    steps = time["steps"] if "steps" in time else max(1, math.ceil(time["end"] / dt * (1 - 1e-12) - 1e-9))
    total = bars.x.size
    # a body with a step of its own feels its forces in every m-th step, m-fold
    own = np.ones(total, dtype=int)
    if integrator == "asynchronous":
        for name, frequency in system.fastest.items():
            own[bars.start[name] : bars.stop[name]] = math.floor(fastest / frequency * (1.0 + 1e-9))
    current = integrator != "wu-predictor-corrector"
    both = system.penalties(dt)
    w = dt**2 * np.einsum("ip,ip->p", system.Nf, np.linalg.solve(system.Mf, system.Nf))

    def hold(v, t):
        for node, value in system.held.items():
            v[node] = value(t)
        return v

    u, v = np.zeros(total), hold(bars.v.copy(), 0.0)
    v[free] -= 0.5 * dt * np.linalg.solve(system.Mf, (system.force(0.0) + own * system.weight)[free])
    out = {name: [] for name in ("force", "gap", "end_force", "u", "v", "energy")}
    for n in range(steps + 1):
        inner = bars.K @ (u + viscosity * dt * v)
        bulk = (system.force(n * dt) + np.where(n % own == 0, own, 0) * (system.weight - inner))[free]
        drift = hold(np.zeros(total), n * dt)  # motion of this step without contact
        drift[free] = v[free] + dt * np.linalg.solve(system.Mf, bulk)
        gap, predicted = g0 + N.T @ u, g0 + N.T @ (u + dt * drift)
        if law is not None:
            lam = law(g0 + N.T @ (u - dt * v), gap, predicted, w, dt, u)
            a = np.linalg.solve(system.Mf, bulk + system.Nf @ lam)
        elif current:  # the whole acceleration at once; exact contacts see the end of the step
            ahead = g0 + N.T @ (u + dt * hold(v.copy(), n * dt))
            a, lam = system.answer(bulk, both, gap, ahead, dt * dt)
        else:
            a, lam = system.answer(0.0 * bulk, both, predicted, predicted, dt * dt)
            a = np.linalg.solve(system.Mf, bulk) + a
        after = drift.copy()
        after[free] = v[free] + dt * a
        u_next = u + dt * after
        over = np.maximum(-(g0 + N.T @ u_next), 0.0)
        out["force"].append(lam)
        out["gap"].append(gap)
        out["end_force"].append(np.where(system.exact, np.nan, [eps_s for eps_s, _ in both] * over))
        out["u"].append(u)
        out["v"].append(0.5 * (v + after))
        ahead = u_next + (-(n + 1) % own) * dt * after  # at the next action of the forces of the body
        out["energy"].append(0.5 * after @ bars.M @ after + 0.5 * (ahead - own * dt * after) @ bars.K @ ahead)
        u, v = u_next, after
    return Outcome(bars, dt, *(np.array(out[n]) for n in ("force", "gap", "end_force", "u", "v", "energy")))


START = -1  # instead of a stage, the last one: the acceleration that is kept before the first step


def march_stages(case, scheme, steps, dt, law=None, mass=None):
    """March a case by a multi-stage scheme of `formulas.py`; return the bars, displacements and velocities at t_n.

    `law` gives the contact forces from the gaps of a stage instead of the law of the case, `mass` another mass matrix.
    """
    system = System(case, mass=mass)
    bars, free, N = system.bars, system.free, system.N
    both, now = system.penalties(dt), [0.0]

    def accelerations(u, v, t, stage):
        bulk = (system.force(t) + system.weight - bars.K @ u)[free]
        a = np.zeros(bars.x.size)
        for node, value in system.held.items():
            a[node] = (value(now[0] + dt) - value(now[0])) / dt
        gap = system.g0 + N.T @ u
        if law is not None:
            a[free] = np.linalg.solve(system.Mf, bulk + system.Nf @ law(gap))
            return a
        ahead, share = gap, 0.0
        if system.exact.any():
            r_v, share = scheme.start(dt) if stage == START and scheme.start else scheme.ends(dt)[stage]
            ahead = gap + N.T @ (r_v * v + share * a)
        a[free], _ = system.answer(bulk, both, gap, ahead, share, N.T @ a)
        return a

    def internal(u):
        f = np.zeros(u.size)
        f[free] = np.linalg.solve(system.Mf, (bars.K @ u)[free])
        return f

    u, v = np.zeros(bars.x.size), bars.v.copy()
    for node, value in system.held.items():
        v[node] = value(0.0)
    a = accelerations(u, v, 0.0, START)
    out = []
    for n in range(steps + 1):
        out.append((u, v))
        now[0] = n * dt
        after, speed, a = scheme.step(accelerations, internal, u, v, a, n * dt, dt)
        for node, value in system.held.items():
            early, late = value(n * dt), value((n + 1) * dt)
            after[node], speed[node] = u[node] + dt / 2 * (early + late), late
        u, v = after, speed
    return bars, np.array([one for one, _ in out]), np.array([one for _, one in out])
