"""Loads from files, the motion of a base, and a moving wall, against integrals, other frames of reference and waves."""

import itertools

import numpy as np
import pytest
from scipy.integrate import quad

import percuss
import places
from percuss.results.provenance import case_inside
from percuss_methods.loads.base_excitation import BaseExcitation
from percuss_methods.loads.table import Table
from strategies import CD, bar, case_of

RECORD = "# station 7\ntime [s]\tnorth\teast\n0\t0\t1\n0.05\t2\t0\n0.125\t-1\t3\n0.2\t0\t0\n"
TIMES, NORTH = (0.0, 0.05, 0.125, 0.2), (0.0, 2.0, -1.0, 0.0)


def one_bar(load, elements=20, time=None, **changes):
    """Return a case of one bar with a load."""
    return case_of({"a": bar(1.0, elements, area=2.0) | changes}, {}, time, {"shake": load}, CD)


def ran(case):
    return percuss.run(percuss.load(case), compiled=False)


def test_a_column_of_a_record_is_the_load_that_the_same_numbers_make(tmp_path):
    (tmp_path / "record.tsv").write_text(RECORD, encoding="utf-8")
    named = {"file": str(tmp_path / "record.tsv"), "columns": ["time [s]", "north"], "scale": 9.81}
    time = {"step": 0.002, "end": 0.3}
    cases = [
        percuss.load(one_bar({"table": points, "on": "a.left"}, 5, time=time))
        for points in (named, named | {"columns": [1, 2]}, {"time": TIMES, "value": NORTH, "scale": 9.81})
    ]
    instants = np.linspace(0.0, 0.3, 61)
    for case in cases:
        load = case.loads["shake"].load
        assert load.amplitude(instants) == pytest.approx(9.81 * np.interp(instants, TIMES, NORTH), abs=1e-14)
        assert load.kinks() == TIMES
    results = [percuss.run(case, compiled=False) for case in cases]
    for other in results[1:]:
        assert np.array_equal(results[0].arrays["external_work"], other.arrays["external_work"])
    (tmp_path / "record.tsv").unlink()
    kept = case_inside(results[0].provenance)
    assert kept.loads["shake"].load == cases[0].loads["shake"].load


@pytest.mark.parametrize("first", [-0.1, 0.0, 0.07])
def test_the_velocity_of_a_base_is_the_integral_of_its_acceleration(first):
    points = tuple(first + time for time in TIMES)
    load = BaseExcitation(time=points, value=NORTH, scale=-3.0, initial=0.4)
    acceleration = Table(time=points, value=NORTH, scale=-3.0).amplitude
    for end in (0.0, 0.02, 0.1, 0.19, 0.5):
        breaks = [0.0, *(time for time in points if 0.0 < time < end), end]
        change = sum(quad(acceleration, *stretch)[0] for stretch in itertools.pairwise(breaks))
        assert load.amplitude(np.array([end]))[0] == pytest.approx(0.4 + change, abs=1e-14)


def test_seen_from_its_base_a_shaken_bar_is_a_fixed_one_under_its_inertia():
    """The base may be at rest in a frame that is accelerated with it: the bodies then bear minus its acceleration.

    Corners of the record lie between two displacements, so that both runs have the same numbers but for round-off.
    """
    step, length = 0.0004, 1.0
    points = {"time": [10.5 * step, 30.5 * step, 70.5 * step], "value": [0.0, 50.0, 0.0]}
    rest = {"time": {"step": step, "steps": 150}}
    shaken = ran(one_bar({"base-excitation": points, "on": "a.left"}, **rest))
    inertia = {"table": points | {"scale": -1.0}, "on": "a", "as": "acceleration"}
    fixed = ran(one_bar(inertia, fixed=["left"], **rest))
    moved = shaken.arrays["displacement"][:, :, 0]
    relative = fixed.arrays["displacement"][:, 1, 0]
    assert moved[:, 1] - moved[:, 0] == pytest.approx(relative, abs=1e-15)
    assert np.abs(relative).max() > 1e-3 * length


def test_a_moving_wall_is_a_wall_at_rest_as_seen_by_the_bar():
    """A body whose ends are driven with one velocity is a rigid wall, to bars that cannot tell who is moving."""
    laws = ("bipenalty", "penalty", "lagrange")
    for law in laws:
        moving, still = (
            percuss.run(percuss.load(places.CASES / f"{name}.yaml", {"method.contact": law}))
            for name in ("moving-wall", "doyen-impact")
        )
        forces = moving.arrays["contact_force"]
        assert forces == pytest.approx(still.arrays["contact_force"], abs=1e-9 * forces.max())
        assert moving.summary["exact"]["contacts"]["face"]["closed"] == [pytest.approx([0.0, 2.0 / 3.0])]


def test_the_base_of_a_bar_sends_its_motion_to_the_free_end():
    """At a Courant number of 1 waves keep their shape on the mesh: the free end doubles the motion of the base.

    That of the base is the double integral of its acceleration, but for dt^2 / 24 times the change of that.
    """
    step, elements, largest = 0.0005, 20, 40.0
    times, values = np.array([2, 7, 16]) * step, [0.0, largest, 0.0]
    load = {"base-excitation": {"time": times.tolist(), "value": values}, "on": "a.left"}
    result = ran(one_bar(load, elements, time={"courant": 1.0, "steps": 2 * elements}))
    base, end = result.arrays["displacement"][:, :, 0].T
    assert end[elements:] == pytest.approx(2.0 * base[:-elements], abs=1e-16)
    allowed = 1.01 * step**2 / 24.0 * largest
    for now, place in zip(result.arrays["time"], base, strict=True):
        breaks = np.clip([0.0, *times, 1.0], 0.0, now)
        moments = [
            quad(lambda t, now=now: (now - t) * np.interp(t, times, values), *stretch)[0]
            for stretch in itertools.pairwise(breaks)
        ]
        assert place == pytest.approx(sum(moments), abs=allowed)
    assert base[-1] > 20.0 * allowed
