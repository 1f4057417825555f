"""Checks of exact solutions and of measures."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.testing.draws import TWO_BARS, for_all, rows
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check

CLOSE = 1e-9


def _solved(subject: Subject, engine: Any, case: dict[str, Any]) -> tuple[Any, float]:
    """Return the exact solution of a case and the time that it reached."""
    from percuss.solver.model import Model

    model = Model(subject.load(case))
    why = engine.covers(model)
    if why is not None:
        if not isinstance(why, str) or not why.strip():
            raise CheckFailed(f"`covers` says {why!r}, expected a reason in words or None")
        raise NotApplicable(f"it covers no drawn case: {why}")
    end = model.dt * model.steps
    solution = engine.solve(model, end)
    if solution.reached < end * (1.0 - CLOSE) and not (isinstance(solution.stopped, str) and solution.stopped.strip()):
        raise CheckFailed(f"it holds up to {solution.reached:.6g} of {end:.6g} only, and `stopped` does not say why")
    return solution, min(end, solution.reached)


@check("solutions")
def check_signorini(subject: Subject) -> None:
    """An exact contact never pulls, its bodies never overlap, and it presses only where they touch.

    What stands here is what every method is judged by.
    """

    def complementary(case: dict[str, Any]) -> None:
        for options in subject.examples:
            solution, end = _solved(subject, subject.make(options), case)
            time = np.linspace(0.0, end, 400, endpoint=False) + end / 1000.0
            for name, contact in solution.contacts.items():
                force, gap = np.asarray(contact.force(time)), np.asarray(contact.gap(time))
                size, moved = float(np.abs(force).max()), float(np.abs(gap).max()) + end
                if force.min() < -CLOSE * size:
                    raise CheckFailed(f"contact '{name}' pulls with {force.min():.3g}")
                if gap.min() < -CLOSE * moved:
                    raise CheckFailed(f"the bodies of contact '{name}' overlap by {-gap.min():.3g}")
                if np.abs(force * gap).max() > CLOSE * size * moved:
                    raise CheckFailed(f"contact '{name}' presses where it is open")

    for_all(subject, rows(), complementary)


@check("solutions")
def check_impulse_and_balances(subject: Subject) -> None:
    """The impulse is the integral of the force, and momentum and energy change by impulse and work of what acts.

    Energy is lost nowhere: bars in one dimension part as elastically as they met.
    """

    def balanced(case: dict[str, Any]) -> None:
        for options in subject.examples:
            solution, end = _solved(subject, subject.make(options), case)
            fine = np.linspace(0.0, end, 4001)
            for name, contact in solution.contacts.items():
                middles = 0.5 * (fine[1:] + fine[:-1])
                summed = np.cumsum(np.asarray(contact.force(middles))) * (fine[1] - fine[0])
                told = np.asarray(contact.impulse(fine[1:])) - np.asarray(contact.impulse(np.zeros(1)))
                size = float(np.abs(told).max(initial=1e-300))
                if np.abs(summed - told).max() > 0.02 * size:
                    raise CheckFailed(f"the impulse of contact '{name}' is not the integral of its force")
            first, last = (sum(solution.energy(t)) for t in (0.0, end))
            scale = max(first, last, 1e-300)
            if abs(last - first - solution.work(end)) > CLOSE * scale:
                raise CheckFailed(f"energy changes by {last - first:.6g}, and {solution.work(end):.6g} of work is done")
            change = solution.momentum(end) - solution.momentum(0.0)
            size = max(abs(solution.momentum(0.0)), abs(solution.impulse(end)), abs(change), 1e-300)
            if abs(change - solution.impulse(end)) > CLOSE * size + CLOSE:
                raise CheckFailed(f"momentum changes by {change:.6g}, and the impulse is {solution.impulse(end):.6g}")

    for_all(subject, rows(), balanced)


@check("solutions")
def check_largest_values(subject: Subject) -> None:
    """No sample of a contact force or of the energy is above the largest value told, and the energy comes up to it."""

    def bounded(case: dict[str, Any]) -> None:
        for options in subject.examples:
            solution, end = _solved(subject, subject.make(options), case)
            time = np.linspace(0.0, end, 401)
            for name, contact in solution.contacts.items():
                for start, stop in ((0.0, end), (0.3 * end, 0.7 * end)):
                    inside = time[(time > start) & (time < stop)]
                    largest, sample = contact.largest_force(start, stop), float(np.max(contact.force(inside)))
                    if sample > largest + CLOSE * abs(sample):
                        raise CheckFailed(f"contact '{name}' presses with {sample:.6g}, told at most {largest:.6g}")
            energies = [sum(solution.energy(float(t))) for t in time]
            largest = solution.largest_energy()
            if max(energies) > largest * (1.0 + CLOSE):
                raise CheckFailed(f"the energy is {max(energies):.6g}, told at most {largest:.6g}")
            work = max(abs(solution.work(float(t))) for t in time)
            if work == 0.0 and largest > max(energies) * (1.0 + CLOSE):
                raise CheckFailed(f"the energy is {max(energies):.6g} all the time, told at most {largest:.6g}")

    for_all(subject, rows(), bounded)


@check("solutions")
def check_methods_tend_to_it(subject: Subject) -> None:
    """Displacements of a refined run tend to the exact ones, in a case that the solution covers."""
    from percuss.testing.subject import Subject as Other

    for options in subject.examples:
        engine = subject.make(options)
        errors = []
        for refine in (2, 8):
            case = {**TWO_BARS, "refine": refine, "time": {"end": 0.03, "courant": 0.5}}
            _solved(subject, engine, case)
            alone = Other(subject.component, _alone(subject), subject.draws)
            result = alone.run(case)
            if result.summary["exact"] is None:
                raise CheckFailed(f"it does not judge the run: {result.summary['exact_reason']}")
            errors.append(result.summary["exact"]["displacement_error"])
        if not errors[1] < 0.5 * errors[0]:
            raise CheckFailed(
                f"a mesh four times finer brings the displacement from {errors[0]:.3g} to {errors[1]:.3g}"
            )


def _alone(subject: Subject) -> Any:
    """Return the registry with no other exact solution."""
    import dataclasses

    keep = {
        key: value
        for key, value in subject.registry.components.items()
        if key[0] != "solutions" or key[1] == subject.name
    }
    return dataclasses.replace(subject.registry, components=keep)


@check("measures")
def check_measure(subject: Subject) -> None:
    """A measure gives a finite number of a result, or None, the same one twice, and leaves the result as it was.

    `what` says quantity, norm and averaging: a column without them cannot be read.
    """
    what = getattr(subject.component, "what", "")
    if not isinstance(what, str) or not what.strip():
        raise CheckFailed("`what` is empty: say quantity, norm and averaging")

    def measured(case: dict[str, Any]) -> None:
        result = subject.run(case)
        before = {name: np.array(values, copy=True) for name, values in result.arrays.items()}
        for options in subject.examples:
            one, other = (subject.make(options).of(result) for _ in range(2))
            if one is not None and not np.isfinite(float(one)):
                raise CheckFailed(f"it gives {one!r}, expected a finite number or None")
            if one != other:
                raise CheckFailed(f"it gives {one!r} and then {other!r} of the same result")
        for name, values in before.items():
            if not np.array_equal(values, result.arrays[name], equal_nan=True):
                raise CheckFailed(f"it changes {name} of the result")

    for_all(subject, rows(), measured)
