"""Checks of contact laws: what they bind, what they do at each point, and the facts they declare."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from percuss.errors import InputError, RunError, nearest
from percuss.methods.interfaces import ContactPoints, LinearLaw, Trial
from percuss.methods.kernel_trial import read_only
from percuss.testing.draws import STEEL, for_all, round_off, rows, with_examples
from percuss.testing.strict import StrictSystem
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check, forbidden

COUNTS = (0, 1, 2, 5)
GUARANTEES = ("never pulls", "no penetration", "keeps the free step")


def some_points(count: int) -> ContactPoints:
    """Return `count` unlike contact points, read-only."""

    def column(values: Any, kind: type = float) -> Any:
        array: Any = np.array(values, dtype=kind)
        array.flags.writeable = False
        return array

    k = np.arange(count)
    stiffness, mass = 1000.0 * 1.3**k, 0.02 * 0.9**k
    return ContactPoints(
        names=tuple(f"point{i}" for i in k),
        stiffness=column(stiffness),
        frequency=column(np.sqrt(2.0 * stiffness / mass)),
        mass=column(mass),
        equal_sides=column(np.ones(count), bool),
        delassus=column(2.0 / mass),
        coupling=column(np.ones(count)),
        weight=column(np.ones(count)),
        limits=lambda: column(stiffness),
    )


def one_of(points: ContactPoints, place: int) -> ContactPoints:
    """Return one of several points as a set of its own."""
    columns = ("stiffness", "frequency", "mass", "equal_sides", "delassus", "coupling", "weight")
    return ContactPoints(
        names=points.names[place : place + 1],
        **{name: getattr(points, name)[place : place + 1] for name in columns},
        limits=lambda: points.stiffness_limit[place : place + 1],
    )


def some_trial(points: ContactPoints, dt: float) -> Trial:
    """Return a state in which some points are closed and others open, read-only."""
    k = np.arange(len(points.names))
    depth = 1e-3 * np.where(k % 2, -1.0, 1.0) * (1.0 + k)
    gaps, rates = (depth, depth - 1e-4), (np.cos(k), np.cos(k) - 0.3)
    for one in (*gaps, *rates):
        one.flags.writeable = False
    first, neighbour, coupling, pushed = chained(points, 0.0)
    return Trial(
        gaps[0], gaps[1], rates[0], rates[1], points.delassus, dt, 0.25, dt * dt, dt, first, neighbour, coupling, pushed
    )


def chained(points: ContactPoints, strength: float) -> tuple[Any, Any, Any, Any]:
    """Return the coupling of points in a chain, over the root of the product of their own entries; none for 0."""
    count = len(points.names)
    pairs = [(p, q) for p in range(count) for q in (p - 1, p + 1) if strength and 0 <= q < count]
    first = np.concatenate([[0], np.cumsum(np.bincount([p for p, _ in pairs], minlength=count))]).astype(np.int64)
    neighbour = np.array([q for _, q in pairs], dtype=np.int64)
    coupling = np.array([strength * np.sqrt(points.delassus[p] * points.delassus[q]) for p, q in pairs], dtype=float)
    pushed = np.zeros(count)
    for array in (first, neighbour, coupling, pushed):
        array.flags.writeable = False
    return first, neighbour, coupling, pushed


def alone_in(trial: Trial, place: int, point: ContactPoints) -> Trial:
    """Return what a kernel sees of one point by itself."""
    first, neighbour, coupling, pushed = chained(point, 0.0)
    seen = {name: getattr(trial, name)[place : place + 1] for name in Trial._fields[:5]}
    return trial._replace(
        **seen, first_neighbour=first, neighbour=neighbour, coupling=coupling, pushed_by_others=pushed
    )


def _bound(subject: Subject, options: Mapping[str, Any], points: ContactPoints, dt: float) -> Any:
    try:
        return read_only(subject.make(options).bind(points, dt))
    except ValueError as error:
        if "read-only" in str(error):
            raise CheckFailed(f"bind changes what it was handed: {error}") from None
        raise CheckFailed(f"bind at {len(points.names)} points with options {dict(options)}: {error}") from error


@check("contacts")
def check_any_number_of_contacts(subject: Subject) -> None:
    """A law binds at any number of points, none among them, and treats each point as it would treat it alone.

    Two contacts in a case, or none that uses the law, are as usual as one.
    """
    for options in subject.examples:
        for count in COUNTS:
            points, dt = some_points(count), 1e-3
            bound = _bound(subject, options, points, dt)
            alone = [_bound(subject, options, one_of(points, p), dt) for p in range(count)]
            trial = some_trial(points, dt)
            whole = _said(subject, bound, trial)
            parts = [_said(subject, one, alone_in(trial, p, one_of(points, p))) for p, one in enumerate(alone)]
            for name, values in whole.items():
                if values.shape != (count,):
                    raise CheckFailed(f"{name} has shape {values.shape} at {count} points")
                single = np.array([part[name][0] for part in parts]).reshape(count)
                if not np.allclose(values, single, rtol=1e-13, atol=0.0, equal_nan=True):
                    raise CheckFailed(f"{name} of each point is {values} at {count} points, and {single} alone")


def _said(subject: Subject, bound: Any, trial: Trial) -> dict[str, Any]:
    """Return what a law says of its points: its rows, or the multipliers of a state."""
    count = trial.gap.size
    if isinstance(bound, LinearLaw):
        fields = ("sigma", "gap", "rate", "acceleration")
        values = {name: np.asarray(getattr(bound, name), dtype=float) for name in fields}
        for name, value in values.items():
            if value.shape not in {(), (count,)}:
                raise CheckFailed(f"rows.{name} has shape {value.shape} at {count} points, expected ({count},)")
        return {f"rows.{name}": np.broadcast_to(value, (count,)) for name, value in values.items()}
    kernel = getattr(subject.component, "multipliers", None)
    if kernel is None:
        raise CheckFailed(
            f"bind returned {type(bound).__name__}, which is no LinearLaw, and there is no static method "
            "`multipliers(bound, trial, multiplier)`"
        )
    multiplier = np.full(count, np.nan)
    try:
        getattr(kernel, "py_func", kernel)(bound, trial, multiplier)
    except ValueError as error:
        if "read-only" in str(error):
            raise CheckFailed(f"`multipliers` changes what it was handed: {error}") from None
        raise
    if np.isnan(multiplier).any():
        raise CheckFailed("`multipliers` left a point without a value: set every entry, 0.0 where nothing presses")
    return {"multiplier": multiplier}


@check("contacts")
def check_inputs_untouched(subject: Subject) -> None:
    """Neither `bind` nor `multipliers` changes what it is handed: points, bound arrays and trial stay as they were.

    They are shared with the rest of the run; plain NumPy would refuse, compiled code would not.
    """
    from percuss.solver.compiler.specialise import Specialiser, compile_error

    points, dt = some_points(3), 1e-3
    for options in subject.examples:
        bound = _bound(subject, options, points, dt)
        if isinstance(bound, LinearLaw):
            continue
        trial = some_trial(points, dt)
        before = [np.array(one, copy=True) for one in (*bound, *trial)]
        _said(subject, bound, trial)
        writeable = Trial(*(np.array(one) if isinstance(one, np.ndarray) else one for one in trial))  # type: ignore[arg-type]
        kernel: Any = Specialiser(counting=True).bind(subject.component.multipliers, entry=True)  # type: ignore[attr-defined]
        try:
            kernel(bound, writeable, np.zeros(3))
        except compile_error():  # it runs as plain Python, which was tried above
            writeable = trial
        for old, new in zip(before, (*bound, *writeable), strict=True):
            if not np.array_equal(old, np.asarray(new), equal_nan=True):
                raise CheckFailed(f"`multipliers` changes what it was handed: {new} was {old}")


@check("contacts")
def check_coupling(subject: Subject) -> None:
    """A kernel that declares `uses_coupling` answers otherwise where contacts share an end than where they do not.

    The notes of a run say of every other kernel that it ignores such contacts; of this one they say nothing.
    """
    if not subject.component.uses_coupling:  # type: ignore[attr-defined]
        raise NotApplicable("it does not declare `uses_coupling`")
    points, dt = some_points(5), 1e-3
    for options in subject.examples:
        bound = _bound(subject, options, points, dt)
        if isinstance(bound, LinearLaw):
            raise CheckFailed("it declares `uses_coupling`, and is rows: these are solved together, whatever it says")
        free = some_trial(points, dt)
        deep = np.full(5, -1e-3)
        deep.flags.writeable = False
        free = free._replace(gap=deep, predicted_gap=deep, rate=deep, predicted_rate=deep)
        first, neighbour, coupling, _ = chained(points, -0.3)
        pushed = np.full(5, 0.5)
        coupled = free._replace(first_neighbour=first, neighbour=neighbour, coupling=coupling)
        alone = _said(subject, bound, free)["multiplier"]
        for what, trial in (
            ("other contacts of the law", coupled),
            ("contacts of other laws (`pushed_by_others`)", free._replace(pushed_by_others=pushed)),
        ):
            if np.array_equal(alone, _said(subject, bound, trial)["multiplier"]):
                raise CheckFailed(
                    f"it declares `uses_coupling`, and its multipliers are the same with and without {what} at the "
                    "same ends"
                )


@check("contacts")
def check_as_a_strict_host_has_it(subject: Subject) -> None:
    """Hosted by `StrictSystem`, dense and in plain NumPy, the law gives the forces and motions that the march gives.

    What a law takes from anywhere but the contract is not there.
    """

    def same(one: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        case, options, partner = one
        mine = subject.placed({**case, "time": {**case["time"], "steps": 80}}, options, partner)
        try:
            loaded = subject.load(mine)
            strict = StrictSystem(case | {"time": mine["time"]}, loaded.method.integrator, loaded.method.contact)
            result = subject.run(mine)
        except (InputError, RunError) as why:
            raise NotApplicable(str(why)) from None
        except ValueError as error:
            raise (CheckFailed if "read-only" in str(error) else NotApplicable)(str(error)) from None
        allowed = round_off(subject, mine, result)
        if allowed is None:
            return
        found = strict.march()
        sizes = {"contact_force": 0.0, "gap": 0.0}
        for name in sizes:
            march, host = result.arrays[name], getattr(found, name)
            size = max(float(np.abs(march).max(initial=0.0)), 1e-300)
            if name == "gap":
                size = max(size, float(np.abs(found.displacement).max()))
            if march.size and not np.abs(march - host).max() <= max(allowed, 1e-10) * size:
                raise CheckFailed(f"{name} of the march and of the strict host differ by {_most(march, host):.2g}")

    for_all(subject, with_examples(subject, rows()), same)


def _most(one: Any, other: Any) -> float:
    return float(np.abs(one - other).max() / np.abs(one).max(initial=1e-300))


@check("contacts")
def check_pushes_apart(subject: Subject) -> None:
    """A bar that runs into a wall is pushed back: the impulse is positive and the momentum that it loses.

    The multiplier is compression, positive; a law of the other sign pulls the bodies into each other.
    """
    bar = {"bar": {"length": 1.0, "elements": 20}, "material": STEEL, "area": 1.0, "velocity": 0.5}
    case = {
        "percuss": 1,
        "bodies": {"a": bar},
        "contacts": {"wall": {"body": "a.right", "wall": 1.0}},
        "time": {"end": 0.009, "courant": 0.5},
        "record": {"probes": ["a.right"]},
    }
    for options in subject.examples:
        for partner in subject.registry.names("integrators"):
            try:
                result = subject.run(subject.placed(case, options, partner))
            except (InputError, NotApplicable):
                continue
            except RunError as stopped:
                if forbidden(stopped):
                    continue
                raise CheckFailed(f"with {options} and {partner} the run was {stopped}") from None
            impulse = result.summary["contacts"]["wall"]["impulse"]
            if not impulse > 0.0:
                raise CheckFailed(f"the impulse is {impulse:.3g} while the bar is stopped, with options {options}")
            if not result.summary["momentum"]["final"][0] < result.summary["momentum"]["initial"][0]:
                raise CheckFailed(f"the wall does not slow the bar down, with options {options}")


@check("contacts")
def check_resolved(subject: Subject) -> None:
    """What `resolved` and `chosen` say of the parameters are finite numbers, one a point or one for all, and words.

    They go into the provenance of every result.
    """
    points, dt = some_points(2), 1e-3
    for options in subject.examples:
        law = subject.make(options)
        for name, value in law.resolved(points, dt).items():
            array = np.asarray(value, dtype=float)
            if array.shape not in {(), (2,)} or np.isnan(array).any():
                raise CheckFailed(f"resolved gives {name} = {value!r} at two points")
        for name, words in law.chosen(points, dt).items():
            if not isinstance(words, str) or not words.strip():
                raise CheckFailed(f"chosen gives {name} = {words!r}, expected words")


@check("contacts")
def check_guarantees(subject: Subject) -> None:
    """What a law declares to guarantee (`guarantees`) holds in every drawn run, with every partner and option set.

    Known are "never pulls", "no penetration" (at the end of each step) and "keeps the free step".
    """
    declared = subject.component.guarantees  # type: ignore[attr-defined]
    for fact in declared:
        if fact not in GUARANTEES:
            near = nearest(fact, GUARANTEES)
            raise CheckFailed(f"'{fact}' is no known guarantee{f'; did you mean {near!r}?' if near else ''}")
    if not declared:
        raise NotApplicable("it declares no guarantee")

    def holds(one: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        case, options, partner = one
        try:
            result = subject.run(subject.placed(case, options, partner))
        except (InputError, RunError) as why:
            if isinstance(why, RunError) and "keeps the free step" in declared and case["time"]["courant"] < 1.0:
                raise CheckFailed(f"it says that it keeps the free step: {why}") from None
            raise NotApplicable(str(why)) from None
        force, gap = result.arrays["contact_force"], result.arrays["gap"]
        moved = float(np.abs(result.arrays["displacement"]).max()) + float(np.abs(gap).max(initial=0.0))
        if "never pulls" in declared and force.min(initial=0.0) < 0.0:
            raise CheckFailed(f"it says that it never pulls, and the force is {force.min():.3g}")
        if "no penetration" in declared and gap.min(initial=0.0) < -1e-11 * moved:
            raise CheckFailed(f"it says that there is no penetration, and a gap is {gap.min():.3g}")
        critical = result.summary["certificate"]
        known = critical["dt_critical"] is not None
        lowered = known and critical["dt_critical"] < critical["dt_critical_free"] * (1.0 - 1e-5)
        if "keeps the free step" in declared and lowered:
            raise CheckFailed(f"it says that it keeps the free step, and {critical['why']}")

    for_all(subject, with_examples(subject, rows()), holds)
