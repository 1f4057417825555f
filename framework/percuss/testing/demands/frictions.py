"""Demands on frictions: the largest force of a point, and runs in which surfaces stick and slide."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.jsonable import Entries
from percuss.methods.interfaces import Floats, FrictionPoints
from percuss.methods.plugin_calls import answer, read_only
from percuss.testing.draws import largest_difference, must_balance, must_compile
from percuss.testing.subject import ROUND_OFF, Subject, demand, must

POINTS, DRAWN = 3, 40  # contact points, and forces drawn of each
SPEED = 0.01
TURN, AXIS = 37.0, (0.3, -0.5, 1.0)  # of the turned twin


@demand("frictions")
def check_bound(subject: Subject) -> None:
    """The largest force along the surfaces is a number of at least 0, and does not fall as the normal force grows.

    Without a normal force it is 0. It depends on nothing but its arguments, and leaves the state variables as they are.
    """
    rng = np.random.default_rng(0)
    points = FrictionPoints(tuple(f"point{k}" for k in range(POINTS)), read_only(np.array([0.5, 1.0, 2.0])))
    for _, made in subject.made():
        data: Any = answer(made, "bind", points, 1e-3)
        bound: Any = type(made).bound
        for point in range(POINTS):
            for rate, before in zip(rng.exponential(size=DRAWN), rng.uniform(size=(DRAWN, made.state)), strict=True):
                forces = np.sort(np.append(rng.exponential(size=5), 0.0))
                limits = np.array([bound(data, point, force, rate, read_only(before)) for force in forces])
                must(np.isfinite(limits).all() and limits.min() >= 0.0, f"the largest forces are {limits}")
                must(limits[0] == 0.0, f"without a normal force the largest force is {limits[0]:.3g}")
                must((np.diff(limits) >= 0.0).all(), f"it falls to {limits} as the normal force grows to {forces}")
                again = bound(data, point, forces[-1], rate, read_only(before))
                must(again == limits[-1], "it is another one if it is asked again")


@demand("frictions")
def check_slides(subject: Subject) -> None:
    """A cube that is thrown obliquely at a wall keeps its accounts.

    The kernels are compiled, momentum and energy are balanced, and friction takes energy. The run has the same bits if
    it is made again, the same numbers in plain Python, and the same forces where all of it is turned in space.
    """
    for options, _ in subject.made():
        case = subject.placed(_thrown(np.eye(3)), options)
        result = subject.run(case)
        must_compile(result)
        must_balance(result)
        taken = result.arrays.get("friction_dissipated", np.zeros((1, 1)))
        scale = float(result.arrays["kinetic_energy"].max())
        must(np.diff(taken, axis=0).min(initial=0.0) >= -ROUND_OFF * scale, "its friction gives energy")
        for words, compiled, allowed in (("made again", True, 0.0), ("in plain Python", False, ROUND_OFF)):
            apart = largest_difference(result.arrays, subject.run(case, compiled=compiled).arrays)
            must(apart <= allowed, f"the run {words} differs by {apart:.3g} of its peak")
        turned = subject.run(subject.placed(_thrown(_rotation()), options), like=result)
        for name in ("contact_force", "friction_work", "sliding_area"):
            if name in result.arrays:
                one, other = result.arrays[name], turned.arrays[name]
                same = np.abs(one - other).max() <= ROUND_OFF * np.abs(one).max()
                must(same, f"turned in space the run has another {name}")


def _rotation() -> Floats:
    axis, angle = np.array(AXIS) / np.linalg.norm(AXIS), np.radians(TURN)
    cross = np.cross(np.eye(3), axis)
    rotation: Floats = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return rotation


def _thrown(turn: Floats) -> Entries:
    """Return a cube that is thrown obliquely at a wall, with all of it turned about its middle."""
    middle, down = np.full(3, 0.5), np.array([0.0, 0.0, -1.0])
    body: Entries = {"block": {"size": [1.0] * 3, "elements": [3, 2, 2]}, "at": [0.0] * 3}
    if not np.array_equal(turn, np.eye(3)):
        body |= {"angle": TURN, "axis": list(AXIS)}
    body |= {"material": {"young": 1.0, "density": 1.0, "poisson": 0.3}}
    body["velocity"] = (turn @ np.array([0.5, 0.3, -1.0]) * SPEED).tolist()
    wall = {"point": (middle + 0.5 * turn @ down).tolist(), "normal": (-turn @ down).tolist()}
    method = {"integrator": "central-difference", "contact": "regularised-lagrange", "pairing": "gauss-points"}
    return {
        "percuss": 1,
        "bodies": {"cube": body},
        "contacts": {"floor": {"body": "cube.bottom", "wall": wall}},
        "method": method,
        "time": {"steps": 60, "step": 0.05},
    }
