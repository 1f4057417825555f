"""The time loop: records, chunks, loads switched in time, interruption, runs that are stopped, and results on disk."""

import signal

import numpy as np
import pytest

import percuss
from percuss.march import march
from percuss.march.model_of_case import model_of
from percuss.step.bulk import PIECE
from strategies import CORE, INTEGRATORS, INVISCID, LEAPFROG, REGISTRY, bar, case_of, each_integrator, hunek, run

WALL = {"w": {"body": "a.right", "wall": 1.0}}
GROWING = {"p": {"ramp": {"value": 0.01, "duration": 0.04}, "on": "a.left"}}
HISTORIES = (
    "time", "time_half", "contact_force", "contact_force_end", "gap", "displacement", "velocity", "kinetic_energy",
    "elastic_energy", "external_work", "contact_work", "contact_energy", "energy_error", "energy_growth",
)  # fmt: skip


def one_bar(time, loads=None, elements=10, contacts=None, **body):
    case = case_of({"a": bar(1.0, elements) | body}, contacts or {}, time, loads)
    return case | {"method": {"integrator": "central-difference", "contact": "penalty"}}


def equal(one, other, rows=slice(None)):
    for name in HISTORIES:
        if name in one.arrays:
            np.testing.assert_array_equal(one.arrays[name][rows], other.arrays[name], err_msg=name)


# ---------------------------------------------------------------------------------------------------- records


@pytest.mark.parametrize("every", [1, 7, 333, 400])
def test_fewer_records_hold_the_same_numbers(every):
    all_of_them, result = run(hunek(20)), run(hunek(20), {"record.every": every})
    steps = result.summary["steps"]
    assert steps == 320
    rows = sorted({*range(0, steps + 1, every), steps})
    np.testing.assert_array_equal(result.arrays["time"], np.array(rows) * result.summary["dt"])
    assert np.isfinite(result.arrays["kinetic_energy"]).all()
    equal(all_of_them, result, rows)
    for part in ("contacts", "momentum"):
        assert result.summary[part] == all_of_them.summary[part]


@pytest.mark.parametrize("chunk", [1, 7])
def test_chunks_change_nothing(monkeypatch, chunk):
    case = hunek(20)
    case["record"] |= {"every": 3, "fields": 5}
    case["loads"] = {
        "push": {"harmonic": {"value": 0.02, "frequency": 3.0}, "on": "short.left", "from": 0.1, "until": 0.55},
        "drive": {"prescribed-velocity": 0.01, "on": "short.left", "from": 0.6, "until": 0.7},
        "weight": {"gravity": 0.1},
    }
    whole = run(case)
    monkeypatch.setattr(march, "CHUNK_STEPS", chunk)
    calls = []
    parts = run(case, progress=lambda done, total: calls.append((done, total)))
    assert len(calls) >= 320 // chunk
    assert calls[-1] == (320, 320)
    equal(whole, parts)
    np.testing.assert_array_equal(whole.field_arrays["stress"], parts.field_arrays["stress"])
    assert whole.summary["contacts"] == parts.summary["contacts"]
    impulses = [one.summary["momentum"]["impulse_of_loads"] for one in (whole, parts)]
    assert impulses[0] == pytest.approx(impulses[1], rel=1e-12)
    assert parts.summary["momentum"]["error"] < 1e-12


# ------------------------------------------------------------------------------------- loads switched in time


@pytest.mark.parametrize(
    ("start", "stop"),
    [(0.0, 0.05), (0.013, 0.0457), (0.01249, 0.01251), (0.02, 0.021), (-1.0, 0.03), (0.0, 1e-5), (-1.0, -1e-4)],
)
@pytest.mark.parametrize("kind", ["force", "acceleration"])
def test_a_constant_load_switched_between_steps_brings_its_exact_impulse(start, stop, kind):
    load = {"constant": 2.0, "on": "a", "as": kind, "from": start, "until": stop}
    result = run(one_bar({"end": 0.1, "courant": 0.7}, {"push": load}))
    share = 2.0 if kind == "force" else 2.0 * 0.01
    impulse = share * (max(stop, 0.0) - max(start, 0.0))
    momentum = result.summary["momentum"]
    assert momentum["final"][0] == pytest.approx(impulse, rel=1e-12, abs=1e-17)
    assert momentum["error"] < 1e-12


@pytest.mark.parametrize("shift", [1e-15, -1e-15, 1e-9, -1e-9])
def test_a_load_switched_within_round_off_of_a_step_is_the_same_load(shift):
    """A switch falls between two steps or on one: the answer must not jump by a step's worth."""
    dt, moves = 0.001, []
    for start in (0.01, 0.01 + shift):
        load = {"constant": 2.0, "on": "a.left", "from": start, "until": start + 20.5 * dt}
        moves.append(run(one_bar({"step": dt, "steps": 60}, {"push": load})).arrays["displacement"])
    assert np.abs(moves[0] - moves[1]).max() <= (1e-12 + 1e4 * abs(shift)) * np.abs(moves[0]).max()


def test_an_end_moves_as_it_is_driven_and_is_free_afterwards():
    dt = 0.0005
    load = {"prescribed-velocity": 0.2, "on": "a.left", "from": 0.0, "until": 50 * dt}
    result = run(one_bar({"step": dt, "steps": 400}, {"drive": load}, velocity=0.0))
    left = result.arrays["displacement"][:, 0, 0]
    driven = np.arange(51)
    np.testing.assert_allclose(left[driven], 0.2 * dt * driven, rtol=1e-12)
    # then the bar flies free: what the drive gave it of momentum stays
    momentum = result.summary["momentum"]
    assert momentum["final"][0] == pytest.approx(momentum["initial"][0] + momentum["impulse_of_supports"][0], rel=1e-12)
    assert np.abs(np.diff(left[51:]) - 0.2 * dt).max() > 0.05 * dt
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert np.ptp(energy[51:]) <= 1e-13 * energy.max()
    assert np.ptp(result.arrays["external_work"][50:]) == 0.0
    assert result.summary["energy"]["ledger_error"] < 1e-13


def test_an_end_that_moves_freely_is_caught_by_a_drive():
    dt = 0.0005
    load = {"ramp": {"value": 0.3, "duration": 0.01}, "on": "a.right", "as": "velocity", "from": 100 * dt}
    result = run(one_bar({"step": dt, "steps": 300}, {"drive": load}, velocity=0.1))
    free = run(one_bar({"step": dt, "steps": 300}, velocity=0.1))
    np.testing.assert_array_equal(result.arrays["displacement"][:101], free.arrays["displacement"][:101])
    step = np.diff(result.arrays["displacement"][:, 1, 0]) / dt
    midpoint = (np.arange(300) + 0.5) * dt
    wanted = 0.3 * np.minimum((midpoint - 100 * dt) / 0.01, 1.0)
    np.testing.assert_allclose(step[100:], wanted[100:], rtol=1e-10)
    assert result.summary["energy"]["ledger_error"] < 1e-13


# ------------------------------------------------------------------------------------------------ interruption


@pytest.fixture
def usual_ctrl_c():
    """A job in the background of a shell ignores Ctrl-C: here it is what it is at a terminal."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("usual_ctrl_c")
def test_ctrl_c_ends_a_run_early_with_what_was_done(monkeypatch):
    monkeypatch.setattr(march, "CHUNK_STEPS", 10)
    case = hunek(20)
    case["record"]["every"] = 3

    def press(done, total):
        if done == 100:
            signal.raise_signal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    result = run(case, progress=press)
    assert signal.getsignal(signal.SIGINT) is before
    assert result.status == "interrupted"
    assert result.summary["steps"] == 100
    assert result.summary["end"] == pytest.approx(100 * result.summary["dt"])
    full = run(case)
    rows = slice(0, 100 // 3 + 1)
    equal(full, result, rows)
    assert result.summary["momentum"]["error"] < 1e-12
    assert result.summary["energy"]["ledger_error"] < 1e-12
    force = run(hunek(20)).arrays["contact_force"][:100, 0]
    assert result.summary["contacts"]["tip"]["impulse"] == pytest.approx(result.summary["dt"] * force.sum(), rel=1e-12)


@pytest.mark.usefixtures("usual_ctrl_c")
def test_the_second_ctrl_c_is_the_usual_one(monkeypatch):
    monkeypatch.setattr(march, "CHUNK_STEPS", 10)

    def press(done, total):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run(hunek(20), progress=press)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


# ----------------------------------------------------------------------------------------- runs that are stopped


@pytest.mark.parametrize("compiled", [True, False])
def test_a_step_above_that_of_the_bodies_is_stopped_and_explained(compiled):
    case = one_bar({"steps": 3000, "courant": 1.05}, {"push": {"constant": 1.0, "on": "a.left"}}, elements=6)
    with pytest.raises(percuss.RunError) as caught:
        run(case, compiled=compiled)
    assert "not started: the certificate says unstable" in str(caught.value)
    assert caught.value.result.summary["steps"] == 0
    case["time"]["on_unstable"] = "warn"
    with pytest.raises(percuss.RunError) as caught:
        run(case, compiled=compiled)
    message, result = str(caught.value), caught.value.result
    stop = result.summary["stop"]
    assert 0 < stop["step"] < 3000
    assert f"step {stop['step']}, time {stop['step'] * result.summary['dt']:.9g}" in message
    assert f", node {stop['node']} of body 'a': " in message
    assert "Courant number 1.05" in message
    assert result.status == "unstable"
    assert result.summary["steps"] == stop["step"]
    for name, values in result.arrays.items():
        assert np.isfinite(values).all(), name


def test_the_stop_does_not_depend_on_chunks_or_records(monkeypatch):
    law = {"name": "bipenalty", "beta_s": 10.0, "ratio": "matched"}
    case = hunek(20, courant=0.9, integrator="central-difference", contact=law)

    def stopped(chunk, every=1):
        monkeypatch.setattr(march, "CHUNK_STEPS", chunk)
        with pytest.raises(percuss.RunError) as caught:
            run(case, {"record.every": every})
        return caught.value.result

    whole = stopped(march.CHUNK_STEPS)
    for chunk, every in ((march.CHUNK_STEPS, 4), (1, 1), (5, 1)):
        other = stopped(chunk, every)
        assert other.summary["stop"] == whole.summary["stop"]
        equal(whole, other, slice(0, None, every))


@pytest.mark.parametrize("integrator", CORE)
@pytest.mark.parametrize(
    "load", [{"ramp": {"value": 2.0, "duration": 0.1}}, {"half-sine": {"peak": 2.0, "duration": 0.1}}], ids=str
)
def test_forces_in_balance_are_no_instability(integrator, load):
    """A node between a support and a wall, pressed on the wall: nothing moves, all works are round-off."""
    press = {"press": {**load, "on": "a", "as": "force"}}
    case = one_bar({"steps": 200, "courant": 0.3}, press, 1, contacts=WALL, fixed=["left"])
    case["method"] = {"integrator": integrator, "contact": "lagrange"}
    result = run(case)
    force = result.arrays["contact_force"][:, 0]
    assert force.max() == pytest.approx(1.0, rel=0.01)
    assert np.abs(result.arrays["displacement"]).max() < 1e-15
    assert result.summary["energy"]["ledger_error"] < 1e-12


# ------------------------------------------------------------------------------------------------ results on disk


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("integrator", ["central-difference", "asynchronous", "noh-bathe"])
def test_the_numbers_of_a_contact_count_the_last_record(integrator, every):
    """The force grows until the end; the bar closes at about 0.01, the time of its waves."""
    case = one_bar({"steps": 32, "courant": 0.5}, GROWING, contacts=WALL)
    result = run(case, {"method.integrator": integrator, "record.every": every})
    contact, (force, gap) = result.summary["contacts"]["w"], (result.arrays[x][:, 0] for x in ("contact_force", "gap"))
    assert force[-1] == force.max() > 0.0
    assert contact["peak_force"] == force[-1]
    assert contact["penetration"]["largest"] == -gap[-1] == -gap.min()
    assert contact["first_closed"] < contact["closed_time"] + contact["first_closed"] <= result.end
    assert contact["last_open"] is None


def test_a_contact_that_closes_in_the_last_record_is_closed():
    def struck(steps):
        return run(one_bar({"steps": int(steps), "courant": 0.5}, GROWING, contacts=WALL))

    whole = struck(32)
    (first, *_) = np.flatnonzero(whole.arrays["contact_force"][:, 0])
    short = struck(first)
    contact = short.summary["contacts"]["w"]
    assert contact["first_closed"] == short.end == whole.summary["contacts"]["w"]["first_closed"]
    assert [contact["last_open"], contact["closed_time"], contact["impulse"]] == [None, 0.0, 0.0]
    assert min(contact["peak_force"], contact["penetration"]["largest"]) > 0.0
    assert struck(first - 1).summary["contacts"]["w"]["first_closed"] is None


# ---------------------------------------------------------------------------------------------- still and small


@pytest.mark.parametrize("contact", ["penalty", "bipenalty", "lagrange"])
@pytest.mark.parametrize("integrator", CORE)
def test_bars_that_touch_at_rest_or_graze_feel_no_force(integrator, contact):
    """At rest nothing moves. With one velocity, round-off of the motion must not become a force."""
    case = hunek(10, integrator=integrator, contact={"name": contact})
    case["bodies"]["short"]["velocity"] = 0.0
    result = run(case)
    for name in ("contact_force", "gap", "displacement", "velocity", "kinetic_energy"):
        assert not result.arrays[name].any(), name
    assert result.summary["contacts"]["tip"]["first_closed"] is None
    case["bodies"]["short"]["velocity"] = 0.1
    case["bodies"]["long"] |= {"velocity": 0.1, "fixed": []}
    result = run(case)
    assert np.abs(result.arrays["contact_force"]).max() <= 1e-12 * 0.05


@each_integrator([name for name in INTEGRATORS if name in INVISCID or name not in LEAPFROG])
@pytest.mark.parametrize("elements", [1, 2, PIECE - 1, PIECE, 2 * PIECE + 1])
def test_one_free_bar_vibrates_and_keeps_its_energy(integrator, elements):
    """Meshes up to and beyond a block of nodes: a bar struck at one end, its energy kept to round-off."""
    case = one_bar({"steps": 300, "courant": 0.9}, {"push": {"constant": 1.0, "on": "a.left", "until": 1e-4}}, elements)
    case["method"] = {"integrator": integrator}
    result = run(case)
    assert result.arrays["contact_force"].shape == (301, 0)
    if integrator in LEAPFROG:
        assert result.summary["energy"]["ledger_error"] < 1e-13
    # with a scheme of first order the load at t = 0 counts for a whole step
    excess = 0.5 * result.summary["dt"] if REGISTRY.get("integrators", integrator).order == 1 else 0.0
    if integrator in LEAPFROG or elements > 2:  # stages do not resolve what happens within the first step
        assert result.summary["momentum"]["final"][0] == pytest.approx(1e-4 + excess, rel=1e-11)


@pytest.mark.parametrize("elements", [PIECE, 2 * PIECE + 37])
@pytest.mark.parametrize("dimension", [1, 2])
def test_blocks_are_joined_without_a_seam(elements, dimension):
    """A wave that runs through a mesh of several blocks is d'Alembert's at a Courant number of 1."""
    direction = [1.0] if dimension == 1 else [0.6, 0.8]
    time = {"steps": elements + 10, "courant": 1.0}
    case = one_bar(time, {"push": {"constant": 1.0, "on": "a.left"}}, elements)
    case["bodies"]["a"]["bar"]["direction"] = direction
    result = run(case)
    left = result.arrays["velocity"][:, 0] @ np.array(direction)
    right = result.arrays["velocity"][:, 1] @ np.array(direction)
    # force / (A sqrt(E rho)) = 1 behind the front; the free end, where it arrives after as many steps, doubles it
    assert np.abs(left[1:] - 1.0).max() < 1e-10
    assert np.abs(right[:elements]).max() < 1e-10
    assert np.abs(right[elements + 1 :] - 2.0).max() < 1e-10


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_vectors_of_any_dimension(dimension):
    """Gravity across a bar makes it fall as a whole, beside what happens along it."""
    case = one_bar({"step": 0.0005, "steps": 200}, {"weight": {"gravity": [0.0] * (dimension - 1) + [-10.0]}})
    case["bodies"]["a"]["bar"]["direction"] = [1.0] + [0.0] * (dimension - 1)
    result = run(case)
    expected = np.tile(-5.0 * result.arrays["time"][:, None] ** 2, 2)
    assert result.arrays["displacement"][:, :, -1] == pytest.approx(expected, rel=1e-9, abs=1e-15)
    assert result.summary["energy"]["ledger_error"] < 1e-13


@each_integrator(INTEGRATORS)
@pytest.mark.parametrize("times", [{}, {"from": 0.01, "until": 0.03}], ids=["one stretch", "three stretches"])
def test_a_march_that_is_repeated_gives_the_same_bits(integrator, times):
    push = {"constant": 3.0, "on": "a.left"}
    drive = {"constant": 0.2, "on": "a.right", "as": "velocity", **times}
    case = one_bar({"end": 0.05, "courant": 0.5}, {"push": push, "drive": drive})
    case["method"]["integrator"] = integrator
    made = march.March(model_of(percuss.load(case)))
    made.compile()
    made.keep_beginning()

    def numbers(done):
        return [done.load_impulse, done.reactions, done.record.energy, done.record.velocity]

    first = [values.copy() for values in numbers(made.run())]
    assert all(values.any() for values in first[:2])
    for _ in range(2):
        again = numbers(made.again().run())
        assert [values.tobytes() for values in again] == [values.tobytes() for values in first]
