"""Demands on loads, exact solutions and measures."""

from __future__ import annotations

import dataclasses
from typing import Any, cast

import numpy as np

from percuss.contact.contact_problem import contact_problem
from percuss.jsonable import Entries
from percuss.march.model_of_case import model_of
from percuss.methods.interfaces import FollowingLoad
from percuss.methods.plugin_calls import answer
from percuss.testing.draws import STRUCK_WALL, TWO_BARS, bar, bar_chains, chain, for_all, must_balance, on_chains
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, demand

TIMES = np.linspace(0.0, 1.0, 41)
TOLERANCE = 1e-12
CLOSE = 1e-9


@demand("loads")
def check_amplitude(subject: Subject) -> None:
    """Each time has one finite amplitude.

    An amplitude is a finite number for each time of an array, whatever the length of the array and its other times.
    Amplitudes are computed in chunks of steps: one that uses neighbouring times depends on where chunks end.
    """
    if issubclass(subject.component, FollowingLoad):
        raise NotApplicable("it follows the motion of an end; it is no function of time")
    for _, load in subject.made():
        for time in (TIMES, TIMES[:1], TIMES[:0], TIMES[::-1].copy(), TIMES * 1e3):
            amplitude = np.asarray(answer(load, "amplitude", time), dtype=float)
            alone = [float(np.asarray(load.amplitude(time[k : k + 1]))[0]) for k in range(time.size)]
            size = float(np.abs(amplitude).max(initial=1.0))
            if not np.allclose(amplitude, alone, rtol=0.0, atol=TOLERANCE * size):
                raise CheckFailed("the amplitude at a time depends on the other times of the array")


@demand("loads")
def check_kinks(subject: Subject) -> None:
    """`kinks` names every kink.

    The amplitude is smooth between the times that `kinks` returns, because an exact solution relies on it. Of any
    four neighbouring points, the fourth lies near the parabola through the other three.
    """
    declares_kinks = False
    for _, load in subject.made():
        kinks = load.kinks()
        if kinks is None:
            continue
        declares_kinks = True
        times = np.linspace(1e-4, 1.2, 3001)
        near_kink = np.abs(times[:, None] - np.array([*kinks, -1.0])).min(axis=1) < 5 * (times[1] - times[0])
        values = np.asarray(load.amplitude(times), dtype=float)
        bends = np.abs(np.diff(values, 3))
        clear = ~(near_kink[:-3] | near_kink[1:-2] | near_kink[2:-1] | near_kink[3:])
        typical = np.median(bends[clear]) if clear.any() else 0.0
        size = float(np.abs(values).max(initial=1e-300))
        rough = np.flatnonzero(clear & (bends > 1e3 * typical + 1e-4 * size))
        if rough.size:
            raise CheckFailed(f"the amplitude has a kink near time {times[rough[0]]:.4g}, and `kinks` does not name it")
    if not declares_kinks:
        raise NotApplicable("`kinks` returns None")


@demand("loads")
def check_runs_in_a_case(subject: Subject) -> None:
    """Its work and its impulse are accounted for.

    In a run with the load on a free bar, at its end, everywhere or as the velocity of the driven end, momentum and
    energy are balanced to round-off. Of a load that follows the motion of an end this holds its kernel to what it says
    of its force.
    """
    for options, load in subject.made():
        vector = load.vector()
        dim = len(vector) if vector is not None else 1
        start = np.eye(dim)[0].tolist()
        follows = isinstance(load, FollowingLoad)
        body = bar(5, velocity=start if follows else 0.0, at=[0.0] * dim)
        if dim > 1:
            body["bar"]["direction"] = start
        push = {subject.name: dict(options), **({} if load.everywhere else {"on": "a.left"})}
        case = chain({"a": body}, loads={"push": push}, time={"steps": 400, "courant": 0.5})
        result = subject.run(case)
        must_balance(result)
        if follows and subject.run(case).summary["momentum"] != result.summary["momentum"]:
            raise CheckFailed("the run gives another motion the second time")


@demand("solutions")
def check_exact_solution(subject: Subject) -> None:
    """It is the motion to which runs tend.

    In a case that the solution covers, the displacements of a run tend to the exact ones as the mesh is refined. In no
    drawn case a contact pulls, overlaps, or presses where it is open, and no sample of a force is above the stated
    largest one. The energy changes by the work of the loads. A case that is not covered is told in words.
    """
    for_all(subject, bar_chains(), lambda case: _check_contacts(subject, case))
    components = subject.registry.components.items()
    sole = {key: cls for key, cls in components if key[0] != "solutions" or key[1] == subject.name}
    subject = dataclasses.replace(subject, registry=dataclasses.replace(subject.registry, components=sole))
    for options, engine in subject.made():
        found = [subject.placed(case, options) for case in (TWO_BARS, STRUCK_WALL)]
        covered = [
            case for case in found if engine.covers(cast("Any", contact_problem(model_of(subject.load(case))))) is None
        ]
        if not covered:
            raise NotApplicable("it covers neither two bars that meet nor a bar that strikes a wall")
        errors = []
        for refine in (2, 8):
            result = subject.run({**covered[0], "refine": refine, "time": {"end": 0.03, "courant": 0.5}})
            if result.summary["exact"] is None:
                raise CheckFailed(f"no error against it was computed: {result.summary['exact_reason']}")
            errors.append(cast("float", result.summary["exact"]["displacement_error"]))
        if not errors[1] < 0.5 * errors[0]:
            raise CheckFailed(
                f"a mesh four times finer brings the displacement from {errors[0]:.3g} to {errors[1]:.3g}"
            )


def _check_contacts(subject: Subject, case: Entries) -> None:
    """Raise `CheckFailed` unless the contacts of a drawn case press or are open, and its energy is balanced."""
    solution, end = _solved(subject, case)
    time = np.linspace(0.0, end, 400, endpoint=False) + end / 1000.0
    for name, contact in solution.contacts.items():
        force, gap = np.asarray(contact.force(time)), np.asarray(contact.gap(time))
        size, travel = float(np.abs(force).max()), float(np.abs(gap).max()) + end
        if force.min() < -CLOSE * size:
            raise CheckFailed(f"contact '{name}' pulls with {force.min():.3g}")
        if gap.min() < -CLOSE * travel:
            raise CheckFailed(f"the bodies of contact '{name}' overlap by {-gap.min():.3g}")
        if np.abs(force * gap).max() > CLOSE * size * travel:
            raise CheckFailed(f"contact '{name}' presses where it is open")
        if force.max() > (largest := contact.largest_force(0.0, end)) + CLOSE * size:
            raise CheckFailed(f"contact '{name}' presses with {force.max():.6g}, the stated largest is {largest:.6g}")
    first, last = (sum(solution.energy(t)) for t in (0.0, end))
    if abs(last - first - solution.work(end)) > CLOSE * max(first, last, 1e-300):
        raise CheckFailed(f"energy changes by {last - first:.6g}, the work is {solution.work(end):.6g}")


def _solved(subject: Subject, case: Entries) -> tuple[Any, float]:
    """Return the exact solution of a case and the time up to which the check uses it.

    Raises
    ------
    NotApplicable
        If the solution does not cover the case.
    CheckFailed
        If it gives no reason for not covering the case, or for ending early.
    """
    model = model_of(subject.load(case))
    problem: Any = contact_problem(model)
    engine = subject.make(subject.examples[0])
    reason = engine.covers(problem)
    if reason is not None:
        if not isinstance(reason, str) or not reason.strip():
            raise CheckFailed(f"`covers` gives {reason!r}, expected a reason in words or None")
        raise NotApplicable(f"it covers no drawn case: {reason}")
    end = model.dt * model.steps
    solution = engine.solve(problem, end)
    if solution.reached < end * (1.0 - CLOSE) and not (isinstance(solution.stopped, str) and solution.stopped.strip()):
        raise CheckFailed(f"it ends at {solution.reached:.6g} of {end:.6g}, and `stopped` gives no reason")
    return solution, min(end, solution.reached)


@demand("measures")
@on_chains()
def check_measure(subject: Subject, case: Entries) -> None:
    """It measures the same number each time.

    A measure returns a finite number or None, the same each time for a result, and does not change the result.
    `what` states quantity, norm and averaging, because a column without them cannot be interpreted.
    """
    what = getattr(subject.component, "what", "")
    if not isinstance(what, str) or not what.strip():
        raise CheckFailed("`what` is empty: say quantity, norm and averaging")
    result = subject.run(case)
    before = {name: np.array(values, copy=True) for name, values in result.arrays.items()}
    first, second = (answer(subject.make(subject.options), "of", result) for _ in range(2))
    if first != second:
        raise CheckFailed(f"it measures {first!r}, and {second!r} the second time")
    for name, values in before.items():
        if not np.array_equal(values, result.arrays[name], equal_nan=True):
            raise CheckFailed(f"it changes {name} of the result")
