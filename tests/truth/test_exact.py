"""The exact solutions: closed forms, an independent march on a grid, and what must hold of any row of bars."""

from __future__ import annotations

import copy
import dataclasses
import functools
import itertools
import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import characteristics
import percuss
import places
import strategies
from percuss.contact.contact_problem import contact_problem
from percuss.march.model_of_case import model_of
from percuss.methods.interfaces import Load
from percuss.results import exact_only
from percuss.results.exact_only import run_exact
from percuss_methods.solutions import _row
from strategies import REGISTRY, number

CASES = places.CASES
MORE = settings(
    max_examples=2 * settings.default.max_examples,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
)


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    """Take a tenth of the samples of an exact solution alone: what is asked of it here needs no more."""
    monkeypatch.setattr(exact_only, "SAMPLES", 201)


def solve(case, end=None, overrides=None):
    """Return the exact solution of a covered case, given as a mapping or as the name of a shipped one."""
    if isinstance(case, str):
        case = CASES / f"{case}.yaml"
    model = model_of(percuss.load(case, overrides))
    engine = REGISTRY.get("solutions", "bars-in-a-row")()
    problem = contact_problem(model)
    assert engine.covers(problem) is None
    solution = engine.solve(problem, end or model.dt * model.steps)
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
    near(solution.velocity("short", 10.0, np.array([0.1, 0.3, 0.5, 0.7])), [0.05, 0.0, -0.05, -0.1])
    near(solution.stress("long", np.array([9.0, 11.0, 19.0]), 0.3), [0.0, -0.1, -0.1])
    near(solution.displacement("short", np.linspace(0.0, 10.0, 11), 0.7), -0.01)
    near(np.array([solution.energy(t) for t in (0.0, 0.3, 0.7)]), [[5e-4, 0.0], [0.0, 5e-4], [5e-4, 0.0]])


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


# ------------------------------------------------------------------------------------------------ drawn rows

SIDES = ("left", "right")
AXES = ((1.0,), (-1.0,), (0.6, 0.8), (-0.28, 0.96), (2 / 7, -3 / 7, 6 / 7))


@dataclass(frozen=True)
class Row:
    """Any row of bars, along an axis; what is done to it changes nothing but names, places and units."""

    bars: tuple[dict, ...]
    gaps: tuple[float, ...]  # between
    left: dict = field(default_factory=dict)  # what is at either end: {} or wall, fixed, loads, drive
    right: dict = field(default_factory=dict)
    extra: tuple[tuple[int, str, dict], ...] = ()  # loads on ends in contact: bar, end, load
    gravity: float = 0.0
    pulled: dict[int, float] = field(default_factory=dict)  # acceleration of single bars
    end: float = 1.0

    @property
    def names(self):
        """Names of the contacts from left to right."""
        out = ["wl"] if "wall" in self.left else []
        return [*out, *(f"c{k + 1}" for k in range(len(self.gaps))), *(["wr"] if "wall" in self.right else [])]

    def case(self):
        """Return the row as a case, along x."""
        bodies, contacts, loads, x, last = {}, {}, {}, 0.0, len(self.bars) - 1
        for k, bar in enumerate(self.bars):
            x += self.gaps[k - 1] if k else 0.0
            bodies[f"b{k}"] = {
                "bar": {"length": bar["length"], "elements": 2}, "at": x, "velocity": [bar["velocity"]],
                "material": {"young": bar["young"], "density": bar["density"]}, "area": bar["area"],
            }  # fmt: skip
            if k:
                contacts[f"c{k}"] = {"between": [f"b{k - 1}.right", f"b{k}.left"]}
            x += bar["length"]
        pushes = list(self.extra)
        for k, side, what, place in ((0, "left", self.left, 0.0), (last, "right", self.right, x)):
            end = f"b{k}.{side}"
            if "wall" in what:
                wall = place + (what["wall"] if side == "right" else -what["wall"])
                contacts[f"w{side[0]}"] = {"body": end, "wall": wall}
            if "fixed" in what:
                bodies[f"b{k}"].setdefault("fixed", []).append(side)
            if "drive" in what:
                loads[f"drive-{side}"] = {**what["drive"], "as": "velocity", "on": end}
            pushes += [(k, side, one) for one in what.get("loads", ())]
        for number_, (k, side, one) in enumerate(pushes):
            loads[f"push{number_}"] = {**one, "as": "force", "on": f"b{k}.{side}"}
        for k, value in self.pulled.items():
            loads[f"pull{k}"] = {"constant": value, "as": "acceleration", "on": f"b{k}"}
        for one in loads.values():
            one["direction"] = [1.0]
        if self.gravity:
            loads["gravity"] = {"gravity": [self.gravity]}
        return {
            "percuss": 1, "bodies": bodies, "contacts": contacts, "loads": loads,
            "time": {"end": self.end, "step": self.end / 8},
        }  # fmt: skip

    @property
    def impedances(self):
        return [bar["area"] * math.sqrt(bar["young"] * bar["density"]) for bar in self.bars]

    @property
    def speeds(self):
        """Sizes of the velocities that each part brings."""
        softest = min(self.impedances)
        out = [abs(bar["velocity"]) for bar in self.bars]
        out += [(abs(self.gravity) + max(map(abs, self.pulled.values()), default=0.0)) * self.end]
        for what in (self.left, self.right):
            out += [sum(peak(one) for one in what.get("loads", ())) / softest]
            out += [peak(what["drive"])] if "drive" in what else []
        return [*out, sum(peak(one) for *_, one in self.extra) / softest]

    @property
    def speed(self):
        return sum(self.speeds)

    @property
    def hardest(self):
        return max(self.impedances)


def peak(load):
    return float(np.abs(load["table"]["value"]).max())


def one_bar(length, velocity=0.0, young=1.0, density=1.0, area=1.0):
    return {"length": length, "young": young, "density": density, "area": area, "velocity": velocity}


def against(case, names):
    """Return a case whose bars of some names point to the left."""
    out, other = copy.deepcopy(case), {"left": "right", "right": "left"}

    def end(address):
        name, _, side = address.partition(".")
        return f"{name}.{other[side]}" if name in names and side else address

    for name in names & out["bodies"].keys():
        body = out["bodies"][name]
        body["at"] += body["bar"]["length"]
        body["bar"]["direction"] = [-1.0]
        body["fixed"] = [other[side] for side in body.get("fixed", ())]
    for contact in out["contacts"].values():
        (key, ends), *_ = contact.items()
        contact[key] = end(ends) if key == "body" else [*map(end, ends)]
    for load in out["loads"].values():
        if "on" in load:
            load["on"] = end(load["on"])
    return out


def written(case, axis=(1.0,), turned=frozenset(), swap=False, reverse=False):
    """Return a case written down in another manner: `turned` are bars that point against the axis."""
    case = strategies.turned(against(case, {f"b{k}" for k in turned}), axis)
    case = strategies.swapped(case) if swap else case
    return strategies.reordered(case) if reverse else case


@st.composite
def amplitudes(draw, window=True):
    """Draw straight lines through points, on and off any time; what each kind of load is, the kit asks."""
    steps = draw(st.lists(number(0.05, 1.5), min_size=1, max_size=4))
    time = [round(float(t), 6) for t in np.cumsum(steps)]
    out = {"table": {"time": time, "value": [draw(number(-1, 1)) for _ in steps]}}
    if window and draw(st.booleans()):
        out["from"] = draw(number(-0.5, 2))
        if draw(st.booleans()):
            out["until"] = round(out["from"] + draw(number(0.6, 3)), 6)
    return out


@st.composite
def exact_rows(draw):
    count = draw(st.integers(1, 5))
    bars = tuple(
        one_bar(draw(number(0.3, 2)), draw(number(-1, 1)), *(draw(number(0.5, high)) for high in (4, 4, 2)))
        for _ in range(count)
    )
    gaps = tuple(draw(st.one_of(st.just(0.0), number(0.01, 0.3))) for _ in range(count - 1))

    def edge():
        what = draw(st.sampled_from(["free", "wall", "fixed", "driven", "loaded"]))
        if what == "wall":
            return {"wall": draw(st.one_of(st.just(0.0), number(0.01, 0.3)))}
        if what == "driven":
            return {"drive": draw(amplitudes(window=False))}
        if what == "loaded":
            return {"loads": draw(st.lists(amplitudes(), min_size=1, max_size=2))}
        return {"fixed": True} if what == "fixed" else {}

    left, right = edge(), edge()
    extra = []
    if count > 1 and draw(st.booleans()):
        k = draw(st.integers(1, count - 1))
        extra.append((*draw(st.sampled_from([(k, "left"), (k - 1, "right")])), draw(amplitudes())))
    gravity = draw(st.one_of(st.just(0.0), number(-0.5, 0.5)))
    pulled = {draw(st.integers(0, count - 1)): draw(number(-0.5, 0.5))} if draw(st.integers(0, 3)) == 0 else {}
    return Row(bars, gaps, left, right, tuple(extra), gravity, pulled, draw(number(1, 10)))


def manners():
    """Ways to write a row down."""
    return st.fixed_dictionaries(
        {
            "axis": st.sampled_from(AXES),
            "turned": st.frozensets(st.integers(0, 4)),
            "swap": st.booleans(),
            "reverse": st.booleans(),
        }
    )


def event_times(solution, k=None):
    """Return the times at which a junction (or any) changes, from 0 to the time reached."""
    every = range(solution.chain.side.shape[0]) if k is None else [k]
    times = np.concatenate([[0.0, solution.reached], *[solution.chain.force(j).times for j in every]])
    return np.unique(np.clip(times, 0.0, solution.reached))


def solved(row, **manner):
    return solve(written(row.case(), **manner), row.end)


def impulse_size(row, solution):
    """Return the momenta and impulses that took part, none of which another one cancels, from histories alone."""
    t = np.linspace(0.0, row.end, 401)
    moving = pressing = 0.0
    for k, bar in enumerate(row.bars):
        mass = bar["density"] * bar["area"] * bar["length"]
        for x in (0.0, bar["length"]):
            moving += mass * np.abs(solution.velocity(f"b{k}", x, t)).max()
            pressing += bar["area"] * np.trapezoid(np.abs(solution.stress(f"b{k}", x, t)), t)
    return max(moving, pressing)


def balanced(row, solution, shares):
    """Hold energy less work and momentum less impulse against their first values."""
    start, pace = sum(solution.energy(0.0)), solution.momentum(0.0)
    times = [row.end * share for share in [*np.linspace(0.0, 1.0, 30), *shares]]
    energies = np.array([sum(solution.energy(t)) for t in times])
    works = np.array([solution.work(t) for t in times])
    size = max(energies.max(), np.abs(works).max())
    assert np.abs(energies - start - works).max() <= 1e-13 * size
    momenta = np.array([solution.momentum(t) for t in times])
    impulses = np.array([solution.impulse(t) for t in times])
    assert np.abs(momenta - pace - impulses).max() <= 1e-13 * max(impulse_size(row, solution), np.abs(momenta).max())


SHARES = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4)


SMOOTH = (
    {"half-sine": {"peak": 1.0, "duration": 0.7}},
    {"harmonic": {"value": 0.4, "frequency": 0.8}},
    {"harmonic": {"value": -0.3, "mean": 0.2, "frequency": 1.7, "phase": 0.4}},
)


@pytest.mark.slow
@MORE
@given(exact_rows(), manners(), SHARES, st.sampled_from([None, None, *SMOOTH]))
def test_energy_and_momentum_are_conserved(row, manner, shares, smooth):
    if smooth:  # in rows of three bars: waves of a smooth load are many pieces
        row = Row(row.bars[:3], row.gaps[:2], {"loads": [smooth]}, row.right, (), row.gravity, {}, min(row.end, 4.0))
    balanced(row, solved(row, **manner), shares)


@pytest.mark.slow
@MORE
@given(exact_rows(), manners())
def test_plain_and_compiled_event_loops_give_the_same_bits(row, manner):
    """A process computes few fronts in plain Python at first, and compiles when it has spent some time so."""
    before = _row.MOST_PLAIN_SECONDS
    try:
        _row.MOST_PLAIN_SECONDS = math.inf
        plain = solved(row, **manner).chain
        _row.MOST_PLAIN_SECONDS = -math.inf
        compiled = solved(row, **manner).chain
    finally:
        _row.MOST_PLAIN_SECONDS = before
    for one, other in ((plain.waves, compiled.waves), (plain.forces, compiled.forces)):
        for name, first, second in zip(one._fields, one, other, strict=True):
            assert first.tobytes() == second.tobytes(), name


def test_an_exact_solution_alone_is_saved_read_again_and_described(tmp_path):
    made = run_exact(percuss.load(CASES / "hunek.yaml", {"record.fields": 1}))
    made.save(tmp_path / "exact.nc")
    read = percuss.open_result(tmp_path / "exact.nc")
    assert not read.marched
    for own, other in ((made.arrays, read.arrays), (made.field_arrays, read.field_arrays)):
        assert set(own) == set(other)
        for name, values in own.items():
            np.testing.assert_array_equal(other[name], values)
    assert (read.summary, read.coordinates) == (made.summary, made.coordinates)
    assert (read.end, read.solution_name) == (0.8, "bars-in-a-row")
    assert repr(read) == repr(made)
    assert repr(made).startswith("<percuss.Result ")
    assert "tip: impulse 0.02" in repr(made)


@MORE
@given(
    st.lists(st.integers(1, 5), min_size=1, max_size=4), st.sampled_from([0.0, 0.5, -0.25]), st.integers(1, 2),
    st.floats(0.125, 2.0), st.floats(1.0, 3.0),
)  # fmt: skip
def test_long_after_the_last_front_work_and_impulse_are_those_of_statics(cells, speed, periods, push, later):
    """Bars of one material, moved by a driven or held end, pushed from the other one by a ramp over whole periods.

    Four transits are a period of a bar held at one end; a ramp of whole periods leaves no wave in it.
    """
    length, duration = float(sum(cells)), 4.0 * sum(cells) * periods
    bars = tuple(one_bar(float(count), speed) for count in cells)
    ramp = {"ramp": {"value": -push, "duration": duration}}
    row = Row(bars, (0.0,) * (len(cells) - 1), {"drive": {"constant": speed}}, {"loads": [ramp]}, end=duration * later)
    solution, end = solved(row), row.end
    stored = push**2 * length / 2.0
    size = stored + 0.5 * length * speed**2 + push * abs(speed) * end
    assert solution.work(end) == pytest.approx(stored, abs=1e-13 * size)
    assert sum(solution.energy(end)) == pytest.approx(stored + 0.5 * length * speed**2, abs=1e-13 * size)
    assert abs(solution.impulse(end)) <= 1e-13 * (length * abs(speed) + push * end)


# ------------------------------------------------------------------------------------------------ bars on a grid

STEP = 0.1


@st.composite
def grid_rows(draw):
    """Draw rows whose waves take whole steps, and whose loads change between them."""
    count, steps = draw(st.integers(2, 6)), draw(st.integers(8, 40))

    def grid_bar():
        wave, impedance = draw(st.sampled_from([1.0, 2.0, 0.7, 3.3])), draw(number(0.3, 3))
        start = draw(st.integers(-4, 4)) / 4
        return one_bar(draw(st.integers(1, 6)) * STEP * wave, start, 2 * impedance * wave, 2 * impedance / wave, 0.5)

    def constant(value):
        return {"table": {"time": [0.0], "value": [value]}}

    bars = tuple(grid_bar() for _ in range(count))
    starts = [0.0, *[bar["velocity"] for bar in bars], 0.0]
    # bars in free flight close on the grid; others, as a rule, off it
    gaps = [
        max(one - other, 0.0) * draw(st.integers(0, 4)) * STEP or draw(st.sampled_from([0.0, 0.0, 0.0, 0.05, 0.13]))
        for one, other in itertools.pairwise(starts)
    ]

    def edge(gap):
        return draw(st.sampled_from([
            {}, {"wall": gap}, {"fixed": True},
            {"drive": constant(draw(st.integers(1, 4)) / 4 * draw(st.sampled_from([-1, 1])))},
        ]))  # fmt: skip

    left, right, extra = edge(gaps[0]), edge(gaps[-1]), []
    held = {(0, "left")} if left.keys() & {"fixed", "drive"} else set()
    held |= {(count - 1, "right")} if right.keys() & {"fixed", "drive"} else set()
    for _ in range(draw(st.integers(0, 3))):
        place, first = (
            draw(st.tuples(st.integers(0, count - 1), st.sampled_from(SIDES))),
            draw(st.integers(0, steps - 2)),
        )
        window = {"from": first * STEP, "until": draw(st.integers(first + 1, steps)) * STEP}
        if place not in held:
            extra.append((*place, constant(draw(number(-1, 1))) | window))
    return Row(bars, tuple(gaps[1:-1]), left, right, tuple(extra), end=steps * STEP)


def on_grid(row):
    """Return the march of a row on a grid."""
    bars, steps = [], round(row.end / STEP)
    middle = (np.arange(steps) + 0.5) * STEP
    for k, (bar, impedance) in enumerate(zip(row.bars, row.impedances, strict=True)):
        transit = bar["length"] * math.sqrt(bar["density"] / bar["young"])
        one = characteristics.Bar(round(transit / STEP), impedance, bar["velocity"])
        for end, side in enumerate(SIDES):
            what = (row.left, row.right)[end] if k == (0, len(row.bars) - 1)[end] else {}
            loads = (load for *place, load in row.extra if place == [k, side])
            one.force[end] = sum((history(load, middle) for load in loads), np.zeros(steps))
            if what.keys() & {"fixed", "drive"}:
                one.velocity[end] = history(what["drive"], middle) if "drive" in what else np.zeros(steps)
        bars.append(one)
    return characteristics.march(bars, pairs(row), STEP, steps)


@MORE
@given(grid_rows())
def test_agrees_with_the_march_on_a_grid_until_a_contact_closes_off_it(row):
    assume(row.names)
    solution, grid = solved(row), on_grid(row)
    n = grid.exact
    middle = (np.arange(n) + 0.5) * STEP
    times = np.arange(n + 1) * STEP
    speed, gaps = max(row.speeds), [gap for *_, gap in pairs(row)]
    length = max(speed * row.end, *gaps, 0.0)
    for k, name in enumerate(row.names):
        contact = solution.contacts[name]
        assert np.abs(contact.force(middle) - grid.force[k, :n]).max(initial=0.0) <= 1e-12 * speed * row.hardest
        impulse = np.append(0.0, np.cumsum(grid.force[k, :n])) * STEP
        assert np.abs(contact.impulse(times) - impulse).max() <= 1e-12 * row.hardest * length
        assert np.abs(contact.gap(times) - grid.gap[k, : n + 1]).max() <= 1e-12 * length
    for b, bar in enumerate(row.bars):
        for end, x in enumerate((0.0, bar["length"])):
            found = solution.displacement(f"b{b}", x, times)
            assert np.abs(found - grid.displacement[b, end, : n + 1]).max() <= 1e-12 * length


# ------------------------------------------------------------------------------------------------ largest values


@MORE
@given(exact_rows(), manners(), st.tuples(st.floats(0.0, 0.45), st.floats(0.55, 1.0)))
def test_the_largest_force_is_that_of_the_straight_lines_between_events(row, manner, window):
    assume(row.names)
    solution = solved(row, **manner)
    for start, stop in ((0.0, row.end), tuple(share * row.end for share in window)):
        events = np.clip(event_times(solution), start, stop)
        edges = np.unique(np.append(events, [start, stop]))
        spans = np.diff(edges)
        begins, spans = edges[:-1][spans > 1e-11 * row.end], spans[spans > 1e-11 * row.end]
        for contact in solution.contacts.values():
            # a line is known by any two of its values
            quarter, half = (contact.force(begins + share * spans) for share in (0.25, 0.5))
            largest = max((2.0 * quarter - half).max(), (3.0 * half - 2.0 * quarter).max())
            assert abs(contact.largest_force(start, stop) - largest) <= 1e-11 * row.hardest * row.speed


@pytest.mark.slow
@MORE
@given(exact_rows(), st.booleans(), st.booleans())
def test_the_largest_energy_is_above_every_sample_and_no_higher_than_it_must(row, smooth, driven):
    if smooth and driven:
        row = dataclasses.replace(row, left={"drive": {"harmonic": {"value": 0.4, "frequency": 0.8}}})
    elif smooth:
        row = dataclasses.replace(row, left={"loads": [{"half-sine": {"peak": 1.0, "duration": 0.7}}]})
    row = dataclasses.replace(row, end=min(row.end, 4.0))
    solution = solved(row)
    samples = np.array([sum(solution.energy(t)) for t in np.linspace(0.0, row.end, 61)])
    largest = solution.largest_energy()
    assert samples.max() <= largest * (1.0 + 1e-13)
    # between two samples the energy rises by no more than the steepest rise of the samples makes plausible
    assert largest <= samples.max() + np.abs(np.diff(samples)).max() + 1e-13 * largest


@MORE
@given(exact_rows(), manners())
def test_contacts_press_or_are_open_and_do_not_chatter(row, manner):
    assume(row.names)
    solution = solved(row, **manner)
    hard, far = row.hardest * row.speed, max(row.speed * row.end, 1.0)
    events = event_times(solution)
    tick = 1e-9 * row.end
    t = np.concatenate([np.linspace(0.0, row.end, 2001), events, events - tick, events + tick])
    t = np.unique(np.clip(t, 0.0, row.end))
    for contact in solution.contacts.values():
        force, gap = contact.force(t), contact.gap(t)
        assert force.min() >= -1e-12 * hard
        assert gap.min() >= -1e-12 * far
        assert np.minimum(force / (hard or 1.0), gap / far).max() <= 1e-12
        edges = np.array(contact.closed).ravel()
        assert (np.diff(edges) > 1e-11 * row.end).all()
        inside = np.zeros(t.shape, dtype=bool)
        for a, b in contact.closed:
            inside |= (t >= a) & (t <= b)
        assert (force[~inside] == 0.0).all()


def left_end(row, k, manner):
    """Return where, along bar k, its left and right ends are, and the sign of its direction."""
    length = row.bars[k]["length"]
    return ((0.0, length), 1.0) if k not in manner["turned"] else ((length, 0.0), -1.0)


@MORE
@given(exact_rows(), manners())
def test_the_ends_obey_their_conditions(row, manner):
    """Where nothing changes, an end moves and presses as what is there says."""
    solution = solved(row, **manner)
    events = event_times(solution)
    wide = np.diff(events) > 1e-6 * row.end
    t = (events[:-1] + 0.41 * np.diff(events))[wide]
    last = len(row.bars) - 1

    def at(k, side):
        places, sign = left_end(row, k, manner)
        x = np.full(t.shape, places[side == "right"])
        bar = row.bars[k]
        velocity = sign * solution.velocity(f"b{k}", x, t)
        return velocity, -bar["area"] * solution.stress(f"b{k}", x, t)

    fast, hard = 1e-11 * row.speed, 1e-11 * row.hardest * row.speed
    for (k, _), (side, sign, other) in itertools.product(enumerate(row.bars), (("left", 1.0, -1), ("right", -1.0, 1))):
        velocity, pressed = at(k, side)
        inside = 0 <= k + other <= last
        what = {} if inside else getattr(row, side)
        if "fixed" in what or "drive" in what:
            driven = history(what["drive"], t) if "drive" in what else 0.0
            assert np.abs(velocity - driven).max(initial=0.0) <= fast
            continue
        loads = [one for *place, one in row.extra if place == [k, side]] + list(what.get("loads", ()))
        force = sum((history(one, t) for one in loads), np.zeros(t.shape))
        if inside or "wall" in what:
            pushing = solution.contacts[f"c{max(k, k + other)}" if inside else f"w{side[0]}"].force(t)
            beyond = at(k + other, "right" if other < 0 else "left")[0] if inside else 0.0
            assert np.abs(velocity - beyond)[pushing > 100 * hard].max(initial=0.0) <= fast
            force = force + sign * pushing
        assert np.abs(sign * pressed - force).max(initial=0.0) <= hard


def history(load, time):
    """Return a load over time, written out anew."""
    clock = time - load.get("from", 0.0)
    value = np.interp(clock, load["table"]["time"], load["table"]["value"])
    return np.where((clock >= 0) & (time < load.get("until", math.inf)), value, 0.0)


@MORE
@given(exact_rows(), manners(), st.floats(0.02, 0.98))
def test_displacement_velocity_and_stress_belong_together(row, manner, share):
    """Velocity and stress, integrated piece by piece, give the displacement, in time and along each bar."""
    solution = solved(row, **manner)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    far = row.speed * row.end

    def integrated(function, edges):
        half = 0.5 * np.diff(edges)
        at = edges[:-1, None] + half[:, None] * (1.0 + nodes)
        return half * (function(at.ravel()).reshape(at.shape) @ weights)

    waves = solution.chain.waves
    for k, bar in enumerate(row.bars):
        name = f"b{k}"
        number_ = list(solution.chain.problem.bodies).index(name)
        wave = bar["length"] / solution.chain.transit[number_]
        sign = solution.chain.flip[number_]
        fronts = [waves.times[h, : waves.count[h]] for h in (2 * number_, 2 * number_ + 1)]
        for x in (0.0, share * bar["length"], bar["length"]):
            place = x if sign > 0 else bar["length"] - x
            edges = np.concatenate([fronts[0] + place / wave, fronts[1] + (bar["length"] - place) / wave])
            edges = np.unique(np.clip(np.append(edges, [0.0, row.end]), 0.0, row.end))
            assert solution.displacement(name, x, np.zeros(1)) == 0.0
            moved = integrated(lambda t, name=name, x=x: solution.velocity(name, np.full(t.shape, x), t), edges)
            assert np.abs(np.diff(solution.displacement(name, x, edges)) - moved).max() <= 1e-12 * far
        now = share * row.end
        edges = np.concatenate([(now - fronts[0]) * wave, bar["length"] - (now - fronts[1]) * wave])
        edges = edges if sign > 0 else bar["length"] - edges
        edges = np.unique(np.clip(np.append(edges, [0.0, bar["length"]]), 0.0, bar["length"]))
        stretch = integrated(lambda x, name=name, now=now: solution.stress(name, x, np.full(x.shape, now)), edges)
        moved = np.diff(solution.displacement(name, edges, np.full(edges.shape, now)))
        assert np.abs(moved - stretch / bar["young"]).max() <= 1e-12 * far
    for name, pair in zip(row.names, pairs(row), strict=True):
        t = np.linspace(0.0, row.end, 101)
        gap = np.full(t.shape, pair[2])
        for k, side, sign in ((pair[0], 1, -1.0), (pair[1], 0, 1.0)):
            if k is not None:
                places, turned = left_end(row, k, manner)
                gap = gap + sign * turned * solution.displacement(f"b{k}", places[side], t)
        assert np.abs(gap - solution.contacts[name].gap(t)).max() <= 1e-12 * max(far, 1.0)


def pairs(row):
    """Return of each contact the bars at its left and right, and the gap."""
    last = len(row.bars) - 1
    out = [(None, 0, row.left["wall"])] if "wall" in row.left else []
    out += [(k, k + 1, gap) for k, gap in enumerate(row.gaps)]
    return out + ([(last, None, row.right["wall"])] if "wall" in row.right else [])


@MORE
@given(exact_rows(), st.tuples(*[st.sampled_from([1.0, 1e-3, 1e3, 0.3048, 1e-9, 1e6])] * 3))
def test_nothing_depends_on_the_units(row, numbers):
    """Impulses and gaps are compared, which depend on the data without jumps, unlike the forces."""
    units = dict(zip(("length", "mass", "time"), numbers, strict=True))
    time, length, impulse = (strategies.unit(kind, units) for kind in ("time", "length", "impulse"))
    one, other = solved(row), solve(strategies.converted(row.case(), units), row.end * units["time"])
    t = np.linspace(0.0, row.end, 501)
    push, far = row.hardest * row.speed * row.end, max(row.speed * row.end, 1.0)
    for name, a in one.contacts.items():
        b = other.contacts[name]
        assert np.abs(a.impulse(t) - b.impulse(t * time) / impulse).max() <= 1e-11 * push
        assert np.abs(a.gap(t) - b.gap(t * time) / length).max() <= 1e-11 * far
        assert len(a.closed) == len(b.closed)


# ------------------------------------------------------------------------------------------------ what is not covered


def two_bars(dim=1):
    bars = {name: strategies.bar(1.0, 4, at, material=strategies.UNIT) for name, at in (("a", 0.0), ("b", 1.0))}
    push = {"push": {"constant": 0.1, "on": "a.left"}}
    case = strategies.case_of(bars, {"ab": {"between": ["a.right", "b.left"]}}, {"end": 1.0, "step": 0.1}, push)
    return strategies.turned(case, [1.0, 0.0][:dim])


def changed(path, value, dim=1):
    case = two_bars(dim)
    *way, last = path.split(".")
    place = functools.reduce(lambda at, key: at[key], way, case)
    place[last] = value
    return case


DRIVE = {"prescribed-velocity": 0.1, "on": "a.left"}


@dataclass(frozen=True)
class Bump(Load):
    """A narrow bell, or a jump, which says that it has no kinks, or nothing."""

    name = "bump"
    summary = "A bell or a jump"
    examples = ({"at": 1.0, "width": 0.1},)

    at: float
    width: float
    told: bool = True

    def kinks(self):
        return () if self.told else None

    def amplitude(self, time):
        if self.width == 0.0:
            return np.where(time < self.at, 0.0, 1.0)
        return np.exp(-(((time - self.at) / self.width) ** 2))


WITH_BUMPS = strategies.with_methods(Bump)


def uncovered():
    """Yield cases that the solution does not cover, with the reason that a run gives."""
    bond = {"integrator": "central-difference", "contact": {"name": "cohesive", "strength": 1.0, "length": 2.0}}
    plastic = {"name": "bilinear-plastic", "young": 1.0, "density": 1.0, "yield_stress": 1.0, "tangent": 0.1}
    across = {**two_bars(2)["bodies"]["a"], "at": [5, 5], "bar": {"length": 1, "elements": 4, "direction": [0, 1]}}
    yield changed("bodies.b.material", plastic), "body 'b' is not linear"
    yield changed("bodies.b.velocity", [0.1, 0.01], 2), "body 'b' moves across its axis"
    yield changed("bodies.c", across, 2), "body 'c' lies across the first one"
    yield (
        changed("loads.push", {"bump": {"at": 0.5, "width": 0.1, "told": False}, "on": "a.left"}),
        "does not say where it is smooth",
    )
    for load in ({"constant": 0.1, "on": "a.left", "direction": [1.0, 0.5]}, {"gravity": [0.0, -1.0]},
                 {"prescribed-velocity": 0.1, "on": "a.left", "direction": [0.0, 1.0]}):  # fmt: skip
        yield changed("loads.push", load, 2), "load 'push' acts across body 'a'"
    for window in ({"from": 0.1}, {"until": 0.5}):
        yield changed("loads.push", {**DRIVE, **window}), "the drive 'push' is switched on or off in time"
        yield changed("loads.push", {"gravity": 1.0, **window}), "the load 'push' on a whole body changes in time"
    ramp = {"ramp": {"value": 1.0, "duration": 0.1}, "on": "a"}
    yield changed("loads.push", ramp), "the load 'push' on a whole body changes in time"
    yield (
        changed("loads.push", {"constant": 1.0, "on": "a.left", "as": "acceleration"}),
        "load 'push' accelerates an end",
    )
    yield changed("contacts.wall", {"body": "a.right", "wall": 1.5}), "an end takes part in several contacts"
    for method in (bond, {"contact": "tied"}, {"contact": {"name": "tied", "during": [[0.0, 0.5]]}}):
        yield changed("method", method), "holds its bodies together"


@pytest.mark.slow
def test_a_run_says_why_it_has_no_exact_solution():
    for case, reason in uncovered():
        result = percuss.run(percuss.load(case, registry=WITH_BUMPS), compiled=False)
        assert reason in result.summary["exact_reason"]
        assert result.summary["exact"] is result.exact is result.exact_histories is None
        assert "contact_force_exact" not in result.arrays


def test_what_the_uncovered_cases_differ_from_is_covered():
    for dim in (1, 2):
        result = percuss.run(percuss.load(two_bars(dim)))
        assert result.summary["exact"] is not None
        assert result.summary["exact_reason"] is None
    for load in (DRIVE, {**DRIVE, "from": 0.0}, {**DRIVE, "from": -1.0}, {"gravity": 1.0, "from": -0.5}):
        solve(changed("loads.push", load))
    solve(changed("loads.push", {"gravity": [1.0, 0.0]}, 2))
    solve(changed("loads.push", {"constant": 1.0, "on": "a", "as": "force"}))


# ------------------------------------------------------------------------------------------------ loads, limits


def pushed(load, end, **options):
    """Two equal bars, the first pushed at its free end; the force in between is the load a transit later."""
    return changed("loads.push", {**load, "on": "a.left", **options}) | {"time": {"end": end, "step": 0.1}}


@pytest.mark.parametrize("frequency", [2.0, 4.0, 8.0, 50 / 20])
def test_no_period_of_a_load_is_overlooked_and_grazing_does_not_stop_it(frequency):
    """The wave of the load and that from the free end cancel from t = 3 on: gap and force are zero, to a tiny error."""
    solution = solve(pushed(harmonic(4.0, frequency)[0], 4.0), 4.0)
    t = np.linspace(1.0, 2.999, 2001)
    joint = solution.contacts["ab"]
    assert np.abs(joint.force(t) - 1 - np.sin(2 * np.pi * frequency * (t - 1))).max() < 1e-11
    after = np.linspace(3.0, 3.999, 2001)
    assert np.abs(joint.force(after)).max() < 1e-10
    assert joint.force(after).min() > -1e-10
    assert np.abs(joint.gap(after)).max() < 1e-10


def area_below(time, values, stop):
    """Return the area below straight lines through points, from the first point's time (held before and after)."""
    knots = np.concatenate([[-10.0], time, [10.0]])
    heights = np.interp(knots, time, values)
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (heights[1:] + heights[:-1]) * np.diff(knots))])
    k = np.clip(np.searchsorted(knots, stop, side="right") - 1, 0, knots.size - 2)
    here = np.interp(stop, time, values)
    return sums[k] + 0.5 * (heights[k] + here) * (stop - knots[k])


def long_bars(load, end):
    """Two bars so long that no wave comes back before the end: the force is the load half of it later."""
    case = pushed(load, end)
    for k, body in enumerate(case["bodies"].values()):
        body |= {"bar": {"length": 0.5 * end, "elements": 1}, "at": [0.5 * end * k]}
    return case


def harmonic(end, frequency, value=1.0, mean=1.0):
    """Return a load of some duration, its force, its impulse, and the largest number of pieces for it."""
    omega = 2.0 * np.pi * frequency
    return (
        {"harmonic": {"value": value, "mean": mean, "frequency": frequency}}, end,
        lambda t: mean + value * np.sin(omega * t),
        lambda t: mean * t + value * (1.0 - np.cos(omega * t)) / omega,
        max(80.0 * end * frequency, 500.0), 1e-11,
    )  # fmt: skip


def half_sine(end, peak, duration):
    def turn(t):
        return np.pi * np.clip(t, 0.0, duration) / duration

    return (
        {"half-sine": {"peak": peak, "duration": duration}}, end, lambda t: peak * np.sin(turn(t)),
        lambda t: peak * duration / np.pi * (1.0 - np.cos(turn(t))), 500.0, 1e-11,
    )  # fmt: skip


def record(end, count):
    time, values = np.linspace(0.0, end, count), np.random.default_rng(count).uniform(0.0, 1.0, count)
    steepest = np.abs(np.diff(values) / np.diff(time)).max()  # times are multiples of 40 * 2^-52 or so
    return (
        {"table": {"time": time.tolist(), "value": values.tolist()}}, end, lambda t: np.interp(t, time, values),
        lambda t: area_below(time, values, t) - area_below(time, values, np.zeros(1)),
        4.0 * count, steepest * end * 2.0**-51,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("load", "end", "force", "impulse", "most", "within"),
    [
        harmonic(50.0, 1.0), harmonic(50.0, 20.0), harmonic(5.8, 3.0, 0.4, 0.5), half_sine(5.8, 0.7, 0.3),
        record(40.0, 101), record(40.0, 16001),
    ],
)  # fmt: skip
def test_any_load_arrives_a_transit_later_in_few_pieces(load, end, force, impulse, most, within):
    solution = solve(long_bars(load, end), end)
    joint, t = solution.contacts["ab"], np.linspace(0.5 * end, end, 20011)[1:]
    clock = t - 0.5 * end
    assert np.abs(joint.force(t) - force(clock)).max() <= within
    assert np.abs(joint.impulse(t) - impulse(clock)).max() <= 1e-12
    assert solution.fronts < most


@pytest.mark.parametrize(
    ("load", "peak"),
    [({"half-sine": {"peak": 0.7, "duration": 0.3}}, 0.7), (harmonic(2.9, 3.0, 0.4, 0.5)[0], 0.9)],
)
def test_the_peak_of_a_smooth_load_is_its_own(load, peak):
    assert solve(pushed(load, 2.9), 2.9).contacts["ab"].largest_force(0.0, 2.9) == pytest.approx(peak, rel=1e-11)


def test_a_feature_that_no_kink_announces_is_not_overlooked():
    case = long_bars({"bump": {"at": 7.123, "width": 0.02}}, 40.0)
    problem = contact_problem(model_of(percuss.load(case, registry=WITH_BUMPS)))
    solution = REGISTRY.get("solutions", "bars-in-a-row")().solve(problem, 40.0)
    assert solution.reached == 40.0
    assert solution.contacts["ab"].impulse(np.array(40.0)) == pytest.approx(0.02 * math.sqrt(math.pi), rel=1e-10)
    assert solution.contacts["ab"].largest_force(0.0, 40.0) == pytest.approx(1.0, rel=1e-11)


@pytest.mark.parametrize("jump", [0.3, 1.0, 7.123])
def test_a_load_that_hides_a_jump_is_followed_up_to_it_and_blamed(jump):
    case = long_bars({"bump": {"at": jump, "width": 0.0}}, 40.0)
    result = percuss.run(percuss.load(case, registry=WITH_BUMPS))
    assert result.summary["exact"] is None
    until = result.summary["exact_covered"]["until"]
    assert until == pytest.approx(jump, abs=1e-6)
    assert until <= jump
    assert result.summary["exact_reason"] == (
        f"bars-in-a-row holds up to {until:.9g} only: "
        "load 'push' (bump) is not smooth there, although its `kinks` do not say so"
    )


@pytest.mark.parametrize("ratio", [1.0, 1e8, 1e15])
@pytest.mark.parametrize("push", [{"half-sine": {"peak": 1.0, "duration": 0.5}}, {"constant": 1.0, "until": 0.5}])
def test_no_impedance_hides_when_a_contact_is_closed(ratio, push):
    """Two heavy bars touch, and a third one, light by `ratio`, beside them: it takes nothing from their closing."""
    bars = one_bar(3.0, 0.0, 1.0 / ratio, 1.0 / ratio), one_bar(1.0), one_bar(9.0)
    heavy_pair = solved(Row(bars, (0.0, 0.0), extra=((1, "left", push),), end=6.0)).contacts["c2"]
    smooth = "half-sine" in push
    assert heavy_pair.closed[0] == pytest.approx((1.0, 1.5), abs=1e-3 if smooth else 1e-11)
    whole = 1.0 / math.pi if smooth else 0.5
    assert heavy_pair.impulse(np.array(3.0)) == pytest.approx(whole, rel=1e-9 + 2.0 / ratio)


@pytest.mark.parametrize("fine", [1.0, 1e-3])
def test_a_row_that_falls_freely_does_not_press(fine):
    """Nothing acts between the bars but round-off."""
    bars = ((0.3, 0.5, 0.5), (0.43, 0.5, 1.28), (0.3, 0.51, 0.5), (0.3, 0.5, 0.5))
    bars = tuple(one_bar(length, 0.0, young, density, 0.5) for length, young, density in bars)
    falling = Row(bars, (0.0,) * 3, gravity=0.01)
    units = {"length": 1.0, "mass": 1.0, "time": fine}
    solution = solve(strategies.converted(falling.case(), units), fine)
    assert [contact.closed for contact in solution.contacts.values()] == [()] * 3


@st.composite
def records(draw):
    """Straight lines through points whose distances differ by many orders of ten, on and off any time."""
    gaps = draw(st.lists(st.sampled_from([1e-9, 1e-7, 1e-5, 1e-3, 0.1, 0.37]), min_size=1, max_size=8))
    time = draw(st.sampled_from([0.0, 0.5, 0.3])) + np.cumsum(gaps)
    values = draw(st.lists(st.sampled_from([0.0, 0.0, 1.0, 0.25, 1e-3]), min_size=time.size, max_size=time.size))
    return time.tolist(), values


@MORE
@given(records(), st.sampled_from([0.0, -0.2, 0.4]), st.sampled_from([1.0, 1e3, 1e-6]))
def test_straight_lines_are_exact_whatever_their_slope(record, start, unit):
    """The force between two bars is the load a transit later, and its impulse the area below the lines."""
    time, values = record
    load = {"table": {"time": [t * unit for t in time], "value": values}, "from": start * unit}
    case = pushed(load, 2.9 * unit)
    for body in case["bodies"].values():
        body["material"] = {"young": 1.0 / unit, "density": unit}
    solution = solve(case, 2.9 * unit)
    joint = solution.contacts["ab"]
    t = np.linspace(0.0, 2.9, 1777)
    clock = t - 1.0 - start
    impulse = np.where(t > 1.0 + max(start, 0.0), area_below(time, values, np.maximum(clock, -start)), 0.0)
    first = area_below(time, values, np.maximum(np.array([0.0]), -start))[0]
    impulse = np.where(t > 1.0 + max(start, 0.0), impulse - first, 0.0)
    assert np.abs(joint.impulse(t * unit) / unit - impulse).max() <= 1e-14
    clear = (np.abs(clock[:, None] - np.array([0.0, -start, *time])) > 1e-4).all(axis=1)
    force = np.where((clock > 0.0) & (t > 1.0), np.interp(clock, time, values), 0.0)
    assert np.abs(joint.force(t * unit) - force)[clear].max() <= 1e-12
