"""Checks of every component: what it says of itself, its options, and that it keeps nothing to itself."""

from __future__ import annotations

import contextlib
import copy
import inspect
import json
import math
import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np

from percuss.errors import InputError, RefusedPair, RunError
from percuss.testing.draws import (
    TWO_BARS,
    apart,
    for_all,
    is_frozen_dataclass,
    option_values,
    round_off,
    rows,
    with_examples,
)
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check, did_you_mean, known_names

METHODS = ("integrators", "contacts", "elements", "materials", "masses")  # what marches
WITH_SOURCE = ("integrators", "contacts", "elements", "masses")
WITH_FORMULA = ("integrators", "contacts", "loads", "elements", "materials", "masses")


@check()
def check_documented(subject: Subject) -> None:
    """A component has a docstring of its own and a summary of one line.

    They are all that a reader of `percuss plugins NAME` and of a report learns of it.
    """
    cls = subject.component
    text = inspect.cleandoc(vars(cls).get("__doc__") or "")
    if not text or text.startswith(f"{cls.__name__}("):  # what dataclasses invent
        raise CheckFailed("it has no docstring of its own")
    if not cls.summary.strip() or "\n" in cls.summary or len(cls.summary) > 100:
        raise CheckFailed(f"its summary is {cls.summary!r}, expected one line of at most 100 characters")


@check(*WITH_FORMULA)
def check_formula(subject: Subject) -> None:
    """The docstring of a method has a paragraph that begins with "Formula:".

    `percuss check` and `percuss plugins NAME` show it: the reader sees which equation is solved.
    """
    paragraphs = inspect.cleandoc(subject.component.__doc__ or "").split("\n\n")
    if not any(one.startswith("Formula:") for one in paragraphs):
        raise CheckFailed('no paragraph of its docstring begins with "Formula:"')


@check(*WITH_SOURCE)
def check_references(subject: Subject) -> None:
    """A method names where it is from: `references`, with a DOI where there is one.

    A result cannot be published whose methods have no source; of a new method it is the author and the year.
    """
    if not subject.component.references or not all(
        isinstance(one, str) and one.strip() for one in subject.component.references
    ):
        raise CheckFailed("`references` is empty: name the source")


@check()
def check_facts(subject: Subject) -> None:
    """Class facts are of the kind that the contract says, and an expected failure names a check and a reason.

    A fact of the wrong type is read wrongly by every table, and a misspelt expected failure excuses nothing.
    """
    cls = subject.component
    for fact in ("references", "examples"):
        if not isinstance(getattr(cls, fact), tuple):
            raise CheckFailed(f"`{fact}` is {getattr(cls, fact)!r}, expected a tuple")
    if not cls.examples:
        raise CheckFailed("`examples` is empty: ({},) runs the defaults")
    if not isinstance(cls.expected_failures, Mapping):
        raise CheckFailed(f"`expected_failures` is {cls.expected_failures!r}, expected a mapping of check to reason")
    known = known_names(subject)
    for name, reason in cls.expected_failures.items():
        if name not in known:
            raise CheckFailed(f"`expected_failures` names '{name}', which is no check{did_you_mean(name, known)}")
        if not (isinstance(reason, str) and reason.strip()):
            raise CheckFailed(f"`expected_failures` gives no reason for '{name}'")


@check()
def check_frozen(subject: Subject) -> None:
    """An instance is a value: a frozen dataclass, equal to another one with its options, hashable, and picklable.

    Studies send methods to other processes and tell runs apart by their options.
    """
    if not is_frozen_dataclass(subject.component):
        raise CheckFailed("it is no frozen dataclass: put @dataclass(frozen=True) above the class")
    if "<locals>" in subject.component.__qualname__:
        raise CheckFailed("it is defined inside a function: define it at the top of its module, where pickles find it")
    for options in subject.examples:
        one, other = subject.make(options), subject.make(copy.deepcopy(options))
        if one != other or hash(one) != hash(other):
            raise CheckFailed(f"two instances with the options {options} are not equal")
        if subject.component.__module__ != "__main__" and pickle.loads(pickle.dumps(one)) != one:  # noqa: S301
            raise CheckFailed(f"an instance with the options {options} comes back from pickle as another one")


@check()
def check_examples(subject: Subject) -> None:
    """Every set of options in `examples` is accepted as a case would have it, and tuples stand where lists do.

    Examples are what the kit, the documentation and the reader try first.
    """
    for options in subject.examples:
        subject.make(options)


@check()
def check_options_documented(subject: Subject) -> None:
    """Every option says what it is, `Doc("...")`, and every number its unit, `Unit("force/length")`.

    The unit is read by the schema, by messages and by the check that nothing changes with the units.
    """
    from percuss.case.options import options_of, schema_of
    from percuss.testing.draws import factor

    schema = schema_of(subject.component)["properties"]
    for key, option in options_of(subject.component).items():
        if not option.doc:
            raise CheckFailed(f'option `{key}` does not say what it is: add Doc("...") to its annotation')
        if _has_number(schema[key]) and not option.unit:
            raise CheckFailed(f'option `{key}` has no unit: add Unit("..."), Unit("1") for a pure number')
        if option.unit:
            factor(option.unit)


@check()
def check_options_bounded(subject: Subject) -> None:
    """Whatever its bounds allow, an option either works or is refused in words; whatever they do not is refused.

    A value that is accepted and then gives nonsense, or an error of Python's, is a bound that was forgotten.
    """
    from hypothesis import strategies as st
    from hypothesis.errors import Unsatisfiable

    from percuss.case.options import options_of, validate

    for key, option in options_of(subject.component).items():
        for wrong in (math.nan, {"no": "mapping"}):
            made, _ = validate(subject.component, {**subject.examples[0], key: wrong}, kind="it")
            if made is not None:
                raise CheckFailed(f"option `{key}` accepts {wrong!r}")

        def with_value(drawn: tuple[dict[str, Any], Any], key: str = key) -> None:
            options, value = drawn
            made, faults = validate(subject.component, {**options, key: value}, kind="it")
            if made is None:
                if not all(one.message.strip() for one in faults):
                    raise CheckFailed(f"option `{key}` refuses {value!r} without a word")
                return
            try:
                _use(subject, made, {**options, key: value})
            except (InputError, RefusedPair, RunError):
                return
            except Exception as error:
                told = f"option `{key}` accepts {value!r}, and then: {type(error).__name__}: {error}"
                raise CheckFailed(f"{told}; give it a bound, or raise ValueError in words") from error

        default = option.default if not option.required else subject.examples[0].get(key)
        values = option_values(option.annotation, default).filter(lambda value: value is not None)
        with contextlib.suppress(Unsatisfiable):  # nothing but files is allowed
            for_all(subject, st.tuples(st.sampled_from(subject.examples), values), with_value)


def _use(subject: Subject, made: Any, options: Mapping[str, Any]) -> None:
    """Let an instance do what it is for, once."""
    if subject.family in METHODS:
        subject.run(subject.placed({**TWO_BARS, "time": {"steps": 3, "courant": 0.5}}, options))
    elif subject.family == "shapes":
        made.mesh(np.zeros(made.dimension() or 1), 1)
    elif subject.family == "loads":
        made.amplitude(np.linspace(0.0, 1.0, 5))


@check()
def check_schema(subject: Subject) -> None:
    """Options have a JSON schema: it can be written, and its defaults are allowed by it.

    Editors complete cases with it, and other tools check them.
    """
    from percuss.case.options import schema_of
    from percuss.jsonable import plain

    schema = schema_of(subject.component)
    json.dumps(plain(schema), allow_nan=False)
    try:
        import jsonschema
    except ModuleNotFoundError:
        return
    jsonschema.Draft202012Validator.check_schema(plain(schema))
    validator = jsonschema.Draft202012Validator(plain(schema))
    for options in subject.examples:
        wrong = list(validator.iter_errors(plain(options)))
        if wrong:
            raise CheckFailed(f"its schema does not allow its example {options}: {wrong[0].message}")


@check(*METHODS)
def check_no_hidden_state(subject: Subject) -> None:
    """A run gives the same numbers, bit for bit, whatever ran before it, compiled or not; and its class is as it was.

    What a run leaves behind in a class, a module or a closure is an answer that depends on the order of runs.
    """
    before = _looks(subject)

    def twice(drawn: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        case, options, partner = drawn
        for compiled in (True, False):
            mine = subject.placed(case, options, partner)
            if not compiled:
                mine["time"] = {**mine["time"], "steps": 40}
            try:
                first = subject.run(mine, compiled=compiled)
                subject.run(subject.placed(TWO_BARS, options, partner), compiled=compiled)
            except (RunError, InputError) as stopped:
                raise NotApplicable(str(stopped)) from None
            again = subject.run(mine, compiled=compiled)
            for name in ("contact_force", "displacement"):
                if not np.array_equal(first.arrays[name], again.arrays[name], equal_nan=True):
                    how = "compiled" if compiled else "plain"
                    raise CheckFailed(f"the {how} run gives another {name} the second time")
        if _looks(subject) != before:
            raise CheckFailed("a run changed the class or its module")

    for_all(subject, with_examples(subject, rows()), twice, max(4, subject.draws // 3))


def _looks(subject: Subject) -> str:
    """Return what the class and the plain values of its module look like."""
    import sys

    module = vars(sys.modules.get(subject.component.__module__, object)) if subject.component.__module__ else {}
    plain = (int, float, str, bool, list, dict, set, tuple, np.ndarray)
    values = {name: value for name, value in dict(module).items() if isinstance(value, plain) and name[:2] != "__"}
    facts = {name: value for name, value in vars(subject.component).items() if isinstance(value, plain)}
    return repr((values, {name: value for name, value in facts.items() if name[:2] != "__"}))


@check(*METHODS)
def check_compiled_and_plain(subject: Subject) -> None:
    """Compiled and as plain Python a run gives the same numbers, to what round-off may do.

    A kernel that relies on what only one of them does (a cached global, an overflow, an unset entry) is wrong in one.
    """

    def both(drawn: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        case, options, partner = drawn
        mine = subject.placed({**case, "time": {**case["time"], "steps": 60}}, options, partner)
        try:
            compiled = subject.run(mine)
        except (RunError, InputError) as stopped:
            raise NotApplicable(str(stopped)) from None
        allowed = round_off(subject, mine, compiled)
        if allowed is None:
            return
        moved = apart(compiled, subject.run(mine, compiled=False))
        if not moved <= allowed:
            raise CheckFailed(f"plain Python differs by {moved:.2g} of the peak; round-off explains {allowed:.1g}")

    for_all(subject, with_examples(subject, rows()), both, max(4, subject.draws // 3))


def _has_number(schema: Mapping[str, Any]) -> bool:
    branches = [schema, *schema.get("anyOf", []), *([schema["items"]] if isinstance(schema.get("items"), dict) else [])]
    return any(one.get("type") in {"number", "integer"} or (one is not schema and _has_number(one)) for one in branches)
