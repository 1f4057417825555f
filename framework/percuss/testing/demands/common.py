"""Demands on every method: what it says of itself, its options, and the absence of hidden state."""

from __future__ import annotations

import contextlib
import copy
import inspect
import itertools
import json
import math
import pickle
import sys
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

import numpy as np

from percuss.case.json_schema import schema_of
from percuss.case.options import options_of
from percuss.case.type_words import bounds, branches
from percuss.errors import InputError, RefusedPair, RunError, suggestion
from percuss.jsonable import Data, Entries, plain
from percuss.methods.blame import described
from percuss.results.result import Result
from percuss.testing.draws import TWO_BARS, must_agree, must_compile, on_chains, unit_factor
from percuss.testing.subject import PARTNERS, CheckFailed, NotApplicable, Subject, demand, must

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
        must_compile(result)


# ------------------------------------------------------------------------------------------------- well-formed


@demand()
def check_well_formed(subject: Subject) -> None:
    """Its class says what it is, as reports and tables show it.

    documented: It has a docstring of its own and a summary in one line; `percuss plugins NAME` shows both. formula: The
    docstring has a paragraph that begins with "Formula:", so that the reader sees which equation is solved. references:
    It names its source, with a DOI if there is one; the source of a new method is its author and the year. facts: Class
    facts are known, and each expected failure names a check and a reason. frozen: Instances with the same
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
    must(own or sys.flags.optimize == 2, "it has no docstring of its own")
    in_a_line = cls.summary.strip() and "\n" not in cls.summary and len(cls.summary) <= 100
    must(in_a_line, f"its summary is {cls.summary!r}, expected one line of at most 100 characters")


def _formula(subject: Subject) -> None:
    paragraphs = inspect.cleandoc(subject.component.__doc__ or "").split("\n\n")
    shown = any(paragraph.startswith("Formula:") for paragraph in paragraphs)
    must(shown or sys.flags.optimize == 2, 'no paragraph of its docstring begins with "Formula:"')


def _references(subject: Subject) -> None:
    references = subject.component.references
    named = references and all(isinstance(one, str) and one.strip() for one in references)
    must(named, "`references` is empty: name the source")


def _facts(subject: Subject) -> None:
    cls: Any = subject.component
    if subject.family == "loads":
        acts = cls.acts_as in {"force", "acceleration", "velocity"}
        must(acts, f"`acts_as` is {cls.acts_as!r}, expected force, acceleration or velocity")
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
            unit_factor(option.unit)


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
    must_agree(subject, case, "plain Python", lambda base: subject.run(case, compiled=False, like=base).arrays)
