"""The exact solutions: closed forms, an independent march on a grid, and what must hold of any row of bars."""

from __future__ import annotations

import copy
import functools
import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import characteristics
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from strategies import REGISTRY, hunek, number

import percuss
from percuss.model import Model

CASES = Path(__file__).parent.parent / "cases"
MORE = settings(
    max_examples=2 * settings.default.max_examples,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
)


def solve(case, end=None, overrides=None):
    """Return the exact solution of a covered case, given as a mapping or as the name of a shipped one."""
    if isinstance(case, str):
        case = CASES / f"{case}.yaml"
    model = Model(percuss.load(case, overrides))
    engine = REGISTRY.get("solutions", "bars-in-a-row")()
    assert engine.covers(model) is None
    solution = engine.solve(model, end or model.dt * model.steps)
    assert solution.reached == (end or model.dt * model.steps)
    return solution


def near(value, expected, within=1e-12):
    assert np.abs(np.asarray(value) - expected).max() <= within * np.abs(expected).max()


def intervals(contact, expected, within=1e-12):
    assert np.shape(contact.closed) == np.shape(expected)
    near(contact.closed, np.array(expected), within)


# ------------------------------------------------------------------------------------------------ closed forms


def test_carpenter():
    young, density, area, length, gap, speed = 206.8e9, 7844.065616, 6.4516e-4, 0.254, 5.08e-4, 5.13588
    wave, impedance = math.sqrt(young / density), area * math.sqrt(young * density)
    solution = solve("carpenter")
    contact = solution.contacts["middle"]
    closes = gap / (2 * speed)
    opens = closes + 2 * length / wave
    intervals(contact, [(closes, opens)], 1e-11)  # the gap is a difference of coordinates
    near(contact.force(np.linspace(closes, opens, 50)[1:-1]), impedance * speed)
    assert round(impedance * speed) == 133453
    assert round(1e9 * closes) == 49456
    assert round(1e9 * opens) == 148393
    near(contact.impulse(np.array([closes, opens, 2e-4])), impedance * speed * (opens - closes) * np.array([0, 1, 1]))
    assert (contact.force(np.array([0.0, 4.9e-5, 1.49e-4, 2e-4])) == 0.0).all()
    near(contact.gap(np.array([0.0, 2e-5, 2e-4])), [gap, gap - 4e-5 * speed, 2 * speed * (2e-4 - opens)], 1e-11)
    for body, sign in (("left", 1), ("right", -1)):
        near(solution.velocity(body, np.linspace(0, length, 9), 1e-5), sign * speed)
        near(solution.velocity(body, np.linspace(0, length, 9), 1.9e-4), -sign * speed)


def test_hunek_grazes_between_two_plateaus():
    solution = solve("hunek")
    tip = solution.contacts["tip"]
    intervals(tip, [(0.0, 0.2), (0.4, 0.6)])
    inside = np.linspace(0.001, 0.199, 100)
    near(tip.force(np.concatenate([inside, 0.4 + inside])), 0.05)
    assert (tip.force(np.concatenate([0.2 + inside, 0.6 + inside])) == 0.0).all()
    near(tip.impulse(np.array([0.1, 0.3, 0.5, 0.7])), [0.005, 0.01, 0.015, 0.02])
    assert (np.abs(tip.gap(np.linspace(0, 0.6, 601))) <= 1e-15).all()
    near(tip.gap(0.6 + inside), 0.1 * inside)
    assert solution.fronts <= 12
    x = np.linspace(0.0, 10.0, 11)
    near(solution.velocity("short", 10.0, np.array([0.1, 0.3, 0.5, 0.7])), [0.05, 0.0, -0.05, -0.1])
    near(solution.velocity("short", 0.0, np.array([0.05, 0.15, 0.25, 0.35, 0.55, 0.7])), [0.1, 0, 0, 0, -0.1, -0.1])
    assert (np.abs(solution.velocity("short", x, 0.3)) <= 1e-16).all()
    assert (np.abs(solution.stress("short", x, 0.3)) <= 1e-15).all()
    near(solution.velocity("short", x, 0.75), -0.1)
    for probe in (solution.velocity, solution.stress):
        assert (np.abs(probe("long", 2 * x, 0.7)) <= 1e-14).all()
    near(solution.stress("long", 4.0, np.array([0.1, 0.3, 0.5])), [-0.05, 0.0, -0.05])
    near(solution.stress("long", np.array([9.0, 11.0, 19.0]), 0.3), [0.0, -0.1, -0.1])
    near(solution.displacement("short", x, 0.7), -0.01)
    near(np.array([solution.energy(t) for t in (0.0, 0.3, 0.7)]), [[5e-4, 0.0], [2.5e-4, 2.5e-4], [5e-4, 0.0]])


def test_unlike():
    first, stiff = math.sqrt(49 * 0.01), math.sqrt(100 * 0.01)
    opens = 20 / math.sqrt(49 / 0.01)
    plateau = 0.1 * first * stiff / (first + stiff)
    drop = plateau - 2 * plateau * first / (first + stiff)  # the stiff bar's front comes back after .2, as tension
    solution = solve("unlike")
    tip = solution.contacts["tip"]
    intervals(tip, [(0.0, opens)])
    near(tip.force(np.array([0.001, 0.1, 0.199])), plateau)
    near(tip.force(np.array([0.201, 0.25, 0.285])), drop, 1e-11)
    assert round(plateau, 7) == 0.0411765
    assert round(drop, 8) == 0.00726644
    total = plateau * 0.2 + drop * (opens - 0.2)
    near(tip.impulse(np.array([0.5])), total)
    near(solution.momentum(0.5), 0.1 * 0.1)
    x = (np.arange(40000) + 0.5) / 4000  # the velocities are piecewise constant
    for body, mean in (("soft", 0.1 - total / 0.1), ("stiff", total / 0.1)):
        near(solution.velocity(body, x, 0.5).mean(), mean, 1e-4)
    assert round(0.1 - total / 0.1, 7) == 0.0114187
    assert round(total / 0.1, 7) == 0.0885813


def test_doyen_impact():
    solution = solve("doyen-impact")
    foot = solution.contacts["foot"]
    intervals(foot, [(0.0, 2 / 3)])
    near(foot.force(np.linspace(0.01, 0.66, 20)), 300.0)
    near(foot.impulse(np.array([0.3, 2 / 3, 1.0])), [90.0, 200.0, 200.0])
    near(foot.gap(np.array([0.9, 1.0])), [10 * (0.9 - 2 / 3), 10 / 3])
    near(solution.stress("bar", 5.0, np.array([0.3])), -300.0)
    near(solution.displacement("bar", np.array([0.0, 10.0]), 1 / 3), [0.0, -10 / 3])


def test_doyen_bounces_a_hundred_times_without_drift():
    solution = solve("doyen-bounce", 50 * 16 / 3)
    foot = solution.contacts["foot"]
    starts = 1 + np.arange(100) * 8 / 3
    assert np.shape(foot.closed) == (100, 2)
    assert np.abs(np.array(foot.closed) - np.stack([starts, starts + 2 / 3], axis=1)).max() < 1e-10
    for share in (0.001, 0.5, 0.999):
        rising = 300 + 200 * share
        force = foot.force(starts + 2 / 3 * share)
        assert np.abs(force[0::2] - rising).max() < 1e-8 * rising
        assert np.abs(force[1::2] - (800 - rising)).max() < 1e-8 * rising
    near(foot.impulse(starts + 1), 800 / 3 * np.arange(1, 101), 1e-11)
    assert foot.gap(np.linspace(0, 50 * 16 / 3, 20001)).min() > -1e-11
    # every other flight begins with the bar at rest in itself; its height is back after each period
    whole = 16 / 3 * np.arange(51)
    near(foot.gap(whole[:-1]), 5.0, 1e-9)
    near(solution.displacement("bar", 10.0, whole) + 5.0, 5.0, 1e-9)
    for k in (1, 25, 50):
        assert sum(solution.energy(whole[k])) < 1e-7
        near(sum(solution.energy(whole[k] - 1.0)), solution.work(whole[k] - 1.0), 1e-8)
        near(solution.work(whole[k] - 1.0), 500.0, 1e-8)
    assert solution.fronts < 40 * 100  # those of the contacts, not doubled from one to the next


def test_sdnv100():
    impedance = 4e-4 * math.sqrt(2e11 * 8000)
    solution = solve("sdnv100")
    foot = solution.contacts["foot"]
    intervals(foot, [(2e-5, 1e-4)], 1e-11)
    near(foot.force(np.linspace(2.1e-5, 9.9e-5, 9)), impedance * 100)
    near(foot.impulse(np.array([1.4e-4])), 128.0)
    near(solution.displacement("beam", 0.2, np.array([6e-5])), -0.006)
    near(solution.velocity("beam", np.array([0.0, 0.1, 0.2]), 1.2e-4), 100.0)


def test_cradle_hands_the_momentum_on():
    solution = solve("cradle")
    for k, name in enumerate(("first-second", "second-third", "third-fourth", "fourth-last")):
        contact = solution.contacts[name]
        intervals(contact, [(k, k + 2)] if k else [(0.0, 2.0)])
        near(contact.force(np.linspace(k + 0.01, k + 1.99, 50)), 0.5)
        near(contact.impulse(np.array([7.0])), 1.0)
    x = np.linspace(0.0, 1.0, 11)
    for name, speed in zip(("first", "second", "third", "fourth", "last"), (0, 0, 0, 0, 1), strict=True):
        assert (np.abs(solution.velocity(name, x, 6.5) - speed) <= 1e-14).all()
        assert (np.abs(solution.stress(name, x, 6.5)) <= 1e-14).all()
        near(solution.displacement(name, x, 6.5), 1.0 if not speed else 6.5 - 4.0)
    near(solution.contacts["fourth-last"].gap(np.array([5.5, 7.0])), [0.5, 2.0])


def pulse(time):
    return np.where((time > 0) & (time < 0.5), 0.5 - 0.5 * np.cos(4 * np.pi * time), 0.0)


def test_a_smooth_pulse_arrives_a_transit_later():
    solution = solve("smooth-pulse")
    joint = solution.contacts["joint"]
    t = np.linspace(0.0, 1.7, 5001)
    assert np.abs(joint.force(t) - pulse(t - 1)).max() < 1e-11
    impulse = np.clip(t - 1, 0, 0.5) / 2 - np.sin(4 * np.pi * np.clip(t - 1, 0, 0.5)) / (8 * np.pi)
    assert np.abs(joint.impulse(t) - impulse).max() < 1e-11
    assert np.abs(joint.gap(t)).max() < 1e-11
    x = np.linspace(0.0, 1.0, 201)
    assert np.abs(solution.stress("far", x, 1.6) + pulse(0.6 - x)).max() < 1e-11
    assert np.abs(solution.velocity("far", x, 1.6) - pulse(0.6 - x)).max() < 1e-11
    assert np.shape(joint.closed) == (1, 2)
    assert np.abs(np.array(joint.closed) - [1.0, 1.5]).max() < 1e-3  # the pulse rises from nothing


def test_a_preloaded_row_rests_after_the_ramp():
    solution = solve("preloaded")
    t = np.linspace(12.0 + 1e-9, 60.0, 401)
    for contact in solution.contacts.values():
        late = t[t > 13.0]
        near(contact.force(late), 0.01)
        assert np.abs(contact.gap(np.linspace(0.0, 60.0, 601))).max() < 1e-14
        assert len(contact.closed) == 1
    x = np.linspace(0.0, 1.0, 6)
    for name, place in (("outer", 0.0), ("middle", 1.0), ("inner", 2.0)):
        for time in (12.5, 30.0, 59.9):
            assert np.abs(solution.velocity(name, x, time)).max() < 1e-15
            near(solution.stress(name, x, time), -0.01)
            near(solution.displacement(name, x, time), 0.01 * (3.0 - place - x))


# ------------------------------------------------------------------------------------------------ bars on a grid

STEP = 0.1


@dataclass(frozen=True)
class GridBar:
    cells: int
    impedance: float
    wave: float  # speed
    start: float

    @property
    def length(self):
        return self.cells * STEP * self.wave


@dataclass(frozen=True)
class GridRow:
    """A row whose waves take whole steps, and whose loads change between them."""

    bars: tuple[GridBar, ...]
    gaps: tuple[float, ...]  # left wall or None, between, right wall or None
    held: dict[tuple[int, int], float]  # velocity of (bar, end)
    pushed: tuple[tuple[int, int, int, int, float], ...]  # bar, end, first step, one past the last, force
    steps: int

    def mapping(self):
        bodies, contacts, loads = {}, {}, {}
        x = 0.0
        for k, (bar, gap) in enumerate(zip(self.bars, self.gaps[:-1], strict=True)):
            if k:
                x += gap
                contacts[f"c{k}"] = {"between": [f"b{k - 1}.right", f"b{k}.left"]}
            elif gap is not None:
                contacts["c0"] = {"body": "b0.left", "wall": -gap}
            bodies[f"b{k}"] = {
                "bar": {"length": bar.length, "elements": 1},
                "at": x,
                "area": 0.5,
                "material": {"young": 2 * bar.impedance * bar.wave, "density": 2 * bar.impedance / bar.wave},
                "velocity": bar.start,
            }
            x += bar.length
        if self.gaps[-1] is not None:
            last = len(self.bars)
            contacts[f"c{last}"] = {"body": f"b{last - 1}.right", "wall": x + self.gaps[-1]}
        sides = ("left", "right")
        for (b, end), speed in self.held.items():
            if speed:
                loads[f"drive{b}{end}"] = {"prescribed-velocity": speed, "on": f"b{b}.{sides[end]}"}
            else:
                bodies[f"b{b}"]["fixed"] = [*bodies[f"b{b}"].get("fixed", []), sides[end]]
        for k, (b, end, first, stop, force) in enumerate(self.pushed):
            loads[f"push{k}"] = {
                "constant": force, "on": f"b{b}.{sides[end]}", "from": first * STEP, "until": stop * STEP
            }  # fmt: skip
        return {
            "percuss": 1, "bodies": bodies, "contacts": contacts, "loads": loads,
            "time": {"end": self.steps * STEP, "step": STEP},
        }  # fmt: skip

    def reference(self, finer=1):
        """Return the contact's names and the march on the grid, each step cut into `finer`."""
        bars = []
        for b, bar in enumerate(self.bars):
            one = characteristics.Bar(bar.cells * finer, bar.impedance, bar.start)
            for end in (0, 1):
                force = np.zeros(self.steps * finer)
                for at, side, first, stop, value in self.pushed:
                    if (at, side) == (b, end):
                        force[first * finer : stop * finer] += value
                one.force[end] = force
                if (b, end) in self.held:
                    one.velocity[end] = np.full(self.steps * finer, self.held[b, end])
            bars.append(one)
        last = len(bars)
        meetings = [
            (k - 1 if k else None, k if k < last else None, gap)
            for k, gap in enumerate(self.gaps)
            if gap is not None
        ]
        names = [f"c{k}" for k, gap in enumerate(self.gaps) if gap is not None]
        return names, characteristics.march(bars, meetings, STEP / finer, self.steps * finer)

    @property
    def speed(self):
        """Size of the velocities."""
        softest = min(bar.impedance for bar in self.bars)
        return max(
            [abs(bar.start) for bar in self.bars] + [abs(v) for v in self.held.values()]
            + [sum(abs(one[4]) for one in self.pushed) / softest]
        )  # fmt: skip


@st.composite
def grid_rows(draw, gaps=True):
    count = draw(st.integers(2, 6))
    bars = tuple(
        GridBar(
            draw(st.integers(1, 6)),
            draw(number(0.3, 3)),
            draw(st.sampled_from([1.0, 2.0, 0.7, 3.3])),
            draw(st.integers(-4, 4)) / 4,
        )
        for _ in range(count)
    )
    distance = st.sampled_from([0.0, 0.0, 0.05, 0.1, 0.13]) if gaps else st.just(0.0)
    between = [draw(distance) for _ in range(count + 1)]
    held = {}
    for place, key in ((0, (0, 0)), (count, (count - 1, 1))):
        what = draw(st.sampled_from(["free", "wall", "fixed", "driven"]))
        if what != "wall":
            between[place] = None
        if what == "fixed":
            held[key] = 0.0
        elif what == "driven":
            held[key] = draw(st.integers(1, 4)) / 4 * draw(st.sampled_from([-1, 1]))
    steps = draw(st.integers(8, 40))
    pushed = []
    for _ in range(draw(st.integers(0, 3))):
        key = (draw(st.integers(0, count - 1)), draw(st.integers(0, 1)))
        first = draw(st.integers(0, steps - 2))
        stop = draw(st.integers(first + 1, steps))
        if key not in held:
            pushed.append((*key, first, stop, draw(number(-1, 1))))
    return GridRow(bars, tuple(between), held, tuple(pushed), steps)


@MORE
@given(grid_rows())
def test_agrees_with_the_march_on_a_grid_until_a_contact_closes_off_it(row):
    names, grid = row.reference()
    assume(names)
    solution = solve(row.mapping(), row.steps * STEP)
    n = grid.exact
    middle = (np.arange(n) + 0.5) * STEP
    times = np.arange(n + 1) * STEP
    hardest = max(bar.impedance for bar in row.bars)
    length = max(row.speed * row.steps * STEP, *[gap or 0.0 for gap in row.gaps])
    for k, name in enumerate(names):
        contact = solution.contacts[name]
        assert np.abs(contact.force(middle) - grid.force[k, :n]).max(initial=0.0) <= 1e-12 * row.speed * hardest
        impulse = np.append(0.0, np.cumsum(grid.force[k, :n])) * STEP
        assert np.abs(contact.impulse(times) - impulse).max() <= 1e-12 * hardest * length
        assert np.abs(contact.gap(times) - grid.gap[k, : n + 1]).max() <= 1e-12 * length
    for b, bar in enumerate(row.bars):
        for end, x in enumerate((0.0, bar.length)):
            found = solution.displacement(f"b{b}", x, times)
            assert np.abs(found - grid.displacement[b, end, : n + 1]).max() <= 1e-12 * length
