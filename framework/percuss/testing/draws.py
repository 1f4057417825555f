"""What the kit draws: rows of unlike bars, option values within their bounds, and the same case seen otherwise."""

from __future__ import annotations

import copy
import dataclasses
import itertools
import math
import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import PercussError
from percuss.testing.subject import CheckFailed, NotApplicable, Subject

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy


NUDGE = 1e-12  # relative; what it does to a run is what round-off may do
HANGS = 1e-4  # a nudge that moves the answer by more: the run hangs on round-off and is compared with nothing
SLACK = 10.0  # round-off may do that many times what the nudges tried did
FLOOR = 1e-11  # of the peak
COMPARED = ("contact_force", "gap", "displacement")

# what makes up a unit, in powers of length, mass and time
POWERS = {
    "1": (0, 0, 0), "length": (1, 0, 0), "mass": (0, 1, 0), "time": (0, 0, 1), "force": (1, 1, -2),
    "energy": (2, 1, -2), "velocity": (1, 0, -1), "acceleration": (1, 0, -2), "frequency": (0, 0, -1),
    "stiffness": (0, 1, -2), "impulse": (1, 1, -1), "momentum": (1, 1, -1), "pressure": (-1, 1, -2),
    "stress": (-1, 1, -2), "density": (-3, 1, 0), "area": (2, 0, 0), "volume": (3, 0, 0), "radian": (0, 0, 0),
    "degree": (0, 0, 0), "power": (2, 1, -3), "strain": (0, 0, 0), "amplitude": (0, 0, 0),
}  # fmt: skip
OTHER_UNITS = (1000.0, 1e-3, 1e6)  # of length, mass and time; powers of two would change nothing at all


# ----------------------------------------------------------------------------------------------------- drawing


def for_all(subject: Subject, strategy: SearchStrategy[Any], body: Callable[[Any], None], draws: int = 0) -> None:
    """Call `body` with drawn values, the same ones every time.

    A value to which the check does not apply (`NotApplicable`) counts for nothing; if that is every one of them, so
    does the check. A failure tells the value.
    """
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis.errors import Flaky

    told: list[NotApplicable] = []
    applied: list[bool] = []

    @settings(
        max_examples=draws or subject.draws,
        deadline=None,
        derandomize=True,
        database=None,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
        report_multiple_bugs=False,
    )
    @given(strategy)
    def each(value: Any) -> None:
        try:
            body(value)
        except NotApplicable as why:
            told.append(why)
        except (AssertionError, PercussError, ArithmeticError, ValueError, TypeError) as error:
            raise CheckFailed(f"{error}\nwith {_shown(value)}") from error
        else:
            applied.append(True)

    try:
        each()
    except Flaky as error:
        raise CheckFailed(f"the same input gives another answer the second time: {error}") from None
    if told and not applied:
        raise told[0]


def _shown(value: Any) -> str:
    """Return a drawn value as it would be written in a case."""
    from percuss.case.yaml_text import flow

    if isinstance(value, Mapping):
        return "\n".join(f"{key}: {_shown(item)}" for key, item in value.items()) if "bodies" in value else flow(value)
    if isinstance(value, tuple):
        return ("\n" if any(isinstance(item, Mapping) for item in value) else ", ").join(map(_shown, value))
    return flow(value) if isinstance(value, int | float | str | bool) else repr(value)


def number(low: float, high: float) -> SearchStrategy[float]:
    """Return numbers of two decimals, easy to read in a failing example."""
    from hypothesis import strategies as st

    return st.integers(round(low * 100), round(high * 100)).map(lambda k: k / 100)


def rows(
    *, bars: int = 3, moving: bool = True, gaps: bool = True, walls: bool = True, push: bool = False, steps: int = 300
) -> SearchStrategy[dict[str, Any]]:
    """Return rows of bars of unlike material, area, length and mesh, with walls and supports, without a method.

    Parameters
    ----------
    bars
        The most.
    moving
        Whether they have velocities.
    gaps
        Whether there may be gaps between them.
    walls
        Whether an end may meet a wall.
    push
        Whether a constant force may act on the first end.
    steps
        The most time steps.
    """
    from hypothesis import strategies as st

    @st.composite
    def drawn(draw: Callable[[SearchStrategy[Any]], Any]) -> dict[str, Any]:
        names = "abcd"[: draw(st.integers(1, bars))]
        bodies: dict[str, Any] = {}
        at = 0.0
        for place, name in enumerate(names):
            bodies[name] = {
                "bar": {"length": draw(number(0.5, 3)), "elements": draw(st.integers(1, 10))},
                "material": {"young": draw(number(20, 200)), "density": draw(number(0.01, 0.1))},
                "area": draw(number(0.5, 2)),
                "at": at,
                "velocity": draw(number(0.1, 1)) * (1 - 2 * (place > 0)) if moving else 0.0,
            }
            at = round(at + bodies[name]["bar"]["length"] + (draw(number(0, 0.1)) if gaps else 0.0), 6)
        contacts: dict[str, Any] = {
            f"{one}{two}": {"between": [f"{one}.right", f"{two}.left"]} for one, two in itertools.pairwise(names)
        }
        last = bodies[names[-1]]
        end = round(last["at"] + last["bar"]["length"], 6)
        closing = draw(st.sampled_from(["wall", "fixed", "free"] if walls and len(names) > 1 else ["free"]))
        if closing == "wall" or (walls and len(names) == 1):
            gap = draw(number(0, 0.05)) if gaps else 0.0
            contacts["wall"] = {"body": f"{names[-1]}.right", "wall": round(end + gap, 6)}
        elif closing == "fixed":
            last["fixed"] = ["right"]
        loads = {"push": {"constant": draw(number(-1, 1)), "on": "a.left"}} if push and draw(st.booleans()) else {}
        return {
            "percuss": 1,
            "bodies": bodies,
            "contacts": contacts,
            "loads": loads,
            "time": {"steps": draw(st.integers(steps // 5, steps)), "courant": draw(number(0.3, 0.9))},
            "record": {"probes": [f"{name}.{side}" for name in names for side in ("left", "right")]},
        }

    return drawn()


def option_values(annotation: Any, default: Any) -> SearchStrategy[Any]:  # noqa: PLR0911  a line a kind of type
    """Return values that the annotation of an option allows, of the size of its default."""
    from typing import Annotated, Literal, get_args, get_origin

    from hypothesis import strategies as st

    from percuss.case.type_words import is_union
    from percuss.methods.interfaces import DataFile

    if get_origin(annotation) is Annotated:
        low, high, at_low, at_high = bounds(annotation)
        size = abs(default) if isinstance(default, int | float) and default and math.isfinite(default) else 1.0
        if annotation.__origin__ in {int, float}:
            return _numbers(low, high, at_low, at_high, size, whole=annotation.__origin__ is int)
        return option_values(annotation.__origin__, default)
    if annotation in {int, float}:
        return _numbers(-math.inf, math.inf, True, True, 1.0, whole=annotation is int)
    if is_union(annotation):
        return st.one_of([option_values(one, default) for one in get_args(annotation)])
    if get_origin(annotation) is Literal:
        return st.sampled_from(get_args(annotation))
    if annotation is type(None):
        return st.none()
    if annotation is bool:
        return st.booleans()
    if get_origin(annotation) is tuple:
        inner, *rest = get_args(annotation)
        if rest == [...]:
            return st.lists(option_values(inner, None), min_size=1, max_size=3).map(tuple)
        return st.tuples(*(option_values(one, None) for one in (inner, *rest)))
    if annotation is DataFile or annotation is str:
        return st.none()
    return st.just(default)


def bounds(annotation: Any) -> tuple[float, float, bool, bool]:
    """Return lower and upper bound of an annotation, and whether each is itself allowed."""
    low, high, at_low, at_high = -math.inf, math.inf, True, True
    for one in getattr(annotation, "__metadata__", ()):
        for key, is_low, closed in (("gt", 1, False), ("ge", 1, True), ("lt", 0, False), ("le", 0, True)):
            limit = getattr(one, key, None)
            if limit is not None and is_low:
                low, at_low = float(limit), closed
            elif limit is not None:
                high, at_high = float(limit), closed
    return low, high, at_low, at_high


def _numbers(
    low: float, high: float, at_low: bool, at_high: bool, size: float, *, whole: bool
) -> SearchStrategy[float]:
    from hypothesis import strategies as st

    if whole:
        return st.integers(
            math.floor(low) + (not at_low) if math.isfinite(low) else -5,
            math.ceil(high) - (not at_high) if math.isfinite(high) else 50,
        )
    span = st.integers(-8, 8).map(lambda k: size * 10.0 ** (k / 4))
    edges = [value for value, there in ((low, at_low), (high, at_high)) if there and math.isfinite(value)]
    if math.isfinite(low) and math.isfinite(high):
        inner = st.integers(1, 99).map(lambda k: low + (high - low) * k / 100)
    elif math.isfinite(low):
        inner = span.map(lambda value: low + value)
    elif math.isfinite(high):
        inner = span.map(lambda value: high - value)
    else:
        inner = st.one_of(span, span.map(lambda value: -value), st.just(0.0))
    return st.one_of(inner, *(st.just(value) for value in edges)) if edges else inner


# ------------------------------------------------------------------------------------- the same case otherwise


def turned(case: Mapping[str, Any], direction: tuple[float, ...]) -> dict[str, Any]:
    """Return a case along a direction in two or three dimensions."""
    unit = np.array(direction) / np.linalg.norm(direction)
    out = copy.deepcopy(dict(case))
    for one in out["bodies"].values():
        one["bar"]["direction"] = list(direction)
        one["at"] = list(one["at"] * unit)
    for one in out["contacts"].values():
        if "wall" in one:
            one["wall"] = list(one["wall"] * unit)
    return out


def mirrored(case: Mapping[str, Any]) -> dict[str, Any]:
    """Return a case seen from the other side."""
    out = copy.deepcopy(dict(case))
    for one in out["bodies"].values():
        one["at"] *= -1.0
        one["bar"]["direction"] = [-1.0]
    for one in out["contacts"].values():
        if "wall" in one:
            one["wall"] *= -1.0
    return out


def shifted(case: Mapping[str, Any], shift: float) -> dict[str, Any]:
    """Return a case moved along x."""
    out = copy.deepcopy(dict(case))
    for one in out["bodies"].values():
        one["at"] += shift
    for one in out["contacts"].values():
        if "wall" in one:
            one["wall"] += shift
    return out


def turned_round(case: Mapping[str, Any]) -> dict[str, Any]:
    """Return a case with its bodies named from the other end, and the sides of each contact swapped."""
    out = copy.deepcopy(dict(case))
    out["bodies"] = dict(reversed(out["bodies"].items()))
    for one in out["contacts"].values():
        if "between" in one:
            one["between"] = list(reversed(one["between"]))
    return out


def factor(unit: str) -> float:
    """Return what a number of a unit is multiplied by in the other units.

    Raises
    ------
    CheckFailed
        If the unit is not made of known words by ``/``, ``*`` and ``^``.
    """
    out = 1.0
    for place, part in enumerate(unit.replace(" ", "").split("/")):
        for word in part.split("*"):
            base, _, power = word.partition("^")
            if base not in POWERS or not re.fullmatch(r"(-?\d+(\.\d+)?)?", power):
                raise CheckFailed(f"unit '{unit}' is not made of known words by / * ^; known are {', '.join(POWERS)}")
            value = math.prod(f**p for f, p in zip(OTHER_UNITS, POWERS[base], strict=True)) ** float(power or 1)
            out = out / value if place else out * value
    return out


def converted(case: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of bars in other units of length, mass and time; options of its method stay as they are."""
    out = copy.deepcopy(dict(case))
    for one in out["bodies"].values():
        one["bar"]["length"] *= factor("length")
        one["at"] *= factor("length")
        one["area"] *= factor("area")
        one["velocity"] *= factor("velocity")
        kinds = {"young": "stress", "density": "density"}
        one["material"] = {key: value * factor(kinds[key]) for key, value in one["material"].items()}
    for one in out["contacts"].values():
        if "wall" in one:
            one["wall"] *= factor("length")
    for one in out.get("loads", {}).values():
        one["constant"] *= factor("force")
    return out


def converted_options(subject: Subject, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options in the other units, each by the unit that it states; defaults that have one are among them."""
    from percuss.case.options import options_of

    known = options_of(subject.component)
    defaults = {
        key: option.default
        for key, option in known.items()
        if isinstance(option.default, int | float) and factor(option.unit or "1") != 1.0
    }

    def scaled(value: Any, by: float) -> Any:
        if isinstance(value, tuple | list):
            return tuple(scaled(one, by) for one in value)
        return value * by if isinstance(value, int | float) and not isinstance(value, bool) and by != 1.0 else value

    return {key: scaled(value, factor(known[key].unit or "1")) for key, value in {**defaults, **options}.items()}


# --------------------------------------------------------------------------------------------------- comparing


def round_off(subject: Subject, case: Mapping[str, Any], base: Any) -> float | None:
    """Return what round-off may do to the histories of a run, over their peaks; None where it hangs on it."""
    worst = FLOOR
    for sign in (1.0, -1.0):
        other = copy.deepcopy(dict(case))
        for place, one in enumerate(other["bodies"].values()):
            one["velocity"] *= 1.0 + sign * NUDGE * (1.0 + 0.3 * place)
            one["area"] *= 1.0 + sign * 0.1 * NUDGE * (place + 1)
        moved = apart(base, subject.run(other))
        if not moved < HANGS:
            return None
        worst = max(worst, SLACK * moved)
    return worst


def apart(one: Any, other: Any, factors: Mapping[str, float] | None = None) -> float:
    """Return by how much two runs differ, the largest over their histories, over the peak of each.

    Gaps are differences of displacements, and are held against these.
    """
    worst = 0.0
    sizes = {name: float(np.abs(one.arrays[name]).max(initial=0.0)) for name in COMPARED}
    sizes["gap"] = max(sizes["gap"], sizes["displacement"])
    for name in COMPARED:
        mine, theirs = one.arrays[name], other.arrays[name] / (factors or {}).get(name, 1.0)
        if name == "displacement" and mine.ndim == 3:  # of turned cases: how far, whichever way
            mine, theirs = np.linalg.norm(mine, axis=2), np.linalg.norm(theirs, axis=2)
        if mine.shape != theirs.shape:
            raise CheckFailed(f"{name} has shape {theirs.shape} in place of {mine.shape}")
        if sizes[name] > 0.0 and mine.size:
            worst = max(worst, float(np.abs(mine - theirs).max()) / sizes[name])
    return worst


def must_agree(
    subject: Subject,
    case: Mapping[str, Any],
    other: Mapping[str, Any],
    what: str,
    factors: Mapping[str, float] | None = None,
) -> None:
    """Run two cases that are the same in truth, and raise unless they agree to what round-off may do."""
    base = subject.run(case)
    allowed = round_off(subject, case, base)
    if allowed is None:
        raise NotApplicable("every drawn case hangs on round-off")
    try:
        changed = subject.run(other)
    except PercussError as error:
        raise CheckFailed(f"{what} stops the run: {error}") from None
    moved = apart(base, changed, factors)
    if not moved <= allowed:
        raise CheckFailed(f"{what} changes the answer by {moved:.2g} of its peak; round-off explains {allowed:.1g}")


def with_examples(subject: Subject, strategy: SearchStrategy[Any]) -> SearchStrategy[Any]:
    """Return triples of a drawn case, an option set of the subject's examples and the name of a partner.

    A partner that declares to fail the check that is running is no partner for it.
    """
    from hypothesis import strategies as st

    from percuss.testing.subject import PARTNERS

    family = PARTNERS.get(subject.family, "")
    partners = [
        name
        for name in (subject.registry.names(family) if family else ())
        if not {subject.check, f"{subject.check} with {subject.name}"}
        & set(subject.registry.components[family, name].expected_failures)
    ] or [""]
    return st.tuples(strategy, st.sampled_from(subject.examples), st.sampled_from(partners))


def replaced(registry_case: Mapping[str, Any], **parts: Any) -> dict[str, Any]:
    """Return a case with some of its parts replaced."""
    return {**copy.deepcopy(dict(registry_case)), **parts}


def is_frozen_dataclass(component: type) -> bool:
    """Return whether a class is a frozen dataclass of its own."""
    parameters = vars(component).get("__dataclass_params__")
    return dataclasses.is_dataclass(component) and bool(parameters and parameters.frozen)


STEEL = {"young": 100.0, "density": 0.01}
TWO_BARS: dict[str, Any] = {
    "percuss": 1,
    "bodies": {
        "a": {"bar": {"length": 1.0, "elements": 6}, "material": STEEL, "area": 1.0, "at": 0.0, "velocity": 0.3},
        "b": {"bar": {"length": 2.0, "elements": 12}, "material": STEEL, "area": 1.0, "at": 1.0, "velocity": -0.2},
    },
    "contacts": {"ab": {"between": ["a.right", "b.left"]}},
    "time": {"steps": 40, "courant": 0.5},
    "record": {"probes": ["a.left", "a.right", "b.left", "b.right"]},
}
