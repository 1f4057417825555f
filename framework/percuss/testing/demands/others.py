"""Demands on loads, exact solutions and measures."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from percuss.contact.contact_problem import contact_problem
from percuss.jsonable import Entries
from percuss.march.model_of_case import model_of
from percuss.methods.interfaces import FollowingLoad
from percuss.methods.plugin_calls import answer
from percuss.testing.draws import STRUCK_WALL, TWO_BARS, bar, bar_chains, chain, for_all, must_balance, on_chains
from percuss.testing.subject import ROUND_OFF, CheckFailed, NotApplicable, Subject, demand, must

TIMES = np.linspace(0.0, 1.0, 41)
TOLERANCE = 1e-12


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
            same = np.allclose(amplitude, alone, rtol=0.0, atol=TOLERANCE * size)
            must(same, "the amplitude at a time depends on the other times of the array")


@demand("loads")
def check_kinks(subject: Subject) -> None:
    """`kinks` names every kink.

    The amplitude is smooth between the times that `kinks` returns, because an exact solution relies on it. Of any
    four neighbouring points, the fourth lies near the parabola through the other three.
    """
    declared = [(load, kinks) for _, load in subject.made() if (kinks := load.kinks()) is not None]
    if not declared:
        raise NotApplicable("`kinks` returns None")
    for load, kinks in declared:
        times = np.linspace(1e-4, 1.2, 3001)
        near_kink = np.abs(times[:, None] - np.array([*kinks, -1.0])).min(axis=1) < 5 * (times[1] - times[0])
        values = np.asarray(load.amplitude(times), dtype=float)
        bends = np.abs(np.diff(values, 3))
        clear = ~np.lib.stride_tricks.sliding_window_view(near_kink, 4).any(axis=1)
        typical = np.median(bends[clear]) if clear.any() else 0.0
        size = float(np.abs(values).max(initial=1e-300))
        for rough in np.flatnonzero(clear & (bends > 1e3 * typical + 1e-4 * size)):
            raise CheckFailed(f"the amplitude has a kink near time {times[rough]:.4g}, and `kinks` does not name it")


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
        again = subject.run(case) if follows else result
        same = again.summary["momentum"] == result.summary["momentum"]
        must(same, "the run gives another motion the second time")


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
        cases = [subject.placed(case, options) for case in (TWO_BARS, STRUCK_WALL)]
        problems: list[Any] = [contact_problem(model_of(subject.load(case))) for case in cases]
        covered = [case for case, problem in zip(cases, problems, strict=True) if engine.covers(problem) is None]
        if not covered:
            raise NotApplicable("it covers neither two bars that meet nor a bar that strikes a wall")
        errors = []
        for refine in (2, 8):
            summary: Any = subject.run({**covered[0], "refine": refine, "time": {"end": 0.03, "courant": 0.5}}).summary
            must(summary["exact"], f"no error against it was computed: {summary['exact_reason']}")
            errors.append(summary["exact"]["displacement_error"])
        words = f"a mesh four times finer brings the displacement from {errors[0]:.3g} to {errors[1]:.3g}"
        must(errors[1] < 0.5 * errors[0], words)


def _check_contacts(subject: Subject, case: Entries) -> None:
    """Raise `CheckFailed` unless the contacts of a drawn case press or are open, and its energy is balanced."""
    model = model_of(subject.load(case))
    problem: Any = contact_problem(model)
    engine = subject.make(subject.examples[0])
    reason = engine.covers(problem)
    if reason is not None:
        in_words = isinstance(reason, str) and reason.strip()
        must(in_words, f"`covers` gives {reason!r}, expected a reason in words or None")
        raise NotApplicable(f"it covers no drawn case: {reason}")
    end = model.dt * model.steps
    solution = engine.solve(problem, end)
    in_words = isinstance(solution.stopped, str) and solution.stopped.strip()
    reached = in_words or solution.reached >= end * (1.0 - ROUND_OFF)
    must(reached, f"it ends at {solution.reached:.6g} of {end:.6g}, and `stopped` gives no reason")
    end = min(end, solution.reached)
    time = np.linspace(0.0, end, 400, endpoint=False) + end / 1000.0
    for name, contact in solution.contacts.items():
        force, gap = np.asarray(contact.force(time)), np.asarray(contact.gap(time))
        size, travel = float(np.abs(force).max()), float(np.abs(gap).max()) + end
        must(force.min() >= -ROUND_OFF * size, f"contact '{name}' pulls with {force.min():.3g}")
        must(gap.min() >= -ROUND_OFF * travel, f"the bodies of contact '{name}' overlap by {-gap.min():.3g}")
        apart = np.abs(force * gap).max() <= ROUND_OFF * size * travel
        must(apart, f"contact '{name}' presses where it is open")
        most, stated = force.max(), contact.largest_force(0.0, end)
        words = f"contact '{name}' presses with {most:.6g}, the stated largest is {stated:.6g}"
        must(most <= stated + ROUND_OFF * size, words)
    first, last = (sum(solution.energy(t)) for t in (0.0, end))
    gained, work = last - first, solution.work(end)
    balanced = abs(gained - work) <= ROUND_OFF * max(first, last, 1e-300)
    must(balanced, f"energy changes by {gained:.6g}, the work is {work:.6g}")


@demand("measures")
@on_chains()
def check_measure(subject: Subject, case: Entries) -> None:
    """It measures the same number each time.

    A measure returns a finite number or None, the same each time for a result, and does not change the result.
    `what` states quantity, norm and averaging, because a column without them cannot be interpreted.
    """
    what = getattr(subject.component, "what", "")
    must(isinstance(what, str) and what.strip(), "`what` is empty: say quantity, norm and averaging")
    result = subject.run(case)
    before = {name: np.array(values, copy=True) for name, values in result.arrays.items()}
    first, second = (answer(subject.make(subject.options), "of", result) for _ in range(2))
    must(first == second, f"it measures {first!r}, and {second!r} the second time")
    for name, values in before.items():
        same = np.array_equal(values, result.arrays[name], equal_nan=True)
        must(same, f"it changes {name} of the result")
