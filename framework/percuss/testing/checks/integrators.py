"""Checks of integrators: order, conservation and stability as declared, and the first step."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from percuss.errors import RunError, nearest
from percuss.methods.interfaces import Integrator, LeapFrog, Stages
from percuss.testing.draws import STEEL
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check

CONSERVED = ("energy", "momentum")
COURANTS = (0.4, 0.2, 0.1, 0.05)  # of the measured order
SLACK = 0.15  # of an order
LOWEST = 1e-11  # of the amplitude: errors below are round-off
KEPT = 1e-11
BESIDE = 0.01  # of the critical Courant number


def hung(elements: int, courant: float, steps: int) -> dict[str, Any]:
    """Return a bar fixed at one end and struck at the other, without contact."""
    bar = {"bar": {"length": 1.0, "elements": elements}, "material": STEEL, "area": 1.0, "velocity": 1.0}
    return {
        "percuss": 1,
        "bodies": {"a": {**bar, "fixed": ["left"]}},
        "contacts": {},
        "time": {"steps": steps, "courant": courant},
        "record": {"probes": ["a.right"]},
    }


def swinging(elements: int, time: Any) -> Any:
    """Return the exact displacement of the free end of the discretised bar at some times, by its modes."""
    h, (young, density) = 1.0 / elements, STEEL.values()
    stiffness = np.zeros((elements + 1, elements + 1))
    mass = np.zeros(elements + 1)
    for e in range(elements):
        stiffness[e : e + 2, e : e + 2] += young / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
        mass[e : e + 2] += 0.5 * density * h
    root = np.sqrt(mass[1:])
    squares, modes = np.linalg.eigh(stiffness[1:, 1:] / root[:, None] / root)
    omega = np.sqrt(squares)
    start = modes.T @ root
    return (modes[-1] / root[-1] * start / omega) @ np.sin(omega[:, None] * time)


@check("integrators")
def check_order(subject: Subject) -> None:
    """Halving the step divides the error of the motion without contact by two to the declared `order`.

    Measured on a swinging bar of four elements against its modes, above the floor of round-off, to 0.15 of an order.
    """
    declared = getattr(subject.component, "order", None)
    if not isinstance(declared, int) or declared < 1:
        raise CheckFailed(f"`order` is {declared!r}, expected a whole number of at least 1")
    for options in subject.examples:
        errors = []
        for courant in COURANTS:
            case = subject.placed(hung(4, courant, round(6.0 / courant)), options)
            result = subject.run(case)
            exact = swinging(4, result.arrays["time"])
            found = result.arrays["displacement"][:, 0, 0]
            errors.append(float(np.abs(found - exact).max() / np.abs(exact).max()))
        used = [k for k, error in enumerate(errors) if error > LOWEST]
        if len(used) < 2:
            continue
        slope = np.log(errors[used[-2]] / errors[used[-1]]) / np.log(COURANTS[used[-2]] / COURANTS[used[-1]])
        if abs(slope - declared) > SLACK:
            told = ", ".join(f"{error:.3g} at C = {c:g}" for c, error in zip(COURANTS, errors, strict=True))
            raise CheckFailed(f"it declares order {declared} and shows {slope:.2f} with {options}: {told}")


@check("integrators")
def check_conserves(subject: Subject) -> None:
    """What an integrator declares to conserve (`conserves`) it does conserve to round-off, without contact.

    Energy is that of the run's own ledger, over a thousand steps of a swinging bar; momentum that of a bar in flight.
    """
    for fact in subject.component.conserves:  # type: ignore[attr-defined]
        if fact not in CONSERVED:
            near = nearest(fact, CONSERVED)
            raise CheckFailed(f"'{fact}' is nothing that can be conserved{f'; did you mean {near!r}?' if near else ''}")
    declared = subject.component.conserves  # type: ignore[attr-defined]
    for options in subject.examples:
        for courant in (0.3, 0.9):
            result = subject.run(subject.placed(hung(7, courant, 1000), options))
            energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
            drift = float(np.abs(energy - energy[0]).max() / energy[0])
            if "energy" in declared and drift > KEPT:
                raise CheckFailed(f"it declares to conserve energy, which changes by {drift:.2g} at C = {courant:g}")
            case = hung(7, courant, 1000)
            case["bodies"]["a"]["fixed"] = []
            momentum = subject.run(subject.placed(case, options)).summary["momentum"]
            lost = abs(momentum["final"][0] / momentum["initial"][0] - 1.0)
            if "momentum" in declared and lost > KEPT:
                raise CheckFailed(f"it declares to conserve momentum, which changes by {lost:.2g}")


@check("integrators")
def check_critical_courant(subject: Subject) -> None:
    """Without contact the scheme is stable up to the Courant number that it declares (`critical_courant`), no further.

    A uniform bar in flight: bounded one per cent below, and growing without bound one per cent above.
    """
    declared = subject.component.critical_courant  # type: ignore[attr-defined]
    if declared is None:
        raise NotApplicable("it declares no critical Courant number")
    for above, courant in ((False, (1.0 - BESIDE) * declared), (True, (1.0 + BESIDE) * declared)):
        case = hung(20, courant, 3000)
        case["bodies"]["a"]["fixed"] = []
        case["bodies"]["b"] = {**case["bodies"]["a"], "at": 1.0, "fixed": ["left"]}  # what swings
        case["time"]["on_unstable"] = "warn"
        energy = _largest_energy(subject, subject.placed(case, subject.examples[0]))
        if above and energy < 1e3:
            raise CheckFailed(f"it declares {declared:g}, and is still bounded at C = {courant:.5g}")
        if not above and energy > 1e3:
            raise CheckFailed(f"it declares {declared:g}, and its energy grows {energy:.2g}-fold at C = {courant:.5g}")


def _largest_energy(subject: Subject, case: Mapping[str, Any]) -> float:
    """Return the largest energy of a run over its first one, infinite where the run was stopped."""
    try:
        result = subject.run(case)
    except RunError:
        return np.inf
    with np.errstate(all="ignore"):
        energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
        most = float(np.abs(energy).max() / abs(energy[0]))
    return most if np.isfinite(most) else np.inf


@check("integrators")
def check_first_step(subject: Subject) -> None:
    """The first record is the initial state, and the first step goes on with the initial velocity.

    A scheme that starts its history from rest loses the impact before it begins.
    """
    for options in subject.examples:
        case = hung(5, 0.5, 10)
        case["bodies"]["a"]["fixed"] = []
        result = subject.run(subject.placed(case, options))
        place, velocity = result.arrays["displacement"][:, 0, 0], result.arrays["velocity"][:, 0, 0]
        if place[0] != 0.0 or abs(velocity[0] - 1.0) > 1e-14:
            raise CheckFailed(
                f"the first record has displacement {place[0]:g} and velocity {velocity[0]:g}, not 0 and 1"
            )
        straight = result.arrays["time"]
        if np.abs(place - straight).max() > 1e-12 * straight.max():
            raise CheckFailed(f"a bar in free flight is at {place[-1]:.9g} at time {straight[-1]:.9g}, at velocity 1")


@check("integrators")
def check_stages(subject: Subject) -> None:
    """What `Stages` says of each stage is so: loads are taken at `times`, and `end` tells the displacement to come.

    Two steps of random data. In free flight at velocity v a stage is handed the displacement u + c dt v, and c is its
    time: at another one the loads are those of another instant. Where `end` is (r_v, r_a, s_a), the next stage is
    handed the displacement u + r_v v + r_a a, for any u, v and a of this one, and s_a = r_a / r_v: else a law judged at
    the end of the step is judged somewhere else.
    """
    for options in subject.examples:
        integrator, dt = subject.make(options), 0.37
        stages = integrator.bind(dt)
        if isinstance(stages, LeapFrog):
            raise NotApplicable("it is a leap-frog scheme")
        _check_times(integrator, stages, dt)
        if stages.end:
            _check_end(integrator, stages, dt)


ENTRIES = 6  # of the state with which a step is made
STAGED_TOLERANCE = 1e-9

Asked = list[tuple[int, Any, Any, Any]]  # of each call of `accelerations`: stage, u, v, a


def _two_steps(integrator: Integrator, stages: Stages, dt: float, *, free: bool) -> tuple[list[Any], Asked, list[int]]:
    """Make two steps with random data; accelerations and what is kept are zero in `free` flight.

    Returns
    -------
    tuple
        Displacement and velocity at the begin of each step, what the steps asked for, and how often in each.
    """
    from percuss.methods import slots
    from percuss.solver.compiler.specialise import Specialiser
    from percuss.solver.integrator_check import kernel_of

    random = np.random.default_rng(7)
    asked: Asked = []

    def accelerations(system: Any, stage: int, u: Any, v: Any, a: Any) -> None:  # noqa: ARG001  as the slot has it
        a[:] = 0.0 if free else random.standard_normal(u.size)
        asked.append((stage, u.copy(), v.copy(), a.copy()))

    step = Specialiser({slots.accelerations: accelerations}, jit=False).bind(kernel_of(integrator))
    u, v = random.standard_normal((2, ENTRIES))
    kept = random.standard_normal((type(integrator).kept, ENTRIES)) * (0.0 if free else 1.0)
    begins, counts = [], []
    for _ in range(2):
        begins.append((u.copy(), v.copy()))
        before = len(asked)
        step(stages.numbers, None, u, v, kept, dt)
        counts.append(len(asked) - before)
    return begins, asked, counts


def _check_times(integrator: Integrator, stages: Stages, dt: float) -> None:
    begins, asked, counts = _two_steps(integrator, stages, dt, free=True)
    number = np.repeat(np.arange(2), counts)
    for k, (stage, u, _, _) in zip(number, asked, strict=True):
        start, velocity = begins[k]
        found = float((u - start) @ velocity / (dt * velocity @ velocity))
        if abs(found - stages.times[stage]) > STAGED_TOLERANCE:
            raise CheckFailed(
                f"`times` says that stage {stage} is at {stages.times[stage]:.9g} of the step, and in free flight it "
                f"is handed the displacement of {found:.9g}"
            )


def _check_end(integrator: Integrator, stages: Stages, dt: float) -> None:
    _, asked, _ = _two_steps(integrator, stages, dt, free=False)
    for (stage, u, v, a), (_, after, _, _) in itertools.pairwise(asked):
        r_v, r_a, s_a = stages.end[stage]
        size = float(np.abs(after).max() + np.abs(u).max())
        if np.abs(u + r_v * v + r_a * a - after).max() > STAGED_TOLERANCE * size:
            fit = np.linalg.lstsq(np.stack([v, a], axis=1), after - u, rcond=None)[0]
            raise CheckFailed(
                f"`end` says of stage {stage} that the displacement to come is u + {r_v:.9g} v + {r_a:.9g} a; the next "
                f"stage is handed another one, nearest to u + {fit[0]:.9g} v + {fit[1]:.9g} a (the step is {dt:g})"
            )
        if abs(s_a - r_a / r_v) > STAGED_TOLERANCE * abs(s_a):
            raise CheckFailed(
                f"`end` says of stage {stage} s_a = {s_a:.9g}; the mean velocity until the next stage takes "
                f"r_a / r_v = {r_a / r_v:.9g}"
            )
