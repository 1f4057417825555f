"""Checks of exact solutions and of measures."""

from __future__ import annotations

import dataclasses
from typing import Any, cast

import numpy as np

from percuss.jsonable import Entries
from percuss.march.model import Model
from percuss.methods.plugin_calls import answer
from percuss.testing.draws import TWO_BARS, on_chains
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check

CLOSE = 1e-9


def _solved(subject: Subject, case: Entries) -> tuple[Any, float]:
    """Return the exact solution of a case and the time up to which the check uses it.

    Raises
    ------
    NotApplicable
        If the solution does not cover the case.
    CheckFailed
        If it gives no reason for not covering the case, or for ending early.
    """
    model = Model(subject.load(case))
    problem: Any = model.problem
    engine = subject.make(subject.options)
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


@check("solutions")
@on_chains()
def check_signorini(subject: Subject, case: Entries) -> None:
    """No exact contact pulls or overlaps.

    An exact contact force never pulls, the bodies never overlap, and the contact presses only while they touch.
    Every method is compared with this solution.
    """
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


@check("solutions")
@on_chains()
def check_impulse_and_balances(subject: Subject, case: Entries) -> None:
    """Impulse, momentum and energy agree.

    The contact impulse is the integral of the force. Momentum changes by the external impulse, energy by the work.
    No impact loses energy: bars in one dimension collide elastically.
    """
    solution, end = _solved(subject, case)
    fine = np.linspace(0.0, end, 4001)
    for name, contact in solution.contacts.items():
        middles = 0.5 * (fine[1:] + fine[:-1])
        summed = np.cumsum(np.asarray(contact.force(middles))) * (fine[1] - fine[0])
        impulse = np.asarray(contact.impulse(fine[1:])) - np.asarray(contact.impulse(np.zeros(1)))
        size = float(np.abs(impulse).max(initial=1e-300))
        if np.abs(summed - impulse).max() > 0.02 * size:
            raise CheckFailed(f"the impulse of contact '{name}' is not the integral of its force")
    first, last = (sum(solution.energy(t)) for t in (0.0, end))
    scale = max(first, last, 1e-300)
    if abs(last - first - solution.work(end)) > CLOSE * scale:
        raise CheckFailed(f"energy changes by {last - first:.6g}, the work is {solution.work(end):.6g}")
    change = solution.momentum(end) - solution.momentum(0.0)
    size = max(abs(solution.momentum(0.0)), abs(solution.impulse(end)), abs(change), 1e-300)
    if abs(change - solution.impulse(end)) > CLOSE * size + CLOSE:
        raise CheckFailed(f"momentum changes by {change:.6g}, the impulse is {solution.impulse(end):.6g}")


@check("solutions")
@on_chains()
def check_largest_values(subject: Subject, case: Entries) -> None:
    """The stated largest values are right.

    No sample of a contact force or of the energy exceeds the stated largest value. If no work is done, the energy
    reaches its stated largest value.
    """
    solution, end = _solved(subject, case)
    time = np.linspace(0.0, end, 401)
    for name, contact in solution.contacts.items():
        for start, stop in ((0.0, end), (0.3 * end, 0.7 * end)):
            inside = time[(time > start) & (time < stop)]
            largest, sample = contact.largest_force(start, stop), float(np.max(contact.force(inside)))
            if sample > largest + CLOSE * abs(sample):
                raise CheckFailed(
                    f"contact '{name}' presses with {sample:.6g}; the stated largest force is {largest:.6g}"
                )
    energies = [sum(solution.energy(float(t))) for t in time]
    largest = solution.largest_energy()
    if max(energies) > largest * (1.0 + CLOSE):
        raise CheckFailed(f"the energy is {max(energies):.6g}; the stated largest is {largest:.6g}")
    work = max(abs(solution.work(float(t))) for t in time)
    if work == 0.0 and largest > max(energies) * (1.0 + CLOSE):
        raise CheckFailed(f"the energy is always {max(energies):.6g}; the stated largest is {largest:.6g}")


@check("solutions")
def check_methods_tend_to_it(subject: Subject) -> None:
    """Runs tend to it as the mesh is refined.

    In a case that the solution covers, the displacements of a run tend to the exact ones as the mesh is refined.
    """
    components = subject.registry.components.items()
    sole = {key: cls for key, cls in components if key[0] != "solutions" or key[1] == subject.name}
    registry = dataclasses.replace(subject.registry, components=sole)
    for options in subject.examples:
        subject = dataclasses.replace(subject, registry=registry, options=options)
        errors = []
        for refine in (2, 8):
            case = {**TWO_BARS, "refine": refine, "time": {"end": 0.03, "courant": 0.5}}
            _solved(subject, case)
            result = subject.run(case)
            if result.summary["exact"] is None:
                raise CheckFailed(f"no error against it was computed: {result.summary['exact_reason']}")
            errors.append(cast("float", result.summary["exact"]["displacement_error"]))
        if not errors[1] < 0.5 * errors[0]:
            raise CheckFailed(
                f"a mesh four times finer brings the displacement from {errors[0]:.3g} to {errors[1]:.3g}"
            )


@check("measures")
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
    for _ in range(2):
        answer(subject.make(subject.options), "of", result)
    for name, values in before.items():
        if not np.array_equal(values, result.arrays[name], equal_nan=True):
            raise CheckFailed(f"it changes {name} of the result")
