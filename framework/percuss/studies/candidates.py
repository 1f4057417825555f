"""Candidates of a search for methods: a pair with its options, a mesh and a step, and what lies beside each of them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

from percuss.case.options import Option, options_of
from percuss.case.type_words import branches, fact
from percuss.methods.interfaces import Ge, Gt, Le, Lt, Stages

if TYPE_CHECKING:
    import numpy as np

    from percuss.methods.interfaces import Component, Integrator
    from percuss.methods.registry import Registry

__all__ = ["Candidate", "defaults", "drawn", "evaluations", "needed_quantities", "neighbours"]

COURANT_NUMBERS = (0.9, 0.5)  # of the first candidates
NEARLY_ONE = 0.99  # where the mesh of a uniform bar adds nearly no error to that of the contact
LARGEST_COURANT = 2.0
STEP_OF_COURANT = 1.25
STEP_OF_OPTION = 1.6
WITHOUT_DEFAULT = (0.03, 3.0)  # range from which a pure number without a default is drawn
AROUND_DEFAULT = 10.0  # factor either way of the range around a default that has only one bound
FINITE_STEP = 0.15  # of the range of an option with two bounds, between neighbours


@dataclass(frozen=True)
class Candidate:
    """A pair of methods with the options that differ from their defaults, a mesh and a step."""

    integrator: str
    contact: str
    integrator_options: Mapping[str, Any] = field(default_factory=dict)
    contact_options: Mapping[str, Any] = field(default_factory=dict)
    courant: float = COURANT_NUMBERS[0]
    refine: int = 1

    @property
    def pair(self) -> tuple[str, str]:
        """The names of both methods."""
        return self.integrator, self.contact

    @property
    def key(self) -> str:
        """A text that is equal for equal candidates."""
        return json.dumps(self.changes, sort_keys=True)

    @property
    def changes(self) -> dict[str, Any]:
        """The values that make a case the one of this candidate, by path."""
        return {
            "method.integrator": {"name": self.integrator, **self.integrator_options},
            "method.contact": {"name": self.contact, **self.contact_options},
            "time.courant": self.courant,
            "refine": self.refine,
        }


def evaluations(integrator: Integrator) -> int:
    """Return how often a step of an integrator computes the internal forces: the number of its stages."""
    stages = integrator.bind(1.0)
    return len(stages.times) if isinstance(stages, Stages) else 1


def defaults(integrators: list[str], contacts: list[str], registry: Registry) -> list[Candidate]:
    """Return every pair with its default options on the mesh of the case, with two steps."""
    required = {
        name: _required(registry.get(family, name))
        for family, names in (("integrators", integrators), ("contacts", contacts))
        for name in names
    }
    return [
        Candidate(integrator, contact, required[integrator], required[contact], courant)
        for integrator in integrators
        for contact in contacts
        for courant in COURANT_NUMBERS
    ]


def _required(component: type[Component]) -> dict[str, Any]:
    """Return the options of a method that have no default, as its first example has them."""
    example = component.examples[0] if component.examples else {}
    return {key: example[key] for key, option in options_of(component).items() if option.required and key in example}


def needed_quantities(component: type[Component]) -> list[str]:
    """Return the options of a method without a default that have a unit: their size belongs to a case, to no search."""
    return [key for key, option in options_of(component).items() if option.required and option.unit not in ("", "1")]


def drawn(candidate: Candidate, registry: Registry, random: np.random.Generator) -> Candidate:
    """Return a candidate of the same pair and mesh with other options and another step, drawn at random."""
    options = []
    for family, name, given in _methods(candidate):
        chosen = dict(given)
        free = [option for option in options_of(registry.get(family, name)).values() if _is_open(option)]
        for option in free:
            if random.random() < 1.0 / len(free):
                chosen[option.key] = _draw(option, random)
        options.append(chosen)
    courant = float(f"{math.exp(random.uniform(math.log(0.2), math.log(1.1))):.2g}")
    courant = min(courant, NEARLY_ONE)
    return replace(candidate, integrator_options=options[0], contact_options=options[1], courant=courant)


def _methods(candidate: Candidate) -> tuple[tuple[str, str, Mapping[str, Any]], ...]:
    return (
        ("integrators", candidate.integrator, candidate.integrator_options),
        ("contacts", candidate.contact, candidate.contact_options),
    )


def _words(option: Option) -> list[Any]:
    """Return the values that an option names, where it is a choice between words."""
    return [
        value for branch in branches(option.annotation) if get_origin(branch) is Literal for value in get_args(branch)
    ]


def _is_number(option: Option) -> bool:
    return bool({float, int} & set(branches(option.annotation)))


def _is_open(option: Option) -> bool:
    """Return whether a search may set an option: a pure number, or a choice between words.

    The size of a quantity with a unit belongs to the case, and is not known here.
    """
    return option.unit in ("", "1") and (_is_number(option) or bool(_words(option)))


def _range(option: Option) -> tuple[float, float, bool]:
    """Return the lower and the upper end of the range of a number, and whether logarithms are evenly spread."""
    bounds = [(fact(option.annotation, kind), kind.__name__.lower()) for kind in (Ge, Gt, Le, Lt)]
    low, above, high, below = (None if found is None else float(getattr(found, name)) for found, name in bounds)
    low = low if low is not None else above
    high = high if high is not None else below
    if low is not None and high is not None:
        return low, high, False
    given = option.default if isinstance(option.default, int | float) else 0.0
    first, last = (given / AROUND_DEFAULT, given * AROUND_DEFAULT) if given > 0 else WITHOUT_DEFAULT
    return max(first, low or 0.0), min(last, high if high is not None else math.inf), True


def _draw(option: Option, random: np.random.Generator) -> Any:
    """Return a value of an option, drawn at random."""
    words = _words(option)
    if words and (not _is_number(option) or random.random() < 1.0 / 3.0):
        return words[int(random.integers(len(words)))]
    low, high, logarithmic = _range(option)
    share = random.random()
    value = low * (high / low) ** share if logarithmic and low > 0 else low + share * (high - low)
    return _rounded(option, value)


def _rounded(option: Option, value: float) -> Any:
    """Return a number of an option in two digits, or whole."""
    return round(value) if float not in branches(option.annotation) else float(f"{value:.2g}")


def neighbours(candidate: Candidate, registry: Registry) -> list[Candidate]:
    """Return the candidates that differ in one number by a step, or in one word."""
    found = [
        replace(candidate, courant=float(f"{candidate.courant * factor:.3g}"))
        for factor in (STEP_OF_COURANT, 1.0 / STEP_OF_COURANT)
    ]
    found = [one for one in found if one.courant <= LARGEST_COURANT]
    if NEARLY_ONE / STEP_OF_COURANT < candidate.courant < NEARLY_ONE:
        found.append(replace(candidate, courant=NEARLY_ONE))
    found += [replace(candidate, refine=candidate.refine + step) for step in (-1, 1) if candidate.refine + step > 0]
    for (family, name, given), attribute in zip(
        _methods(candidate), ("integrator_options", "contact_options"), strict=True
    ):
        for option in filter(_is_open, options_of(registry.get(family, name)).values()):
            for value in _beside(option, given.get(option.key, option.default)):
                if value != given.get(option.key, option.default):
                    changed: dict[str, Any] = {attribute: {**given, option.key: value}}
                    found.append(replace(candidate, **changed))
    return found


def _beside(option: Option, value: Any) -> Iterator[Any]:
    """Yield the values beside one of an option."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        if not _is_number(option):
            yield from _words(option)
        return
    low, high, logarithmic = _range(option)
    if logarithmic:
        if value > 0:
            yield _rounded(option, value * STEP_OF_OPTION)
            yield _rounded(option, max(value / STEP_OF_OPTION, 1.0 if float not in branches(option.annotation) else 0))
        return
    for step in (-FINITE_STEP * (high - low), FINITE_STEP * (high - low)):
        yield min(max(_rounded(option, value + step), low), high)
