"""Checks of contact laws: bound data, multipliers at the contact points, and declared facts."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from percuss.case.options import options_of
from percuss.case.type_words import branches
from percuss.certificate import verdict
from percuss.contact.bound_law import COEFFICIENTS, bind_law
from percuss.contact.law_trials import COUPLED, multipliers_of, plain_kernel, trial_of
from percuss.errors import InputError, RefusedPair, RunError, suggestion
from percuss.jsonable import Data, Entries
from percuss.march.model import Model
from percuss.methods.interfaces import ContactPoints, LeapFrog, LinearLaw, Trial
from percuss.results.result import Result
from percuss.testing.draws import (
    SAFETY_FACTOR,
    TWO_BARS,
    Arrays,
    bar,
    chain,
    largest_difference,
    must_agree,
    on_chains,
    per_cent,
)
from percuss.testing.strict import StrictSystem, locked
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, as_of, check, was_not_started

COUNTS = (0, 1, 2, 5)  # numbers of contact points
# A bar that strikes a wall once and leaves it.
STRUCK_WALL = chain({"a": bar(20, velocity=0.5)}, wall=1.0)
# Two bars that strike each other, and a wall that one of them reaches with the same end.
STRUCK_TWICE = {
    **TWO_BARS,
    "contacts": {**TWO_BARS["contacts"], "wall": {"body": "a.right", "wall": 1.0002}},
    "time": {**TWO_BARS["time"], "on_unstable": "warn"},
}
BLOCK = {
    "material": {"young": 100.0, "density": 0.01, "poisson": 0.0},
    "plane": "strain",
    "velocity": [0.5, 0.0],
}
# Two blocks that strike a wall and then another, and move as bars.
TWICE_AS_FINE: Entries = {
    "percuss": 1,
    "bodies": {
        name: {"block": {"size": [1.0, 0.4], "elements": [10, cells]}, "at": [0.0, y], **BLOCK}
        for name, cells, y in (("coarse", 2, 0.0), ("fine", 4, 1.0))
    },
    "contacts": {
        f"{name}_{side}": {"body": f"{name}.{side}", "wall": {"point": [x, 0.0], "normal": [1.0 - 2.0 * x, 0.0]}}
        for name, (side, x) in itertools.product(("coarse", "fine"), (("left", 0.0), ("right", 1.0)))
    },
}
COURANTS = (0.4, 0.1, 0.025)  # a law that is too stiff for a step may run at a smaller one
ALIKE = 1e-6  # largest difference of two forces, relative to their peak
AREA = "`weight` of a point is its area"
NUDGE = 1e-9  # relative change of an option
NEARLY_EQUAL = 1e-6  # largest change of a short run by it, relative to its peaks, unless all runs change more
REDUCTION = 0.6  # largest allowed ratio of the energies not accounted for with a time step and with one four times it
NOT_BACK = "the wall does not push the bar back (a multiplier is positive in compression)"
SHORT_STEP = 1e-5
APPROACHES = (1.0, 0.1, -0.1, -1.0)  # gap rates, from a fast opening to a fast closing
ADDS_ENERGY = "a dashpot of this sign adds energy"
GUARANTEES = ("never pulls", "no penetration", "keeps the free step")


def sample_points(count: int, part: slice = slice(None)) -> ContactPoints:
    """Return `count` unlike contact points with read-only arrays, or a part of these."""
    k = np.arange(count)[part]
    stiffness, mass, ones = locked(1000.0 * 1.3**k), locked(0.02 * 0.9**k), locked(np.ones(k.size))
    return ContactPoints(
        names=tuple(f"point{i}" for i in k),
        stiffness=stiffness,
        frequency=locked(np.sqrt(2.0 * stiffness / mass)),
        mass=mass,
        equal_sides=locked(ones, bool),
        delassus=locked(2.0 / mass),
        coupling=ones,
        weight=ones,
        limits=lambda: stiffness,
    )


def sample_trial(points: ContactPoints, dt: float, law: object) -> Trial:
    """Return a trial of a class of laws with some contact points closed and others open; state variables are zero."""
    k = np.arange(len(points.names))
    depth = 1e-3 * np.where(k % 2, -1.0, 1.0) * (1.0 + k)
    state = (depth, depth - 1e-4, np.cos(k), np.cos(k) - 0.3)
    return trial_of(points, dt, state, law, strength=0.0)._replace(time=0.25)


def trial_of_point(trial: Trial, index: int, point: ContactPoints, law: object) -> Trial:
    """Return the part of a state that belongs to one contact point, as a kernel with this point alone receives it."""
    state = [array[index : index + 1] for array in trial[:4]]
    return trial_of(point, trial.dt, state, law, trial.before[index : index + 1])._replace(time=trial.time)


def _bound(subject: Subject, options: Data, points: ContactPoints, dt: float) -> Any:
    """Return the linear law of a law, checked, or the data of its kernel with read-only arrays."""
    bound_law = bind_law(subject.make(options), tuple(range(len(points.names))), points, dt)
    return bound_law.linear if bound_law.linear is not None else bound_law.kernel_data


@check("contacts")
def check_any_number_of_contacts(subject: Subject) -> None:
    """Many points are treated as each alone.

    A law binds at any number of contact points, also at none, and treats each point as it would treat it alone. A
    case may have several contacts that use the law, or none.
    """
    for options in subject.examples:
        for count in COUNTS:
            points, dt = sample_points(count), 1e-3
            bound = _bound(subject, options, points, dt)
            singles = [sample_points(count, slice(p, p + 1)) for p in range(count)]
            trial = sample_trial(points, dt, subject.component)
            together = _law_values(subject, bound, trial)
            trials = [trial_of_point(trial, p, point, subject.component) for p, point in enumerate(singles)]
            bounds = [_bound(subject, options, point, dt) for point in singles]
            alone = [_law_values(subject, *each) for each in zip(bounds, trials, strict=True)]
            for name, values in together.items():
                single = np.array([values_alone[name][0] for values_alone in alone]).reshape(count)
                if not np.allclose(values, single, rtol=1e-13, atol=0.0, equal_nan=True):
                    raise CheckFailed(f"{name} of each point is {values} at {count} points, and {single} alone")


def _law_values(subject: Subject, bound: object, trial: Trial) -> Entries:
    """Return the values of a law at its contact points: the fields of a linear law, or the multipliers in a state."""
    if isinstance(bound, LinearLaw):
        return {f"LinearLaw.{name}": getattr(bound, name) for name in COEFFICIENTS}
    law = subject.make(subject.examples[0])
    multiplier = multipliers_of(law, plain_kernel(law), bound, trial)
    return {"multiplier": multiplier}


@check("contacts")
def check_inputs_untouched(subject: Subject) -> None:
    """It does not change its input.

    Points, bound arrays and trial keep their values in `bind` and `multipliers`. The rest of the run shares these
    arrays. Plain NumPy refuses to write to them, and so does the compiler, in every branch of a kernel.
    """
    points, dt = sample_points(3), 1e-3
    for options in subject.examples:
        _law_values(subject, _bound(subject, options, points, dt), sample_trial(points, dt, subject.component))
    with contextlib.suppress(RunError, RefusedPair):
        subject.run(subject.placed(TWO_BARS, subject.examples[0]))


@check("contacts")
def check_coupling(subject: Subject) -> None:
    """`uses_coupling` is true.

    A kernel that declares `uses_coupling` gives other multipliers if contacts share an end than if they do not. The
    notes of a run warn that other kernels ignore such contacts, and trust this declaration.
    """
    if not subject.component.uses_coupling:  # type: ignore[attr-defined]
        raise NotApplicable("it does not declare `uses_coupling`")
    points, dt = sample_points(5), 1e-3
    for options in subject.examples:
        bound = _bound(subject, options, points, dt)
        if isinstance(bound, LinearLaw):
            raise CheckFailed("it declares `uses_coupling`, but it is linear: such laws are solved together anyway")
        deep = [np.full(5, -1e-3)] * 4
        coupled, uncoupled = (
            trial_of(points, dt, deep, subject.component, strength=strength)._replace(time=0.25)
            for strength in (COUPLED, 0.0)
        )
        alone, together = (_law_values(subject, bound, trial)["multiplier"] for trial in (uncoupled, coupled))
        if np.array_equal(alone, together):
            raise CheckFailed("it declares `uses_coupling`, but contacts at its ends change no multiplier")


@check("contacts")
def check_contacts_at_one_end(subject: Subject) -> None:
    """The order of contacts does not matter.

    Contacts of nearly equal options at one end give nearly the results of equal ones, in any order. A kernel that
    uses the coupling solves those of equal options together: too few sweeps make their order matter.
    """
    unlike = not subject.component.uses_coupling  # type: ignore[attr-defined]
    compared = False
    for options in subject.examples:
        for partner in subject.partners:
            case = _case_at_one_end(subject, partner, options, options)
            try:
                pressing = subject.run(case).arrays["contact_force"].any(axis=0)
            except (InputError, RunError, NotApplicable):
                continue
            if pressing.all():
                compared = True
                for pair in ((options, options), *(_nudged(subject, case, options) if unlike else ())):
                    _compare_at_one_end(subject, partner, *pair)
                break
    if not compared:
        raise NotApplicable("with no integrator two contacts at one end both press")


def _case_at_one_end(subject: Subject, partner: str, *options: Data) -> Entries:
    """Return a case with two contacts of one end, with options of the law for each."""
    methods = ({"method": {"name": subject.name, **own}} for own in options)
    contacts = {name: contact | next(methods) for name, contact in STRUCK_TWICE["contacts"].items()}
    return subject.placed({**STRUCK_TWICE, "contacts": contacts}, options[0], partner)


def _nudged(subject: Subject, case: Data, options: Data) -> Iterator[tuple[Entries, Entries]]:
    """Yield pairs of options that differ by little in one number, for each number that the law uses in a case."""
    used = Model(subject.load(case)).parameters()["ab"]
    for key, option in options_of(subject.component).items():
        value = options.get(key, used.get(key, option.default))
        if float in branches(option.annotation) and isinstance(value, int | float):
            for nudged in (value * (1.0 + NUDGE) or NUDGE, value * (1.0 - NUDGE)):
                yield {**options, key: value}, {**options, key: nudged}


def _compare_at_one_end(subject: Subject, partner: str, first: Data, second: Data) -> None:
    """Raise `CheckFailed` if contacts of two option sets, in reverse order, press otherwise than those of the first."""
    try:
        equal = subject.run(_case_at_one_end(subject, partner, first, first))
        moved = subject.run(_case_at_one_end(subject, partner, second, second), certify=as_of(equal))
    except (InputError, RunError):  # of options that exclude each other, or beyond a bound
        return
    case = _case_at_one_end(subject, partner, first, second)
    unlike = subject.run({**case, "contacts": dict(reversed(case["contacts"].items()))}, certify=as_of(equal))
    unlike.arrays.update({name: unlike.arrays[name][:, ::-1] for name in ("contact_force", "gap")})
    allowed = max(NEARLY_EQUAL, SAFETY_FACTOR * largest_difference(equal.arrays, moved.arrays))
    difference = largest_difference(equal.arrays, unlike.arrays)
    if not difference <= allowed:
        raise CheckFailed(
            f"with {partner} and contacts of the options {first} and {second} at one end, the order of the contacts "
            f"changes the result by {per_cent(difference)} of its peak; {per_cent(allowed)} is allowed"
        )


@check("contacts")
def check_stored_and_dissipated(subject: Subject) -> None:
    """Stored and dissipated energy add up.

    The energies that a law says its contact stores and has dissipated add up to the work that the contact takes
    from the bodies. The difference vanishes with the time step, and the dissipated energy never decreases.
    """
    law: Any = subject.component
    if law.stored_in is None or law.dissipated_in is None:
        raise NotApplicable("it does not declare both `stored_in` and `dissipated_in`")
    integrator = next(name for name in subject.partners if isinstance(subject.scheme(name), LeapFrog))
    for options in subject.examples:
        errors = []
        for courant in (0.4, 0.1):
            case = {**STRUCK_WALL, "time": {"end": 0.04, "courant": courant}}
            try:
                result = subject.run(subject.placed(case, options, integrator))
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


@check("contacts")
@on_chains()
def check_as_a_strict_host_has_it(subject: Subject, case: Entries) -> None:
    """The law uses the contract alone.

    `StrictSystem`, dense and in plain NumPy, gives the same contact forces and gaps as the time loop. It provides
    the contract and nothing else, so a law that uses anything else fails.
    """
    case = subject.placed({**case, "time": {**case["time"], "steps": 80}})
    try:
        loaded = subject.load(case)
        strict = StrictSystem(case, loaded.method.integrator, loaded.method.contact)

        def histories(_: Result) -> Arrays:
            marched = strict.march()
            return {"contact_force": marched.contact_force, "gap": marched.gap}

        must_agree(subject, case, {"a march by the strict host": histories})
    except ValueError as error:
        raise (CheckFailed if "read-only" in str(error) else NotApplicable)(str(error)) from None


@check("contacts")
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


@check("contacts")
def check_areas(subject: Subject) -> None:
    """Points press by their areas.

    Two equal blocks between walls have equal contact forces, though the faces of one are twice as fine. The forces of
    points are in proportion to `weight`, the area of the point, as `stiffness` and `mass` are. On bars the area is 1,
    so that a law that forgets it is right there, and on surfaces of more points too stiff.
    """
    ran, why = False, "no integrator runs with it"
    for options in subject.examples:
        for courant, partner in itertools.product(COURANTS, subject.partners):
            try:
                case = {**TWICE_AS_FINE, "time": {"end": 0.05, "courant": courant}}
                force = subject.run(subject.placed(case, options, partner)).arrays["contact_force"]
            except (InputError, NotApplicable, RunError) as refusal:
                why = str(refusal).partition("\n")[0]
                continue
            ran = True
            coarse, fine = np.split(force, 2, axis=1)
            peak, difference = np.abs(force).max(), np.abs(coarse - fine).max()
            if difference > ALIKE * peak:
                share = per_cent(float(difference / peak))
                raise CheckFailed(f"a surface twice as fine presses otherwise, by {share} of the peak: {AREA}")
            break
    if not ran:
        raise NotApplicable(why)


@check("contacts")
def check_resolved(subject: Subject) -> None:
    """`resolved` gives numbers.

    `resolved` gives numbers, never nan, one for each contact point or one for all, and `chosen` gives texts. Every
    result stores both.
    """
    points, dt = sample_points(2), 1e-3
    for _, law in subject.made():
        for name, value in law.resolved(points, dt).items():
            array = np.asarray(value, dtype=float)
            if array.shape not in {(), (2,)} or np.isnan(array).any():
                raise CheckFailed(f"`resolved` gives {name} = {value!r} at two points")
        for name, text in law.chosen(points, dt).items():
            if not isinstance(text, str) or not text.strip():
                raise CheckFailed(f"`chosen` gives {name} = {text!r}, expected a text")


@check("contacts")
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
        if keeps and case["time"]["courant"] < 1.0 and not getattr(subject.scheme_of(full_case), "own_steps", False):
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
