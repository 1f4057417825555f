"""Checks of every component: its documentation and class facts, its options, and the absence of hidden state."""

from __future__ import annotations

import contextlib
import copy
import inspect
import json
import math
import pickle
import sys
from collections.abc import Mapping
from typing import Any, get_args

import numpy as np
from hypothesis import strategies as st
from hypothesis.errors import Unsatisfiable

from percuss.case.json_schema import schema_of
from percuss.case.options import options_of
from percuss.case.type_words import branches
from percuss.errors import InputError, RefusedPair, RunError, suggestion
from percuss.jsonable import Data, Entries, plain
from percuss.methods.blame import described
from percuss.results.result import Result
from percuss.testing.draws import (
    TWO_BARS,
    for_all,
    must_agree,
    must_compile,
    on_chains,
    option_values,
    unit_factor,
)
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, as_of, check

# families of methods that take part in the time steps
METHODS = ("integrators", "contacts", "elements", "materials", "masses")
WITH_SOURCE = ("integrators", "contacts", "elements", "masses")
WITH_FORMULA = ("integrators", "contacts", "loads", "elements", "materials", "masses")


@check(*METHODS, first=True)
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


def _docstring(cls: type) -> str:
    """Return the docstring of a class, which Python drops if it is run by `python -OO`."""
    if sys.flags.optimize > 1:
        raise NotApplicable("`python -OO` drops all docstrings")
    return inspect.cleandoc(vars(cls).get("__doc__") or "")


@check()
def check_documented(subject: Subject) -> None:
    """It has a docstring and a summary.

    A component has its own docstring and a summary in one line. Reports and `percuss plugins NAME` show both, and
    nothing else, to describe it.
    """
    cls = subject.component
    text = _docstring(cls)
    if not text or text.startswith(f"{cls.__name__}("):  # the docstring that `dataclass` generates
        raise CheckFailed("it has no docstring of its own")
    if not cls.summary.strip() or "\n" in cls.summary or len(cls.summary) > 100:
        raise CheckFailed(f"its summary is {cls.summary!r}, expected one line of at most 100 characters")


@check(*WITH_FORMULA)
def check_formula(subject: Subject) -> None:
    """Its docstring has a formula.

    The docstring of a method has a paragraph that begins with "Formula:". `percuss check` and `percuss plugins
    NAME` show this paragraph, so that the reader sees which equation is solved.
    """
    paragraphs = _docstring(subject.component).split("\n\n")
    if not any(paragraph.startswith("Formula:") for paragraph in paragraphs):
        raise CheckFailed('no paragraph of its docstring begins with "Formula:"')


@check(*WITH_SOURCE)
def check_references(subject: Subject) -> None:
    """It names its source.

    A method names its source in `references`, with a DOI if there is one. A result cannot be published if its
    methods have no source. The source of a new method is its author and the year.
    """
    if not subject.component.references or not all(
        isinstance(reference, str) and reference.strip() for reference in subject.component.references
    ):
        raise CheckFailed("`references` is empty: name the source")


@check()
def check_facts(subject: Subject) -> None:
    """Its class facts have the right types.

    Class facts have the types that the contract prescribes, and each expected failure names a check and a reason.
    Tables misread a fact of the wrong type, and a misspelt expected failure excuses nothing.
    """
    cls = subject.component
    for fact in ("references", "examples"):
        if not isinstance(getattr(cls, fact), tuple):
            raise CheckFailed(f"`{fact}` is {getattr(cls, fact)!r}, expected a tuple")
    if not cls.examples:
        raise CheckFailed("`examples` is empty: ({},) runs the defaults")
    if not isinstance(cls.expected_failures, Mapping):
        raise CheckFailed(f"`expected_failures` is {cls.expected_failures!r}, expected a mapping of check to reason")
    for name, reason in cls.expected_failures.items():
        if name not in subject.declarable:
            advice = suggestion(name, subject.declarable, "check")
            raise CheckFailed(f"`expected_failures` has '{name}', which is no check. {advice}")
        if not (isinstance(reason, str) and reason.strip()):
            raise CheckFailed(f"`expected_failures` gives no reason for '{name}'")


@check()
def check_frozen(subject: Subject) -> None:
    """It is a frozen dataclass.

    Instances with the same options are equal, hashable and picklable. Studies send methods to other processes and
    distinguish runs by the options of their methods.
    """
    parameters = vars(subject.component).get("__dataclass_params__")  # those of the class itself, not of a base class
    if not (parameters and parameters.frozen):
        raise CheckFailed("it is no frozen dataclass: put @dataclass(frozen=True) above the class")
    if "<locals>" in subject.component.__qualname__:
        raise CheckFailed("it is defined inside a function: define it at the top of its module, where pickles find it")
    for options in subject.examples:
        instance, other = subject.make(options), subject.make(copy.deepcopy(options))
        if instance != other or hash(instance) != hash(other):
            raise CheckFailed(f"two instances with the options {options} are not equal")
        if subject.component.__module__ != "__main__" and pickle.loads(pickle.dumps(instance)) != instance:  # noqa: S301
            raise CheckFailed(f"an instance with the options {options} is another one after pickling")


@check()
def check_examples(subject: Subject) -> None:
    """Its examples are valid options.

    Every set of options in `examples` is accepted like the options of a case. The kit, the documentation and the
    reader try the examples first.
    """
    for options in subject.examples:
        subject.make(options)


@check()
def check_options_documented(subject: Subject) -> None:
    """Each option has a text and a unit.

    Every option has a description, `Doc("...")`, and every number a unit, such as `Unit("force/length")`. The
    schema, the messages and the check `units` use the unit.
    """
    for key, option in options_of(subject.component).items():
        if not option.doc:
            raise CheckFailed(f'option `{key}` has no description: add Doc("...") to its annotation')
        if _takes_number(option.annotation) and not option.unit:
            raise CheckFailed(f'option `{key}` has no unit: add Unit("..."), Unit("1") for a pure number')
        if option.unit:
            unit_factor(option.unit)


@check()
def check_options_bounded(subject: Subject) -> None:
    """Options outside their bounds are refused.

    A value within the bounds of an option works, or is refused with a reason. Any other value is refused. If a
    value is accepted and then gives nonsense or a Python error, a bound is missing.
    """
    for key, option in options_of(subject.component).items():
        for invalid in (math.nan, {"no": "mapping"}):
            try:
                subject.make({**subject.examples[0], key: invalid})
            except CheckFailed:
                continue
            raise CheckFailed(f"option `{key}` accepts {invalid!r}")

        def with_value(drawn: tuple[Entries, object], key: str = key) -> None:
            options, value = drawn
            try:
                instance = subject.make({**options, key: value})
            except CheckFailed as refusal:
                if not str(refusal).strip(": "):
                    raise CheckFailed(f"option `{key}` refuses {value!r} without a reason") from None
                return
            try:
                _use(subject, instance, {**options, key: value})
            except (InputError, RefusedPair, RunError):
                return
            except Exception as error:
                failure = f"option `{key}` accepts {value!r}, then it raises {described(error)}"
                raise CheckFailed(f"{failure}; give it a bound, or raise ValueError in words") from error

        default = option.default if not option.required else subject.examples[0].get(key)
        values = option_values(option.annotation, default).filter(lambda value: value is not None)
        with contextlib.suppress(Unsatisfiable):  # raised if the option takes nothing but a file or a text
            for_all(subject, st.tuples(st.sampled_from(subject.examples), values), with_value)


def _use(subject: Subject, instance: Any, options: Data) -> Result | None:
    """Use an instance once, as a shape or load outside of a run, else in a run of three steps, and return its result.

    A method whose pair with the default partner is refused runs with the first partner that it may have.
    """
    if subject.family in METHODS:
        case = {**TWO_BARS, "time": {"steps": 3, "courant": 0.5}}
        partners: list[Data] = [{"name": name, **subject.partner_class(name).examples[0]} for name in subject.partners]
        for partner in [None, *partners]:
            with contextlib.suppress(NotApplicable):
                return subject.run(subject.placed(case, options, partner))
    elif subject.family == "shapes":
        instance.mesh(np.zeros(instance.dimension() or 1), 1)
    elif subject.family == "loads":
        instance.amplitude(np.linspace(0.0, 1.0, 5))
    return None


@check()
def check_schema(subject: Subject) -> None:
    """Its options have a JSON schema.

    The schema can be written as JSON and allows the defaults and examples of the options. Editors complete cases
    with the schema, and other tools check cases against it.
    """
    schema = schema_of(subject.component)
    json.dumps(plain(schema), allow_nan=False)
    try:
        import jsonschema
    except ModuleNotFoundError:
        return
    jsonschema.Draft202012Validator.check_schema(plain(schema))
    validator = jsonschema.Draft202012Validator(plain(schema))
    for options in subject.examples:
        errors = list(validator.iter_errors(plain(options)))
        if errors:
            raise CheckFailed(f"its schema refuses its example {options}: {errors[0].message}")


@check(*METHODS)
@on_chains(share=3)
def check_no_hidden_state(subject: Subject, case: Entries) -> None:
    """The same run gives the same bits.

    A run, compiled or not, gives the same bits whatever ran before it, and leaves its class unchanged. If a run
    leaves data in a class, a module or a closure, results depend on the order of the runs.
    """
    before = _class_and_module_values(subject)
    for compiled in (True, False):
        full_case = subject.placed(case)
        if not compiled:
            full_case["time"] = {**full_case["time"], "steps": 40}
        first = subject.run(full_case, compiled=compiled)
        subject.run(subject.placed(TWO_BARS), compiled=compiled)
        kind = "compiled" if compiled else "plain"
        try:
            second = subject.run(full_case, compiled=compiled, certify=as_of(first))
        except (RunError, InputError) as stopped:
            raise CheckFailed(f"the {kind} run is stopped the second time: {stopped}") from None
        for name in ("contact_force", "displacement"):
            if not np.array_equal(first.arrays[name], second.arrays[name], equal_nan=True):
                raise CheckFailed(f"the {kind} run gives another {name} the second time")
    if _class_and_module_values(subject) != before:
        raise CheckFailed("a run changed the class or its module")


def _class_and_module_values(subject: Subject) -> str:
    """Return the plain values of the class and of its module as a text, to detect changes of them."""
    import sys

    module = vars(sys.modules.get(subject.component.__module__, object)) if subject.component.__module__ else {}
    plain = (int, float, str, bool, list, dict, set, tuple, np.ndarray)
    values = {name: value for name, value in dict(module).items() if isinstance(value, plain) and name[:2] != "__"}
    facts = {name: value for name, value in vars(subject.component).items() if isinstance(value, plain)}
    return repr((values, {name: value for name, value in facts.items() if name[:2] != "__"}))


@check(*METHODS)
@on_chains(share=3)
def check_compiled_and_plain(subject: Subject, case: Entries) -> None:
    """Compiled and plain runs agree.

    A compiled run and a run in plain Python give the same numbers up to round-off. A kernel is wrong in one of the
    two if it relies on the behaviour of the other, such as a cached global, an overflow or an unset entry.
    """
    case = subject.placed({**case, "time": {**case["time"], "steps": 60}})
    must_agree(
        subject, case, {"plain Python": lambda base: subject.run(case, compiled=False, certify=as_of(base)).arrays}
    )


def _takes_number(annotation: object) -> bool:
    """Return whether an option may be a number, or a list of numbers."""
    kinds = list(branches(annotation))
    items = [get_args(kind)[0] for kind in kinds if get_args(kind)[1:] == (...,)]
    return not {int, float}.isdisjoint(kinds) or any(map(_takes_number, items))
