"""One table of formulas: multi-stage schemes and contact laws, each as its source writes it, in a few lines.

A scheme makes one step of displacement, velocity and what it keeps. A law is a function of gaps alone: before a step,
now, and after a step without contact, with the motion `w` of the gap in a step under a force of 1. The sources' own
figures were not at hand, but for what the tests quote; the rest is derived from the published formulas.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

# ------------------------------------------------------------------------------------------------------- schemes

# A(u, v, t, stage) are the accelerations, F(u) those of the internal forces alone; `a` is what a scheme keeps.


def newmark(A, _F, u, v, a, t, dt, gamma=0.5):
    u = u + dt * v + dt**2 / 2 * a
    after = A(u, v + dt * (1 - gamma) * a, t + dt, 0)
    return u, v + dt * ((1 - gamma) * a + gamma * after), after


def tchamwa_wielgosz(A, _F, u, v, a, t, dt, phi=1.033):
    now = A(u, v, t, 0)
    return u + dt * v + phi * dt**2 * now, v + dt * now, a


def chung_lee(A, _F, u, v, a, t, dt, beta=28 / 27):
    now = A(u, v, t, 0)
    return u + dt * v + dt**2 * ((0.5 - beta) * a + beta * now), v + dt * (1.5 * now - 0.5 * a), now


def hulbert_chung(A, _F, u, v, a, t, dt, rho_b=0.4):
    m = (2 * rho_b - 1) / (1 + rho_b)
    b, g = (5 - 3 * rho_b) / (1 + rho_b) ** 2 / (2 - rho_b), 1.5 - m
    after = (A(u, v, t, 0) - m * a) / (1 - m)
    return u + dt * v + dt**2 * ((0.5 - b) * a + b * after), v + dt * ((1 - g) * a + g * after), after


def explicit_hht(A, _F, u, v, a, t, dt, alpha=-0.1):
    b, g = (1 - alpha) ** 2 / 4, 0.5 - alpha
    predicted = u + dt * v + (0.5 - b) * dt**2 * a
    after = A((1 + alpha) * predicted - alpha * u, v, t + (1 + alpha) * dt, 0)
    return predicted + b * dt**2 * after, v + dt * ((1 - g) * a + g * after), after


def noh_bathe(A, _F, u, v, a, t, dt, p=0.54):
    q1 = (1 - 2 * p) / (2 * p * (1 - p))
    q2 = 0.5 - p * q1
    q0 = -q1 - q2 + 0.5
    d, e = p * dt, (1 - p) * dt
    up = u + d * v + d**2 / 2 * a
    ap = A(up, v + d / 2 * a, t + d, 0)
    vp = v + d / 2 * (a + ap)
    u1 = up + e * vp + e**2 / 2 * ap
    hat = vp + e * (q0 * a + (0.5 + q1) * ap)
    a1 = A(u1, hat, t + dt, 1)
    return u1, hat + e * q2 * a1, a1


def ends_of_noh_bathe(dt, p=0.54):
    q2 = 0.5 - p * (1 - 2 * p) / (2 * p * (1 - p))
    return [((1 - p) * dt, (1 - p) * dt**2 / 2), (p * dt, p * dt * (1 - p) * dt * q2 + (p * dt) ** 2 / 2)]


def force_gradient(A, F, u, v, a, t, dt):
    """Chin's algorithm A from exp(dt/6 V) exp(dt/2 T) exp(2/3 dt V~), for linear forces."""
    v = v + dt / 6 * a
    u = u + dt / 2 * v
    a = A(u, v, t + dt / 2, 0)
    v = v + 2 / 3 * dt * (a - dt**2 / 24 * F(a))
    u = u + dt / 2 * v
    a = A(u, v, t + dt, 1)
    return u, v + dt / 6 * a, a


class Scheme(NamedTuple):
    """A step, what an exact contact looks ahead to in each stage (factors of v and a), and before the first step."""

    step: Callable[..., Any]
    ends: Callable[[float], list[tuple[float, float]]] | None = None
    start: Callable[[float], tuple[float, float]] | None = None


def half_step(dt, p=1.0):
    return p * dt, (p * dt) ** 2 / 2


SCHEMES = {
    "velocity-verlet": Scheme(newmark, lambda dt: [(dt, dt**2)], half_step),
    "explicit-newmark": Scheme(newmark, lambda dt: [(dt, dt**2)], half_step),
    "tchamwa-wielgosz": Scheme(tchamwa_wielgosz, lambda dt: [(dt, 1.033 * dt**2)]),
    "chung-lee": Scheme(chung_lee),
    "hulbert-chung": Scheme(hulbert_chung),
    "explicit-hht": Scheme(explicit_hht),
    "noh-bathe": Scheme(noh_bathe, ends_of_noh_bathe, functools.partial(half_step, p=0.54)),
    "force-gradient": Scheme(force_gradient),  # the example of the page of integrators
}


def amplification(step, x, **options):
    """Return what a step makes of (u, dt v, dt^2 a) of an oscillator with (omega dt)^2 = x."""
    columns = np.eye(3)
    made = step(lambda u, *_: -x * u, lambda u: x * u, *columns, 0.0, 1.0, **options)
    return np.array(made)


# ---------------------------------------------------------------------------------------------------------- laws

STIFFNESS = 60.0  # eps_s of all laws of the table
ITERATIONS = 3
DAMPING = 0.2
CLEARANCE, PRESSURE = 3e-3, 0.02


def pressed(e):
    """Return the law of Paoli and Schatzman: free + e before is the gap that must not be negative."""
    return lambda before, _now, free, w, _dt: max(-(free + e * before) / w, 0.0)


def impact(e, gate):
    """Return an impact law at velocities: after the step the gap opens with -e times its rate before it."""

    def law(before, now, free, w, _dt):
        if (now if gate == "current" else free) >= 0.0:
            return 0.0
        return max(-((free - now) + e * (now - before)) / w, 0.0)

    return law


def regularised(_before, _now, free, w, _dt):
    return max(-free / (w + 1.0 / STIFFNESS), 0.0)


def uzawa(_before, _now, free, w, _dt):
    force = 0.0
    for _ in range(ITERATIONS):
        force = max(force - STIFFNESS * (free + w * force), 0.0)
    return force


def damped(predicted):
    def law(before, now, free, w, dt):
        gap, rate = (free, (free - now) / dt) if predicted else (now, (now - before) / dt)
        critical = 2.0 * math.sqrt(STIFFNESS * dt**2 / w)
        return max(-STIFFNESS * gap - DAMPING * critical * rate, 0.0) if gap < 0.0 else 0.0

    return law


def potential(gap):
    return 0.5 * STIFFNESS * min(gap, 0.0) ** 2


def conserving(before, _now, free, w, _dt):
    """The force is the difference quotient of a potential over two steps."""

    def residual(force):  # the quotient itself, at equal gaps the derivative
        after = free + w * force
        step = after - before
        slope = (potential(after) - potential(before)) / step if abs(step) > 1e-9 else STIFFNESS * min(after, 0.0)
        return force + slope

    if residual(0.0) >= 0.0:
        return 0.0
    return brentq(residual, 0.0, STIFFNESS * (abs(free) + abs(before)), xtol=1e-18, rtol=1e-15)


def softened(_before, now, _free, _w, _dt):
    """The exponential law up to the gap at which its slope is the stiffness, and the tangent from there on."""
    x = max(1.0 - now / CLEARANCE, 0.0)
    scale = PRESSURE / (math.e - 1.0)
    end = brentq(lambda y: scale / CLEARANCE * (math.exp(y) * (1.0 + y) - 1.0) - STIFFNESS, 0.0, 50.0, xtol=1e-15)
    soft = min(x, end)
    return scale * soft * (math.exp(soft) - 1.0) + STIFFNESS * CLEARANCE * (x - soft)


STIFF = {"epsilon_s": STIFFNESS}
SOFTENED = {"name": "softened-penalty", "clearance": CLEARANCE, "pressure": PRESSURE}
LAWS = {
    "softened": (SOFTENED | STIFF, softened),
    "regularised": ({"name": "regularised-lagrange", **STIFF}, regularised),
    "uzawa": ({"name": "uzawa", **STIFF, "iterations": ITERATIONS}, uzawa),
    "damped": ({"name": "damped-penalty", **STIFF, "damping": DAMPING}, damped(predicted=False)),
    "damped, predicted": ({"name": "damped-penalty", **STIFF, "damping": DAMPING}, damped(predicted=True)),
    "conserving": ({"name": "energy-conserving-penalty", **STIFF}, conserving),
    "impact 0": ({"name": "moreau-jean"}, impact(0.0, "predicted")),
    "impact .5": ({"name": "moreau-jean", "restitution": 0.5}, impact(0.5, "predicted")),
    "CD-Lagrange 0": ({"name": "moreau-jean", "gate": "current"}, impact(0.0, "current")),
    "CD-Lagrange .5": ({"name": "moreau-jean", "gate": "current", "restitution": 0.5}, impact(0.5, "current")),
    "Paoli .5": ({"name": "paoli-schatzman", "restitution": 0.5}, pressed(0.5)),
    "Paoli 1": ({"name": "paoli-schatzman", "restitution": 1.0}, pressed(1.0)),
}


def gapwise(law):
    """Return a law of the gaps of one contact as a law of all contacts, for `dense.march`."""

    def force(before, now, free, w, dt, _u):
        return np.array([law(*gaps, dt) for gaps in zip(before, now, free, w, strict=True)])

    return force
