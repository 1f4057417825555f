"""The errors that a run reports: what they mean, on histories made up and on methods whose order is known."""

import math

import numpy as np
import pytest

import percuss
import places
from percuss.march.model_of_case import model_of
from percuss.methods.interfaces import ExactContact
from percuss.results import exact, runner, true_error
from percuss.results.exact import exact_solution
from percuss.results.summary import ContactErrors
from percuss.results.verify import verify
from percuss.studies.columns import column_by_name
from percuss.studies.comparison import compare, metrics, orders
from percuss_methods.solutions._row import BarChain
from strategies import hunek, run

CASES = places.CASES
ERRORS = ("force_error_l1", "force_error_l2", "impulse_error")
FORCE_ERRORS = ContactErrors.__required_keys__ - {"closed"}


def errors(result, contact="tip"):
    return result.summary["exact"]["contacts"][contact]


class Pulse(ExactContact):
    """A force of 2 on (1, 3) and a linear rise from 0 to 4 on (5, 6)."""

    closed = ((1.0, 3.0), (5.0, 6.0))

    def force(self, time):
        time = np.asarray(time, dtype=float)
        return np.where((time > 1) & (time < 3), 2.0, np.where((time > 5) & (time < 6), 4 * (time - 5), 0.0))

    def impulse(self, time):
        time = np.asarray(time, dtype=float)
        return 2 * np.clip(time - 1, 0, 2) + 2 * np.clip(time - 5, 0, 1) ** 2

    def gap(self, time):
        return np.zeros(np.shape(time))

    def largest_force(self, start, stop):
        return 4.0


TIME = np.arange(0.0, 8.0)  # steps of 1, each record the mean of half a step to either side
MEANS = np.array([0.0, 1.0, 2.0, 1.0, 0.0, 0.5, 1.5, 0.0])


def judged(force, time=TIME, dt=1.0, reached=8.0, every=1):
    contact = Pulse()
    exact = contact.mean_force(time - 0.5 * dt, time + 0.5 * dt)
    exact[time + 0.5 * dt > reached] = np.nan
    return true_error.contact_errors(contact, time, np.asarray(force, dtype=float), exact, dt, reached, every=every)


# ------------------------------------------------------------------------------------------------ made-up histories


def test_the_mean_force_of_a_run_is_that_of_the_exact_solution():
    result = run(hunek(n=10, courant=1.0))
    force = result.arrays["contact_force_exact"][:, 0]
    expected = np.where((steps_of(result) < 19.5) | (abs(steps_of(result) - 50) < 9.5), 0.05, 0.0)
    expected[[0, 20, 40, 60]] = 0.025  # half of the first step lies before the start, where nothing presses
    assert np.abs(force - expected).max() < 1e-15
    assert np.abs(result.arrays["gap_exact"][:61, 0]).max() < 1e-16
    assert result.arrays["gap_exact"][80, 0] == pytest.approx(0.02, rel=1e-12)


def steps_of(result):
    return np.rint(result.arrays["time"] / result.summary["dt"])


def test_the_exact_history_has_no_error_and_a_noise_of_one():
    found = judged(MEANS)
    assert found["force_error_l1"] == found["force_error_l2"] == 0.0
    assert found["impulse_error"] < 1e-15
    assert found["noise"] == 1.0
    assert found["overshoot"] == 0.0
    assert found["closed"] == [[1.0, 3.0], [5.0, 6.0]]


def test_errors_are_relative_to_the_exact_history():
    off = np.array([0.0, 0.0, 1.0, 0.0, -0.5, 0.0, 0.0, 0.0])
    found = judged(MEANS + off)
    assert found["force_error_l1"] == pytest.approx(1.5 / 6.0)
    assert found["force_error_l2"] == pytest.approx(math.sqrt(1.25 / (1 + 4 + 1 + 0.25 + 2.25)))
    assert found["impulse_error"] == pytest.approx(1.0 / 6.0)  # the largest that was ever missing, not the last
    assert found["overshoot"] == pytest.approx(3.0 / 2.0 - 1.0)
    # 0 1 3 1 -.5 .5 1.5 0 against 0 1 2 1 0 .5 1.5 0
    assert found["noise"] == pytest.approx((1 + 2 + 2 + 1.5 + 1 + 1 + 1.5) / (1 + 1 + 1 + 1 + 0.5 + 1 + 1.5))


def test_the_impulse_is_judged_at_the_ends_of_the_steps_and_needs_every_step():
    late = np.roll(MEANS, 1)
    assert judged(late)["impulse_error"] == pytest.approx(2.0 / 6.0)  # a step late: by at most the peak
    assert judged(late, dt=0.5)["impulse_error"] is not None
    assert judged(late, every=2)["impulse_error"] is None


def test_closing_and_opening_are_late_by_the_first_and_last_force():
    force = np.array([0.0, 0.0, 2.0, 1.0, 0.0, 0.0, 2.0, 0.0])
    assert judged(force)["closing_error"] == pytest.approx(1.0)
    assert judged(force)["opening_error"] == pytest.approx(0.0)  # the exact contact opens in the middle of that step
    round_off = force + 1e-17 * (TIME == 0) + 1e-17 * (TIME == 7)
    assert judged(round_off)["closing_error"] == pytest.approx(1.0)
    assert judged(round_off)["opening_error"] == pytest.approx(0.0)
    assert judged(np.zeros(8))["closing_error"] is None
    assert judged(np.zeros(8))["opening_error"] is None
    assert judged(np.ones(8))["opening_error"] is None  # still closed at the end


def test_where_nothing_presses_errors_are_zero_or_none():
    time = np.array([0.0, 0.25])
    silent, loud = (judged(force, time, 0.25, 0.5) for force in (np.zeros(2), np.array([0.0, 1.0])))
    assert [silent[name] for name in (*ERRORS, "noise")] == [0.0, 0.0, 0.0, None]
    assert silent["closed"] == []
    assert [loud[name] for name in (*ERRORS, "noise", "overshoot")] == [None] * 5


def test_what_lies_behind_the_time_reached_does_not_count():
    found = judged(np.where(TIME < 4.5, MEANS, 1e6), reached=4.5)
    assert found["force_error_l2"] == 0.0
    assert found["impulse_error"] < 1e-15
    assert found["noise"] == 1.0
    assert found["closed"] == [[1.0, 3.0]]
    closed_at_the_end = judged(np.where(TIME < 2.5, MEANS, 0.0), reached=6.0)
    assert closed_at_the_end["opening_error"] is None


def test_the_displacement_error_is_that_of_all_nodes_at_the_end():
    case = percuss.load(hunek(n=10))
    model = model_of(case)
    solution = exact_solution(model, 0.8)[0]
    exact = np.concatenate([
        solution.displacement(name, np.linspace(0, length, count), 0.5)
        for name, length, count in (("short", 10, 11), ("long", 20, 21))
    ])[:, None]  # fmt: skip
    assert true_error.displacement_error(model, solution, exact, 0.5) == 0.0
    size = math.sqrt(sum(
        w * u**2 for w, u in zip([0.5, *[1] * 9, 0.5, 0.5, *[1] * 19, 0.5], exact[:, 0], strict=True)
    ))  # fmt: skip
    assert true_error.displacement_error(model, solution, exact + 0.001, 0.5) == pytest.approx(
        0.001 * math.sqrt(30) / size, rel=1e-12
    )
    assert true_error.displacement_error(model, solution, exact, 0.9) is None


# ------------------------------------------------------------------------------------------------ runs


@pytest.mark.parametrize("n", [10, 20, 40])
def test_the_multiplier_method_at_courant_one_errs_at_the_release_alone(n):
    """Where the force jumps the mean of both sides is that over the step; at the release half a step is missing."""
    result = run(hunek(n=n, courant=1.0, contact="lagrange"))
    force, exact = (result.arrays[name][:, 0] for name in ("contact_force", "contact_force_exact"))
    release = 6 * n
    assert np.flatnonzero(np.abs(force - exact) > 1e-13).tolist() == [release]
    assert exact[release] - force[release] == pytest.approx(0.025, rel=1e-9)
    found = errors(result)
    squares = 2 * ((2 * n - 1) + 2 * 0.25)  # two plateaus in units of .05, the steps at their ends half
    assert found["force_error_l2"] == pytest.approx(0.5 / math.sqrt(squares), rel=1e-9)
    assert found["force_error_l1"] == pytest.approx(0.5 / (4 * n), rel=1e-9)
    assert found["impulse_error"] == pytest.approx(0.5 / (4 * n), rel=1e-9)
    assert found["noise"] == pytest.approx(1.0, abs=1e-11)
    assert found["overshoot"] == pytest.approx(0.0, abs=1e-11)
    assert found["closing_error"] == 0.0
    # the last step that presses is the one before that around the release
    assert found["opening_error"] == pytest.approx(-result.summary["dt"], rel=1e-6)
    # the release takes half a step of impulse, .00125 / n, from both bars: they part late in the same ratio
    assert 0.0 < result.summary["exact"]["displacement_error"] * n < 0.5


def order(method, courant, finest=8, n=10):
    """Return the orders of the errors in L1, in L2 and of the impulse over four meshes."""
    factors = [1, 2, 4, finest]
    rows = [errors(run(hunek(n=n, courant=courant, contact=method), {"refine": k})) for k in factors]
    return [-np.polyfit(np.log(factors), np.log([row[name] for row in rows]), 1)[0] for name in ERRORS]


BIPENALTY = {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0}


@pytest.mark.parametrize(
    ("method", "courant", "expected", "within"),
    [
        (BIPENALTY, 0.5, (0.96, 0.48), 0.02),
        ("lagrange", 0.5, (0.66, 0.34), 0.02),
        ("lagrange", 1.0, (1.0, 0.5), 0.01),
    ],
    ids=["bipenalty", "lagrange", "lagrange at 1"],
)
def test_orders_on_hunek(method, courant, expected, within):
    found = order(method, courant)
    assert found[0] == pytest.approx(expected[0], abs=within)
    assert found[1] == pytest.approx(expected[1], abs=within)
    assert found[2] == pytest.approx(expected[0], abs=2 * within)


def test_a_smooth_pulse_shows_second_order():
    case = percuss.load(CASES / "smooth-pulse.yaml", {"method.contact": "lagrange", "time.courant": 0.5})
    found = [errors(percuss.run(case, {"refine": k}), "joint") for k in (1, 2, 4)]
    for name in ERRORS:
        one, two, four = (row[name] for row in found)
        assert four < 2e-3
        assert math.log2(one / two) == pytest.approx(2.0, abs=0.3), name
        assert math.log2(two / four) == pytest.approx(2.0, abs=0.3), name


def test_a_sparse_record_has_no_errors_of_the_force_and_says_so():
    case = hunek(n=10)
    case["record"]["every"] = 4
    result = run(case)
    for name in FORCE_ERRORS:
        assert errors(result)[name] is None
    assert "opening_error" in FORCE_ERRORS
    assert result.summary["exact"]["displacement_error"] is not None
    assert any("record.every: 1" in note for note in result.summary["notes"])


# ------------------------------------------------------------------------------------------------ stopped early


@pytest.fixture
def short_of_breath(monkeypatch):
    """Let the engine stop after about a hundred fronts."""
    whole = BarChain.march
    monkeypatch.setattr(BarChain, "march", lambda self, end, most: whole(self, end, 100))
    exact._solved.cache_clear()  # the last solution is kept
    yield
    exact._solved.cache_clear()


def many_fronts():
    case = hunek(n=10, end=12.0)
    case["bodies"]["long"]["material"] = {"young": 77.0, "density": 0.013}
    case["bodies"]["short"]["fixed"] = ["left"]
    return case


def test_a_run_of_which_a_part_is_known_has_no_true_error_but_that_of_the_part(short_of_breath):
    result = run(many_fronts())
    summary = result.summary
    assert summary["exact"] is None
    covered = summary["exact_covered"]
    until = covered["until"]
    assert 0.5 < until < 6.0
    why = "it takes more than 100 fronts (most_fronts)"
    assert summary["exact_reason"] == f"bars-in-a-row holds up to {until:.9g} only: {why}"
    known = result.arrays["time"] + 0.5 * summary["dt"] <= until
    for name in ("contact_force_exact", "gap_exact"):
        assert np.isfinite(result.arrays[name][known]).all()
        assert np.isnan(result.arrays[name][~known]).all()
    part = covered["contacts"]["tip"]
    assert all(math.isfinite(part[name]) for name in (*ERRORS, "noise"))
    assert "displacement_error" not in covered  # it is that of the end
    closed = part["closed"]
    assert all(start < stop <= until for start, stop in closed)
    assert closed[-1][1] > 0.5 * until
    assert result.exact.reached == until


def test_nothing_ranks_a_run_by_the_part_that_is_known(short_of_breath, tmp_path):
    """Comparison, orders, columns of a study, expectations and the twin that is tied."""
    case = percuss.load(many_fronts() | {"expect": [
        {"quantity": "exact.contacts.tip.force_error_l1", "value": 0, "within": 1e9, "source": "exact"},
    ]})  # fmt: skip
    whole = percuss.run(percuss.load(hunek(n=10)))
    rows = compare(case, ["wu-predictor-corrector"], ["lagrange", "bipenalty"], {"refine": [1, 2]}, tied=True)
    for row in rows:
        if row.result is None:
            assert row.status == "refused"
            assert "holds up to" in row.reason
            continue
        assert all(metrics(row)[name] is None for name in truth_of_columns)
    assert any(row.status == "refused" for row in rows)
    for fitted in orders(rows):
        assert all(fitted[f"{name}_order"] is None for name in truth_of_columns)
    result = percuss.run(case)
    for name in (*truth_of_columns, "noise", "overshoot", "exact.contacts.*.force_error_l1", "ripple"):
        column = column_by_name(name, [case.registry])
        assert column.take(result, case.registry) is None
        assert column.take(whole, case.registry) is not None
    (check,) = verify(case, result)
    assert not check.passed
    assert check.why == f"no true error is known of this run: {result.summary['exact_reason']}"
    result.save(tmp_path / "short.nc")
    again = percuss.open_result(tmp_path / "short.nc")
    assert again.summary["exact"] is None
    assert again.exact.reached == pytest.approx(result.summary["exact_covered"]["until"])


truth_of_columns = (*ERRORS, "displacement_error")


@pytest.mark.parametrize("phase", np.linspace(0.0, 1.0, 7)[:-1])
@pytest.mark.parametrize("dt", [0.3, 0.05])
def test_the_exact_history_itself_closes_and_opens_in_time(dt, phase):
    """Its first and last step that presses are late by half a step at most, to either side alike."""
    time = (np.arange(round(8.0 / dt)) + phase) * dt
    found = judged(Pulse().mean_force(time - 0.5 * dt, time + 0.5 * dt), time, dt)
    for name in ("closing_error", "opening_error"):
        assert abs(found[name]) <= 0.5 * dt * (1.0 + 1e-9)


# ------------------------------------------------------------------------------------------------ round-off


def test_a_nudge_does_not_move_hunek():
    assert run(hunek(n=50), nudge=True).summary["fragile"] is False


def test_a_stiff_penalty_that_chatters_hangs_on_round_off():
    case = hunek(
        n=50, integrator="central-difference", contact={"name": "penalty", "beta_s": 99.0}, courant=0.1, end=2.4
    )
    assert run(case, nudge=True).summary["fragile"] is True


def test_fragile_is_a_change_of_more_than_a_ten_thousandth():
    forces = run(hunek(n=10)).arrays["contact_force"]
    for factor, fragile in ((1.0, False), (1.00009, False), (1.00011, True)):
        assert runner.differs(forces, factor * forces) is fragile
    assert runner.differs(forces, forces[:-1]) is True
    assert runner.nudged(percuss.load(hunek()), 0.5).bodies["short"].area == 1.0 + 1e-12


# ------------------------------------------------------------------------------------------------ files


def test_a_saved_result_keeps_its_exact_histories_and_finds_its_solution_again(tmp_path):
    result = run(hunek(n=10))
    result.save(tmp_path / "hunek.nc")
    again = percuss.open_result(tmp_path / "hunek.nc")
    assert again.solution is None
    t = np.linspace(0.0, 0.8, 101)
    for name in ("force", "impulse", "gap"):
        one, other = (getattr(one.exact.contacts["tip"], name)(t) for one in (result, again))
        assert np.abs(one - other).max() <= 1e-14
    assert (again.exact.displacement("long", 3.0, t) == result.exact.displacement("long", 3.0, t)).all()
    assert again.exact is again.exact
    times, force = again.exact_histories["tip"]
    assert (times == result.arrays["time"]).all()
    assert (force == result.arrays["contact_force_exact"][:, 0]).all()
