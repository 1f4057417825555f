"""Candidates of a search for methods: a pair with its options, a mesh and a step, and what lies beside each of them."""

from __future__ import annotations

import itertools
import json
import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, zip_longest
from typing import Literal, get_args, get_origin

from percuss.case.options import Option, options_of
from percuss.case.type_words import bounds, branches
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import Component, Integrator, Stages
from percuss.methods.registry import Registry

FIRST_COURANT, SAFE_COURANT = 0.9, 0.5  # of the first candidates
# At 1 the mesh of a uniform bar adds no error to that of the contact.
COURANT_NUMBERS = (0.2, 0.25, 0.315, 0.4, 0.5, 0.63, 0.8, FIRST_COURANT, 0.95, 1.0, 1.25, 1.6, 2.0)
# Refinements whose costs are a quarter apart, from a millionth to the largest.
PREFERRED = tuple(float(f"{10 ** (k / 20):.3g}") for k in range(-120, 37))
CLOSE = 0.06  # less than half of the way to the next of them
ROUNDED = 0.02  # part of a number of elements
STEP_OF_OPTION = 1.6
WITHOUT_DEFAULT = (0.03, 3.0)  # range from which a pure number without a default is drawn
AROUND_DEFAULT = 10.0  # factor either way of the range around a default that has only one bound
WIDE = 1000.0  # ratio of the ends of a range above which it is searched around the default
FINITE_STEP = 0.15  # of the range of an option with two bounds, between neighbours


@dataclass(frozen=True)
class Candidate:
    """A pair of methods with the options that differ from their defaults, a mesh, a step, and a pairing of surfaces."""

    integrator: str
    contact: str
    integrator_options: Data = field(default_factory=dict)
    contact_options: Data = field(default_factory=dict)
    courant: float = FIRST_COURANT
    refine: float = 1
    pairing: str = ""  # none between bars

    @property
    def pair(self) -> tuple[str, str]:
        """The names of both methods."""
        return self.integrator, self.contact

    @property
    def key(self) -> str:
        """A text that is equal for equal candidates."""
        return json.dumps(self.changes, sort_keys=True)

    @property
    def changes(self) -> Entries:
        """The values that make a case the one of this candidate, by path."""
        return {
            "method.integrator": {"name": self.integrator, **self.integrator_options},
            "method.contact": {"name": self.contact, **self.contact_options},
            "time.courant": self.courant,
            "refine": self.refine,
            **({"method.pairing": self.pairing} if self.pairing else {}),
        }


def evaluations(integrator: Integrator) -> int:
    """Return how often a step of an integrator computes the internal forces: the number of its stages."""
    stages = integrator.bind(1.0)
    return len(stages.times) if isinstance(stages, Stages) else 1


def meshes(counts: Sequence[int]) -> list[float]:
    """Return the refinements of a search, rising, for bodies with these numbers of elements.

    They multiply the elements of all bodies by the same number, which rounding to whole elements would not: elements
    of unlike bodies would then differ in length. Those that are rounded take part where hardly anything is rounded,
    and where nothing else is as coarse. The coarsest leaves one element to the body that has the fewest.
    """
    common = math.gcd(*counts)
    exact = {number: max(1, round(number * common)) / common for number in PREFERRED}
    others = [number for number, near in exact.items() if abs(near / number - 1.0) > CLOSE]
    found: dict[tuple[int, ...], float] = {}
    for number in (*exact.values(), *others):
        refine = int(number) if number.is_integer() else float(f"{number:.6g}")
        rounded = tuple(round(count * refine) for count in counts)
        changed = max(abs(whole / (count * refine) - 1.0) for whole, count in zip(rounded, counts, strict=True))
        if min(rounded) >= 1 and (changed < ROUNDED or refine < 1.0 / common):
            found.setdefault(rounded, refine)
    return sorted(found.values())


def defaults(integrators: list[str], contacts: list[str], registry: Registry, pairing: str = "") -> list[Candidate]:
    """Return every pair on the mesh of the case with its pairing, with two steps, and with the options of its defaults.

    Options without a default are those of the first example of a method.
    """

    def required(component: type[Component]) -> Entries:
        example = component.examples[0] if component.examples else {}
        return {
            key: example[key] for key, option in options_of(component).items() if option.required and key in example
        }

    laws = {name: required(registry.get("contacts", name)) for name in contacts}
    schemes = {name: required(registry.get("integrators", name)) for name in integrators}
    pairs = itertools.product(schemes.items(), laws.items(), (FIRST_COURANT, SAFE_COURANT))
    return [
        Candidate(scheme, law, options, options_of_law, courant, pairing=pairing)
        for (scheme, options), (law, options_of_law), courant in pairs
    ]


def needed_quantities(component: type[Component]) -> list[str]:
    """Return the options of a method without a default that have a unit: their size belongs to a case, to no search."""
    return [key for key, option in options_of(component).items() if option.required and option.unit not in ("", "1")]


def _words(option: Option) -> list[object]:
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
    low, high, *_ = bounds(option.annotation)
    if math.isfinite(high - low) and not high > WIDE * low > 0.0:
        return low, high, False
    given = option.default if isinstance(option.default, int | float) else 0.0
    first, last = (given / AROUND_DEFAULT, given * AROUND_DEFAULT) if given > 0 else WITHOUT_DEFAULT
    return max(first, low), min(last, high), True


def _rounded(option: Option, value: float) -> int | float:
    """Return a number of an option in two digits, or whole."""
    return round(value) if float not in branches(option.annotation) else float(f"{value:.2g}")


def neighbours(candidate: Candidate, registry: Registry) -> list[Candidate]:
    """Return the candidates on the same mesh that differ in step, pairing or one option, the most promising first."""
    options: list[list[Candidate]] = []
    for kind in ("integrator", "contact"):
        attribute, component = f"{kind}_options", registry.get(f"{kind}s", getattr(candidate, kind))
        given = getattr(candidate, attribute)
        for option in filter(_is_open, options_of(component).values()):
            value = given.get(option.key, option.default)
            others = dict.fromkeys(one for one in _beside(option, value) if one != value)
            changed: list[Entries] = [{attribute: {**given, option.key: other}} for other in others]
            options.append([replace(candidate, **change) for change in changed])
    pairings = registry.names("pairings") if candidate.pairing else ()
    options.append([replace(candidate, pairing=name) for name in pairings if name != candidate.pairing])
    lower, higher = (bisect(COURANT_NUMBERS, candidate.courant) for bisect in (bisect_left, bisect_right))
    courants = [*COURANT_NUMBERS[max(lower - 1, 0) : lower], *COURANT_NUMBERS[higher : higher + 2]]
    steps = [replace(candidate, courant=courant) for courant in sorted(courants, key=lambda one: abs(one - 1.0))]
    return [*steps[:1], *filter(None, chain.from_iterable(zip_longest(*options))), *steps[1:]]


def _beside(option: Option, value: object) -> Iterator[object]:
    """Yield the values beside one of an option: its words, the ends of its range, and numbers one step away."""
    if not _is_number(option):
        yield from _words(option)
        return
    low, high, logarithmic = _range(option)
    yield from (low, high) if float in branches(option.annotation) else (round(low), round(high))
    if isinstance(value, bool) or not isinstance(value, int | float):
        yield _rounded(option, math.sqrt(low * high) if logarithmic else 0.5 * (low + high))
    elif logarithmic:
        yield from (_rounded(option, value * factor) for factor in (STEP_OF_OPTION, 1.0 / STEP_OF_OPTION))
    else:
        steps = (-FINITE_STEP * (high - low), FINITE_STEP * (high - low))
        yield from (min(max(_rounded(option, value + step), low), high) for step in steps)
    yield from _words(option)
