"""Demands on every method, what it says of itself and of hidden state, and on loads, exact solutions and measures."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import inspect
import itertools
import json
import math
import pickle
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

import numpy as np

from percuss.case.json_schema import schema_of
from percuss.case.options import options_of
from percuss.case.type_words import bounds, branches
from percuss.contact.contact_problem import contact_problem
from percuss.errors import InputError, RefusedPair, RunError, suggestion
from percuss.jsonable import Data, Entries, plain
from percuss.march.model_of_case import model_of
from percuss.methods.blame import described
from percuss.methods.interfaces import FollowingLoad
from percuss.methods.plugin_calls import answer
from percuss.results.result import Result
from percuss.testing import draws
from percuss.testing.draws import TWO_BARS, on_chains
from percuss.testing.subject import PARTNERS, ROUND_OFF, CheckFailed, NotApplicable, Subject, demand, must

# families of methods that take part in the time steps
METHODS = ("integrators", "contacts", "elements", "materials", "masses")
WITH_SOURCE = ("integrators", "contacts", "elements", "masses")
WITH_FORMULA = ("integrators", "contacts", "loads", "elements", "materials", "masses")


@demand(*METHODS)
def check_starts(subject: Subject) -> None:
    """Two bodies collide in a run with it.

    A method fails here, with its first example, if it raises an error, gives nan, or has a kernel that cannot be
    compiled. The other checks would fail for the same reason, so they are not made.
    """
    options = subject.examples[0]
    try:
        result = _use(subject, subject.make(options), options)
    except (RefusedPair, RunError) as refusal:
        raise NotApplicable(str(refusal)) from None
    if result:
        draws.must_compile(result)


# ------------------------------------------------------------------------------------------------- well-formed


@demand()
def check_well_formed(subject: Subject) -> None:
    """Its class says what it is, as reports and tables show it.

    documented: It has a docstring of its own and a summary in one line; `percuss plugins NAME` shows both. formula: The
    docstring has a paragraph that begins with "Formula:", so that the reader sees which equation is solved. references:
    It names its source, with a DOI if there is one; the source of a new method is its author and the year. facts: Each
    expected failure names a check and a reason. frozen: Instances with the same
    options are equal, hashable and picklable, as studies need them. examples: Every set of options in `examples` is
    accepted. options: Every option has a description, `Doc("...")`, and every number a unit, `Unit("force/length")`.
    refusals: A partner is refused with a reason in words, and not every partner is refused. schema: Its options
    have a JSON schema, as editors need it.
    """
    for asked in (*ASKED_OF_ALL, *(asked for asked, families in ASKED_OF_SOME.items() if subject.family in families)):
        try:
            asked(subject)
        except CheckFailed as fault:
            raise CheckFailed(f"{asked.__name__[1:]}: {fault.message}") from None


def _documented(subject: Subject) -> None:
    cls = subject.component
    text = vars(cls).get("__doc__") or ""
    own = text and not text.startswith(f"{cls.__name__}(")  # the one that `dataclass` makes
    must(own, "it has no docstring of its own")
    in_a_line = cls.summary.strip() and "\n" not in cls.summary and len(cls.summary) <= 100
    must(in_a_line, f"its summary is {cls.summary!r}, expected one line of at most 100 characters")


def _formula(subject: Subject) -> None:
    paragraphs = inspect.cleandoc(subject.component.__doc__ or "").split("\n\n")
    shown = any(paragraph.startswith("Formula:") for paragraph in paragraphs)
    must(shown, 'no paragraph of its docstring begins with "Formula:"')


def _references(subject: Subject) -> None:
    references = subject.component.references
    named = references and all(isinstance(one, str) and one.strip() for one in references)
    must(named, "`references` is empty: name the source")


def _facts(subject: Subject) -> None:
    cls = subject.component
    must(cls.examples, "`examples` is empty: ({},) runs the defaults")
    for name, reason in cls.expected_failures.items():
        advice = suggestion(name, subject.declarable, "check")
        must(name in subject.declarable, f"`expected_failures` has '{name}', which is no check. {advice}")
        must(isinstance(reason, str) and reason.strip(), f"`expected_failures` gives no reason for '{name}'")


def _frozen(subject: Subject) -> None:
    cls = subject.component
    for options in subject.examples:
        instance, other = subject.make(options), subject.make(copy.deepcopy(options))
        same = instance == other and hash(instance) == hash(other)
        must(same, f"two instances with the options {options} are not equal")
        same = cls.__module__ == "__main__" or pickle.loads(pickle.dumps(instance)) == instance  # noqa: S301
        must(same, f"an instance with the options {options} is another one after pickling")


def _examples(subject: Subject) -> None:
    for _, instance in subject.made():
        vector = instance.vector() if subject.family == "loads" else None
        right = vector is None or (1 <= len(vector) <= 3 and np.isfinite(vector).all() and np.any(vector))
        must(right, f"`vector` is {vector!r}, expected a direction of one to three numbers")


def _options(subject: Subject) -> None:
    for key, option in options_of(subject.component).items():
        must(option.doc, f'option `{key}` has no description: add Doc("...") to its annotation')
        needs_unit = _takes_number(option.annotation) and not option.unit
        must(not needs_unit, f'option `{key}` has no unit: add Unit("..."), Unit("1") for a pure number')
        if option.unit:
            draws.unit_factor(option.unit)


def _takes_number(annotation: object) -> bool:
    """Return whether an option may be a number, or a list of numbers."""
    kinds = list(branches(annotation))
    items = [get_args(kind)[0] for kind in kinds if get_args(kind)[1:] == (...,)]
    return not {int, float}.isdisjoint(kinds) or any(map(_takes_number, items))


def _refusals(subject: Subject) -> None:
    instance, reasons = subject.make(subject.examples[0]), []
    for name in subject.registry.names(PARTNERS[subject.family]):
        cls = subject.partner_class(name)
        reason = instance.refuses(cls(**cls.examples[0]))
        in_words = reason is None or (isinstance(reason, str) and reason.strip())
        must(in_words, f"it refuses {name} with {reason!r}, expected a reason in words or None")
        reasons.append(reason)
    must(None in reasons, "it refuses every partner")


def _schema(subject: Subject) -> None:
    json.dumps(plain(schema_of(subject.component)), allow_nan=False)


# What is asked of every class, and what of those of some families; a message begins with the name of the function.
ASKED_OF_ALL = (_documented, _facts, _examples, _frozen, _options, _schema)
ASKED_OF_SOME = {_formula: WITH_FORMULA, _references: WITH_SOURCE, _refusals: tuple(PARTNERS)}


# ----------------------------------------------------------------------------------------------------- options


@demand()
def check_options_bounded(subject: Subject) -> None:
    """Options outside their bounds are refused.

    A value within the bounds of an option works, or is refused with a reason. Any other value is refused. If a
    value is accepted and then gives nonsense or a Python error, a bound is missing.
    """
    for key, option in options_of(subject.component).items():
        default = option.default if not option.required else subject.examples[0].get(key)
        for options, value in itertools.product(subject.examples, _values_of(option.annotation, default)):
            case_options = {**options, key: value}
            try:
                instance = subject.make(case_options)
            except CheckFailed as refusal:
                must(refusal.message.strip(": "), f"option `{key}` refuses {value!r} without a reason")
                continue
            try:
                _use(subject, instance, case_options)
            except (InputError, RefusedPair, RunError):
                continue
            except Exception as error:
                failure = f"option `{key}` accepts {value!r}, then it raises {described(error)}"
                raise CheckFailed(f"{failure}; give it a bound, or raise ValueError in words") from error


def _values_of(annotation: Any, default: Any) -> Iterator[Any]:
    """Yield values that an option allows: every choice, the bounds, numbers of either sign and far from the default."""
    size = abs(default) if isinstance(default, int | float) and default and math.isfinite(default) else 1.0
    low, high, at_low, at_high = bounds(annotation)
    for kind in branches(annotation):
        if get_origin(kind) is Literal:
            yield from get_args(kind)
        elif kind is bool:
            yield from (False, True)
        elif kind in {int, float}:
            far = (size + 1, -size) if kind is int else (0.01 * size, 100.0 * size, -size)
            numbers = {**dict.fromkeys((0.0, *far), True), low: at_low, high: at_high}
            for number, allowed in numbers.items():
                if allowed and low <= number <= high and math.isfinite(number):
                    yield kind(number)


def _use(subject: Subject, instance: Any, options: Data) -> Result | None:
    """Use an instance once, as a shape or load outside of a run, else in a run of three steps, and return its result.

    A method whose pair with the default partner is refused runs with the first partner that it may have.
    """
    if subject.family in METHODS:
        case = {**TWO_BARS, "time": {"steps": 3, "courant": 0.5}}
        partners: list[Data] = [{"name": name, **subject.partner_class(name).examples[0]} for name in subject.partners]
        for partner in [None, *partners]:
            with contextlib.suppress(NotApplicable):
                subject.along_line()
                return subject.run(subject.placed(case, options, partner))
    elif subject.family == "shapes":
        instance.mesh(np.zeros(instance.dimension() or 1), 1)
    elif subject.family == "loads":
        instance.amplitude(np.linspace(0.0, 1.0, 5))
    return None


# ------------------------------------------------------------------------------------------------ hidden state


@demand(*METHODS)
@on_chains(share=3)
def check_no_hidden_state(subject: Subject, case: Entries) -> None:
    """The same run gives the same bits.

    A run gives the same bits whatever ran before it. If a run leaves data in a class, a module or a closure, results
    depend on the order of the runs.
    """
    first = subject.run(subject.placed(case))
    subject.run(subject.placed(TWO_BARS))
    try:
        second = subject.run(subject.placed(case), like=first)
    except (RunError, InputError) as stopped:
        raise CheckFailed(f"the run is stopped the second time: {stopped}") from None
    for name in ("contact_force", "displacement"):
        same = np.array_equal(first.arrays[name], second.arrays[name], equal_nan=True)
        must(same, f"the run gives another {name} the second time")


@demand(*METHODS)
@on_chains(share=3)
def check_compiled_and_plain(subject: Subject, case: Entries) -> None:
    """Compiled and plain runs agree.

    A compiled run and a run in plain Python give the same numbers up to round-off. A kernel is wrong in one of the
    two if it relies on the behaviour of the other, such as a cached global, an overflow or an unset entry.
    """
    case = subject.placed({**case, "time": {**case["time"], "steps": 60}})
    draws.must_agree(subject, case, "plain Python", lambda base: subject.run(case, compiled=False, like=base).arrays)


# --------------------------------------------------------------------------- loads, exact solutions and measures

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
        body = draws.bar(5, velocity=start if follows else 0.0, at=[0.0] * dim)
        if dim > 1:
            body["bar"]["direction"] = start
        push = {subject.name: dict(options), **({} if load.everywhere else {"on": "a.left"})}
        draws.must_balance(
            subject.run(draws.chain({"a": body}, loads={"push": push}, time={"steps": 400, "courant": 0.5}))
        )


@demand("solutions")
def check_exact_solution(subject: Subject) -> None:
    """It is the motion to which runs tend.

    In a case that the solution covers, the displacements of a run tend to the exact ones as the mesh is refined. In no
    drawn case a contact pulls, overlaps, or presses where it is open, and no sample of a force is above the stated
    largest one. The energy changes by the work of the loads. A case that is not covered is told in words.
    """
    draws.for_all(subject, draws.bar_chains(), lambda case: _check_contacts(subject, case))
    components = subject.registry.components.items()
    sole = {key: cls for key, cls in components if key[0] != "solutions" or key[1] == subject.name}
    subject = dataclasses.replace(subject, registry=dataclasses.replace(subject.registry, components=sole))
    for options, engine in subject.made():
        cases = [subject.placed(case, options) for case in (TWO_BARS, draws.STRUCK_WALL)]
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

    A measure returns a finite number or None, the same each time for a result.
    `what` states quantity, norm and averaging, because a column without them cannot be interpreted.
    """
    what = getattr(subject.component, "what", "")
    must(isinstance(what, str) and what.strip(), "`what` is empty: say quantity, norm and averaging")
    result = subject.run(case)
    first, second = (answer(subject.make(subject.options), "of", result) for _ in range(2))
    must(first == second, f"it measures {first!r}, and {second!r} the second time")
