"""Demands on contact laws: bound data, multipliers at the contact points, and declared facts."""

from __future__ import annotations

import contextlib
import itertools
from dataclasses import replace
from typing import Any

import numpy as np

from percuss.certificate import verdict
from percuss.contact.bound_law import COEFFICIENTS, bind_law
from percuss.contact.law_trials import COUPLED, multipliers_of, plain_kernel, trial_of, trial_states
from percuss.errors import InputError, RunError, suggestion
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import ContactPoints, Floats, LinearLaw
from percuss.testing.draws import STRUCK_WALL, TWO_BARS, largest_difference, on_chains, per_cent
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, demand, sample_points, was_not_started

COUNTS = (0, 1, 2, 5)  # numbers of contact points
# Two bars that strike each other, and a wall that one of them reaches with the same end.
STRUCK_TWICE = {
    **TWO_BARS,
    "contacts": {**TWO_BARS["contacts"], "wall": {"body": "a.right", "wall": 1.0002}},
    "time": {**TWO_BARS["time"], "on_unstable": "warn"},
}
ALIKE = 1e-6  # largest difference of two forces, relative to their peak
WIDE = 4.0
NEARLY_EQUAL = 1e-6  # largest change of a short run by the order of its contacts, relative to its peaks
REDUCTION = 0.6  # largest allowed ratio of the energies not accounted for with a time step and with one four times it
NOT_BACK = "the wall does not push the bar back (a multiplier is positive in compression)"
STEP = 1e-3
SHORT_STEP = 1e-9  # a dashpot weaker than it is taken for a law of another time within the step
APPROACHES = (1.0, 0.1, -0.1, -1.0)  # gap rates, from a fast opening to a fast closing
ADDS_ENERGY = "a dashpot of this sign adds energy"
GUARANTEES = ("never pulls", "no penetration", "keeps the free step")


def _bound(subject: Subject, options: Data, points: ContactPoints, dt: float = STEP) -> Any:
    """Return the linear law of a law, checked, or the data of its kernel with read-only arrays."""
    bound_law = bind_law(subject.make(options), tuple(range(len(points.names))), points, dt)
    return bound_law.linear if bound_law.linear is not None else bound_law.kernel_data


@demand("contacts")
def check_any_number_of_contacts(subject: Subject) -> None:
    """Many points are treated as each alone.

    A law binds at any number of contact points, also at none, and treats each point as it would treat it alone. Its
    kernel sets every multiplier in every kind of state, open, closed and touching, in approach and parting, and writes
    to nothing else. `resolved` gives numbers, one for each point or one for all, and `chosen` gives texts.
    """
    for options, count in itertools.product(subject.examples, COUNTS):
        points = sample_points(count)
        bound, law = _bound(subject, options, points), subject.make(options)
        if count:
            _check_resolved(law, points)
        parts = [sample_points(count, slice(p, p + 1)) for p in range(count)]
        alone = [_bound(subject, options, part) for part in parts]
        if isinstance(bound, LinearLaw):
            for name in COEFFICIENTS:
                _compare(name, count, getattr(bound, name), [getattr(each, name) for each in alone])
            continue
        kernel, before = plain_kernel(law), np.zeros((count, law.state))
        for state in trial_states(count, STEP):
            trial = trial_of(points, STEP, state, law, before, strength=0.0)
            multiplier, single = multipliers_of(law, kernel, bound, trial), []
            for p in range(count):
                of_point = [values[p : p + 1] for values in state]
                own = trial_of(parts[p], STEP, of_point, law, before[p : p + 1], strength=0.0)
                single.append(multipliers_of(law, kernel, alone[p], own))
            _compare("multiplier", count, multiplier, single)
            before = trial.after


def _compare(name: str, count: int, together: Any, alone: list[Any]) -> None:
    """Raise `CheckFailed` unless the values of a law at some points are those at each point alone."""
    single = np.array([values[0] for values in alone]).reshape(count)
    if not np.allclose(together, single, rtol=1e-13, atol=0.0, equal_nan=True):
        raise CheckFailed(f"{name} of each point is {together} at {count} points, and {single} alone")


def _check_resolved(law: Any, points: ContactPoints) -> None:
    """Raise `CheckFailed` unless `resolved` gives numbers and `chosen` texts."""
    for name, value in law.resolved(points, STEP).items():
        array = np.asarray(value, dtype=float)
        if array.shape not in {(), (len(points.names),)} or np.isnan(array).any():
            raise CheckFailed(f"`resolved` gives {name} = {value!r} at {len(points.names)} points")
    for name, text in law.chosen(points, STEP).items():
        if not isinstance(text, str) or not text.strip():
            raise CheckFailed(f"`chosen` gives {name} = {text!r}, expected a text")


@demand("contacts")
def check_coupling(subject: Subject) -> None:
    """`uses_coupling` is true, and the order of contacts at one end does not matter.

    A kernel that declares `uses_coupling` gives other multipliers if contacts share an end than if they do not. It
    solves the contacts at one end together: with too few sweeps the result depends on their order.
    """
    if not subject.component.uses_coupling:  # type: ignore[attr-defined]
        raise NotApplicable("it does not declare `uses_coupling`")
    points, deep = sample_points(5), [np.full(5, -1e-3)] * 4
    for options in subject.examples:
        bound, law = _bound(subject, options, points), subject.make(options)
        if isinstance(bound, LinearLaw):
            raise CheckFailed("it declares `uses_coupling`, but it is linear: such laws are solved together anyway")
        coupled, uncoupled = (_forces(law, bound, points, deep, strength) for strength in (COUPLED, 0.0))
        if np.array_equal(coupled, uncoupled):
            raise CheckFailed("it declares `uses_coupling`, but contacts at its ends change no multiplier")
        for partner in subject.partners:
            case = subject.placed(STRUCK_TWICE, options, partner)
            swapped = {**case, "contacts": dict(reversed(case["contacts"].items()))}
            with contextlib.suppress(InputError, RunError, NotApplicable):
                arrays, other = (subject.run(each).arrays for each in (case, swapped))
                mirrored = {name: other[name][:, ::-1] for name in ("contact_force", "gap")}
                difference = largest_difference(arrays, {**mirrored, "displacement": other["displacement"]})
                if difference > NEARLY_EQUAL:
                    raise CheckFailed(
                        f"with {partner} the order of contacts at one end changes the result by "
                        f"{per_cent(difference)} of its peak: sweep over the contacts until nothing changes"
                    )


@demand("contacts")
def check_stored_and_dissipated(subject: Subject) -> None:
    """Stored and dissipated energy add up.

    The energies that a law says its contact stores and has dissipated add up to the work that the contact takes
    from the bodies. The difference vanishes with the time step, and the dissipated energy never decreases.
    """
    law: Any = subject.component
    if law.stored_in is None or law.dissipated_in is None:
        raise NotApplicable("it does not declare both `stored_in` and `dissipated_in`")
    for options in subject.examples:
        errors = []
        for courant in (0.4, 0.1):
            case = {**STRUCK_WALL, "time": {"end": 0.04, "courant": courant}}
            try:
                result = subject.run(subject.placed(case, options))
            except InputError as refusal:
                raise NotApplicable(str(refusal)) from None
            arrays, largest = result.arrays, result.summary["energy"]["max"]
            dissipated = arrays["contact_dissipation"]
            if np.diff(dissipated).min(initial=0.0) < -1e-12 * largest:
                raise CheckFailed("the energy that it has dissipated decreases")
            missing = arrays["contact_work"] + arrays["contact_energy"] + dissipated
            errors.append(float(np.abs(missing[-1])) / largest)
        if not errors[1] <= max(REDUCTION * errors[0], 1e-4):
            raise CheckFailed(
                f"{per_cent(errors[0])} of the largest energy is missing at a Courant number of 0.4, and "
                f"{per_cent(errors[1])} at 0.1: neither stored, dissipated nor given back"
            )


@demand("contacts")
def check_pushes_apart(subject: Subject) -> None:
    """A wall pushes a bar back.

    A bar that strikes a wall is pushed back: the contact impulse is positive and the bar loses momentum.
    Multipliers are positive in compression, so a law of the opposite sign pulls the bodies into each other. No force
    in closed contact falls with the speed of approach: a dashpot of the opposite sign adds energy.
    """
    case = {**STRUCK_WALL, "time": {"end": 0.009, "courant": 0.5}}
    for options in subject.examples:
        _check_sign_of_rate(subject, options)
    for options in subject.examples:
        for partner in subject.partners:
            try:
                result = subject.run(subject.placed(case, options, partner))
            except (InputError, NotApplicable):
                continue
            except RunError as stopped:
                if was_not_started(stopped):
                    continue
                raise CheckFailed(f"{NOT_BACK}: the run was {stopped}") from None
            impulse = result.summary["contacts"]["wall"]["impulse"]
            if not impulse > 0.0:
                raise CheckFailed(f"{NOT_BACK}: its impulse is {impulse:.3g}")
            if not result.summary["momentum"]["final"][0] < result.summary["momentum"]["initial"][0]:
                raise CheckFailed(f"{NOT_BACK}: the bar does not slow down")


def _check_sign_of_rate(subject: Subject, options: Data) -> None:
    """Raise `CheckFailed` if a force in closed contact is the lower the faster its sides approach each other."""
    points, dt = sample_points(2), SHORT_STEP
    bound, law = _bound(subject, options, points, dt), subject.make(options)
    if isinstance(bound, LinearLaw):
        # The gap at the end of a step has the rate in it.
        if (weight := float(np.min(bound.rate + dt * np.asarray(bound.gap) * (bound.at == "end")))) < 0.0:
            raise CheckFailed(f"the weight of the gap rate is {weight:.3g}: {ADDS_ENERGY}")
        return
    found = []
    for rate in np.repeat(APPROACHES, 2).reshape(-1, 2):
        deep = np.full(2, -1e-3)
        trial = trial_of(points, dt, [deep, deep + dt * rate, rate, rate], subject.component)
        found.append(multipliers_of(law, plain_kernel(law), bound, trial)[0])
    if (np.diff(found) < -ALIKE * np.abs(found).max()).any():
        raise CheckFailed(f"of one gap at the rates {APPROACHES} the multipliers are {np.array(found)}: {ADDS_ENERGY}")


@demand("contacts")
def check_areas(subject: Subject) -> None:
    """Points press by their areas.

    The forces of points are in proportion to `weight`, the area of a point, as `stiffness` and `mass` are. On bars the
    area is 1, so that a law that forgets it is right there, and on surfaces of more points too stiff.
    """
    points = sample_points(3)
    wide = replace(
        points,
        weight=WIDE * points.weight,
        stiffness=WIDE * points.stiffness,
        mass=WIDE * points.mass,
        delassus=points.delassus / WIDE,
        limits=lambda: WIDE * points.stiffness,
    )
    for options in subject.examples:
        law, (small, large) = subject.make(options), (_bound(subject, options, each) for each in (points, wide))
        pairs = (
            [(small.sigma, WIDE * large.sigma)]
            if isinstance(small, LinearLaw)
            else [
                (_forces(law, small, points, state), _forces(law, large, wide, state) / WIDE)
                for state in trial_states(3, STEP)
            ]
        )
        for one, other in pairs:
            if np.abs(one - other).max() > ALIKE * np.abs(one).max():
                raise CheckFailed(f"points of {WIDE:g} times the area press otherwise: `weight` of a point is its area")


def _forces(law: Any, bound: object, points: ContactPoints, state: list[Floats], strength: float = 0.0) -> Floats:
    """Return the multipliers of the kernel of a law at contact points, coupled with a strength, in a state."""
    return multipliers_of(law, plain_kernel(law), bound, trial_of(points, STEP, state, law, strength=strength))


@demand("contacts")
@on_chains()
def check_guarantees(subject: Subject, case: Entries) -> None:
    """Its guarantees are kept in every run.

    The declared `guarantees` of a law hold in every drawn run, with every partner and option set. The possible
    guarantees are "never pulls", "no penetration" (at the end of each step, and at each of its stages) and "keeps
    the free step", the latter under schemes with one step for all bodies.
    """
    declared = subject.component.guarantees  # type: ignore[attr-defined]
    for fact in declared:
        if fact not in GUARANTEES:
            raise CheckFailed(f"'{fact}' is no known guarantee. {suggestion(fact, GUARANTEES, 'guarantee')}")
    if not declared:
        raise NotApplicable("it declares no guarantee")
    full_case, keeps = subject.placed(case), "keeps the free step" in declared
    try:
        result = subject.run(full_case, certify=verdict.certificate if keeps else verdict.verdict_alone)
    except RunError as refusal:
        if keeps:
            raise CheckFailed(f"it declares 'keeps the free step', but the run was {refusal}") from None
        raise
    force, gap = result.arrays["contact_force"], result.arrays["gap"]
    travel = float(np.abs(result.arrays["displacement"]).max()) + float(np.abs(gap).max(initial=0.0))
    if "never pulls" in declared and force.min(initial=0.0) < 0.0:
        raise CheckFailed(f"it declares 'never pulls', but a force is {force.min():.3g}")
    deepest = max(contact["penetration"]["largest"] for contact in result.summary["contacts"].values())
    deepest = max(deepest, -float(gap.min(initial=0.0)))
    if "no penetration" in declared and deepest > 1e-11 * travel:
        raise CheckFailed(f"it declares 'no penetration', but bodies overlap by {deepest:.3g}")
    certificate = result.summary["certificate"]
    critical, free = certificate["dt_critical"], certificate["dt_critical_free"]
    lowered = critical is not None and free is not None and critical < free * (1.0 - 1e-5)
    if keeps and lowered:
        raise CheckFailed(f"it declares 'keeps the free step', but {certificate['why']}")
