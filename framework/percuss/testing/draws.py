"""Random input of the kit: chains of unlike bars, and a case in other units."""

from __future__ import annotations

import copy
import dataclasses
import functools
import itertools
import math
import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from percuss.case.options import options_of
from percuss.case.quantities import COMPARED_BY_KIT
from percuss.errors import InputError, PercussError, RefusedPair, RunError
from percuss.results.result import Result
from percuss.testing.subject import PARTNERS, CheckFailed, NotApplicable, Subject, must

if TYPE_CHECKING:
    from percuss.jsonable import Data, Entries
    from percuss.methods.interfaces import Floats


ChainCheck = Callable[[Subject, "Entries"], None]
Arrays = Mapping[str, "Floats"]
PERTURBATION = 1e-12  # relative to the data of a case; its effect on a run estimates that of round-off
TOO_SENSITIVE = 1e-4  # a run that a perturbation changes by more is decided by round-off and cannot be compared
SAFETY_FACTOR = 10.0  # round-off may change a run by this multiple of the effect of the perturbations tried
SEED = 1
BALANCED = 1e-11  # largest relative error of a balance
MOST_SHRINKS = 40  # tries after which no smaller case is looked for
FLOOR = 1e-11  # smallest allowed difference, relative to the peak

# the dimension of each word of a unit, as powers of length, mass and time
POWERS = {
    "1": (0, 0, 0), "length": (1, 0, 0), "mass": (0, 1, 0), "time": (0, 0, 1), "force": (1, 1, -2),
    "energy": (2, 1, -2), "velocity": (1, 0, -1), "acceleration": (1, 0, -2), "frequency": (0, 0, -1),
    "stiffness": (0, 1, -2), "impulse": (1, 1, -1), "momentum": (1, 1, -1), "pressure": (-1, 1, -2),
    "stress": (-1, 1, -2), "density": (-3, 1, 0), "area": (2, 0, 0), "volume": (3, 0, 0), "radian": (0, 0, 0),
    "degree": (0, 0, 0), "power": (2, 1, -3), "strain": (0, 0, 0), "amplitude": (0, 0, 0),
}  # fmt: skip
# units of the numbers in a case of bars, by their keys
UNITS = {
    "length": "length", "at": "length", "wall": "length", "area": "area", "velocity": "velocity",
    "young": "stress", "density": "density", "constant": "force", "epsilon_s": "stiffness", "epsilon_m": "mass",
    "end": "time", "step": "time", "from": "time", "until": "time",
}  # fmt: skip
# factors of length, mass and time; powers of two would leave every result the same to the last bit
OTHER_UNITS = (1000.0, 1e-3, 1e6)


# ----------------------------------------------------------------------------------------------------- drawing


def for_all(subject: Subject, strategy: SearchStrategy[Any], body: Callable[[Any], None], draws: int = 0) -> None:
    """Call `body` with drawn values; Hypothesis looks for a small one for which it fails.

    A value for which `body` raises `NotApplicable`, or for which a run is refused or stopped, is skipped; if all values
    are skipped, `NotApplicable` is raised with the first reason.
    """
    skipped: list[Exception] = []
    applied: list[bool] = []
    failed: set[str] = set()
    calls = itertools.count()

    @seed(SEED)  # else the source text of `each` is the seed
    @settings(
        max_examples=draws or subject.draws,
        deadline=None,
        derandomize=True,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
        report_multiple_bugs=False,
    )
    @given(strategy)
    def each(value: object) -> None:
        # a run takes long: after some tries the smallest value so far is small enough
        if failed and next(calls) > MOST_SHRINKS and repr(value) not in failed:
            return
        try:
            body(value)
        except (NotApplicable, InputError, RefusedPair, RunError) as why:
            skipped.append(why)
        except Exception:
            failed.add(repr(value))
            raise
        else:
            applied.append(True)

    each()
    if skipped and not applied:
        raise NotApplicable(str(skipped[0]))


def number(low: float, high: float) -> SearchStrategy[float]:
    """Return a strategy for numbers of two decimals, which are easy to read in a failing example."""
    return st.integers(round(low * 100), round(high * 100)).map(lambda k: k / 100)


def bar(elements: int, length: float = 1.0, **parts: object) -> Entries:
    """Return a body of a case, a bar of steel and of area 1 at rest at x = 0 but for the given parts."""
    return {
        "bar": {"length": length, "elements": elements},
        "material": {"young": parts.pop("young", 100.0), "density": parts.pop("density", 0.01)},
        "area": 1.0,
        "at": 0.0,
        "velocity": 0.0,
        **parts,
    }


def chain(bodies: Entries, *, wall: float | None = None, probes: bool = False, **parts: object) -> Entries:
    """Return a case of bars in contact with their neighbours, the last with a wall; `probes` are at all ends."""
    contacts: Entries = {
        f"{name}{following}": {"between": [f"{name}.right", f"{following}.left"]}
        for name, following in itertools.pairwise(bodies)
    }
    if wall is not None:
        contacts["wall"] = {"body": f"{list(bodies)[-1]}.right", "wall": wall}
    ends = [f"{name}.{side}" for name in bodies for side in ("left", "right")] if probes else []
    return {"percuss": 1, "bodies": bodies, "contacts": contacts, **parts, "record": {"probes": ends}}


def at_courant(case: Data, courant: float) -> Entries:
    """Return a case with another Courant number."""
    return {**case, "time": {**case["time"], "courant": courant}}


@st.composite
def bar_chains(draw: Callable[[SearchStrategy[Any]], Any], *, push: bool = False) -> Entries:
    """Draw a chain of bars of unlike material, area, length and mesh, as a case without a method.

    It lies along x; its last end may face a wall, be fixed or be free. With `push` a constant force may act on the
    first end.
    """
    names = "abc"[: draw(st.integers(1, 3))]
    bodies: Entries = {}
    position = 0.0
    for index, name in enumerate(names):
        bodies[name] = bar(
            draw(st.integers(1, 10)),
            draw(number(0.5, 3)),
            young=draw(number(20, 200)),
            density=draw(number(0.01, 0.1)),
            area=draw(number(0.5, 2)),
            at=position,
            velocity=draw(number(0.1, 1)) * (1 - 2 * (index > 0)),
        )
        position = round(position + bodies[name]["bar"]["length"] + draw(number(0, 0.1)), 6)
    last, wall = bodies[names[-1]], None
    closing = draw(st.sampled_from(["wall", "fixed", "free"] if len(names) > 1 else ["wall"]))
    if closing == "wall":
        wall = round(last["at"] + last["bar"]["length"] + draw(number(0, 0.05)), 6)
    elif closing == "fixed":
        last["fixed"] = ["right"]
    loads = {"push": {"constant": draw(number(-1, 1)), "on": "a.left"}} if push and draw(st.booleans()) else {}
    time = {"steps": draw(st.integers(60, 300)), "courant": draw(number(0.3, 0.9))}
    return chain(bodies, wall=wall, probes=True, loads=loads, time=time)


# ------------------------------------------------------------------------------------------------ other units


def unit_factor(unit: str, scales: tuple[float, ...] = OTHER_UNITS) -> float:
    """Return the factor that converts a number with the given unit to other units of length, mass and time.

    Raises
    ------
    CheckFailed
        If the unit is not a combination of known words by ``/``, ``*`` and ``^``.
    """
    factor = 1.0
    for position, part in enumerate(unit.replace(" ", "").split("/")):
        for word in part.split("*"):
            base, _, power = word.partition("^")
            known = base in POWERS and re.fullmatch(r"(-?\d+(\.\d+)?)?", power)
            must(known, f"unit '{unit}' must consist of known words and / * ^; known are {', '.join(POWERS)}")
            of_word = math.prod(scale**exponent for scale, exponent in zip(scales, POWERS[base], strict=True))
            factor *= of_word ** (float(power or 1) * (-1.0 if position else 1.0))
    return factor


def scaled(value: Any, scale: float) -> Any:
    """Return a number times a scale, or a tuple of such; anything else stays as it is."""
    if isinstance(value, tuple | list):
        return tuple(scaled(item, scale) for item in value)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return value * scale if is_number and scale != 1.0 else value


def converted(part: Data, scales: tuple[float, ...] = OTHER_UNITS) -> Entries:
    """Return a case of bars, or a part of it, converted to the other units, without the options of methods."""
    factors = {key: unit_factor(UNITS.get(key, "1"), scales) for key in part}
    return {
        key: converted(value, scales) if isinstance(value, dict) else scaled(value, factors[key])
        for key, value in part.items()
    }


def converted_options(subject: Subject) -> Entries:
    """Return the options of a subject converted to the other units by their units, with defaults that change."""
    options = options_of(subject.component)
    converted = {
        key: scaled(subject.options.get(key, option.default), unit_factor(option.unit or "1"))
        for key, option in options.items()
    }
    return {k: value for k, value in converted.items() if k in subject.options or value != options[k].default}


# --------------------------------------------------------------------------------------------------- comparing


def round_off(subject: Subject, case: Data, base: Result) -> float | None:
    """Return a bound of the effect of round-off on the histories of a run, relative to their peaks.

    It is None for a run that is decided by round-off and cannot be compared with another.
    """
    worst, subject = FLOOR, dataclasses.replace(subject, read=[])
    for sign in (1.0, -1.0):
        other = copy.deepcopy(dict(case))
        for index, body in enumerate(other["bodies"].values()):
            body["velocity"] *= 1.0 + sign * PERTURBATION * (1.0 + 0.3 * index)
            body["area"] *= 1.0 + sign * 0.1 * PERTURBATION * (index + 1)
        difference = largest_difference(base.arrays, subject.run(other, like=base).arrays)
        if not difference < TOO_SENSITIVE:
            return None
        worst = max(worst, SAFETY_FACTOR * difference)
    return worst


def largest_difference(arrays: Arrays, others: Arrays) -> float:
    """Return the largest difference between the histories that two runs have, each relative to its peak.

    A gap is a difference of displacements, so the difference of gaps is taken relative to the largest displacement
    where that is larger.
    """
    worst = 0.0
    sizes = {name: float(np.abs(arrays[name]).max(initial=0.0)) for name in COMPARED_BY_KIT}
    sizes["gap"] = max(sizes["gap"], sizes["displacement"])
    for name in (name for name in COMPARED_BY_KIT if name in others):
        history, compared = arrays[name], others[name]
        must(history.shape == compared.shape, f"{name} has shape {compared.shape} instead of {history.shape}")
        if sizes[name] > 0.0 and history.size:
            worst = max(worst, float(np.abs(history - compared).max()) / sizes[name])
    return worst


def must_agree(subject: Subject, case: Data, change: str, twin: Callable[[Result], Arrays]) -> None:
    """Raise `CheckFailed` unless a twin of a run differs from it by no more than round-off explains.

    Parameters
    ----------
    subject, case
        The subject, and the case of the run.
    change, twin
        What makes the twin another run, and a function that returns its histories.
    """
    base = subject.run(case)
    allowed = round_off(subject, case, base)
    if allowed is None:
        raise NotApplicable("every drawn case depends on round-off")
    try:
        difference = largest_difference(base.arrays, twin(base))
    except PercussError as error:
        raise CheckFailed(f"{change} stops the run: {error}") from None
    shares = f"{per_cent(difference)} of its peak; round-off explains {per_cent(allowed)}"
    must(difference <= allowed, f"{change} changes the result by {shares}")


def on_chains(share: int = 1, **chains: Any) -> Callable[[ChainCheck], Callable[[Subject], None]]:
    """Return a decorator that turns a function of a subject and a case into a check on drawn chains of bars.

    The subject passed to the function has options and a partner, which `Subject.placed` uses. In a family with partners
    both are drawn, but for partners that declare the running check as an expected failure. In another family each
    option set of the examples is used in turn.

    Parameters
    ----------
    share
        Number by which the number of draws is divided.
    **chains
        Keywords of `bar_chains`.
    """

    def decorated(function: ChainCheck) -> Callable[[Subject], None]:
        @functools.wraps(function)
        def made(subject: Subject) -> None:
            subject.along_line()

            def body(drawn: tuple[Any, ...]) -> None:
                case, *choices = drawn
                for options, partner in choices:
                    function(dataclasses.replace(subject, options=options, partner=partner), case)

            pairs = [st.tuples(st.just(options), st.just("")) for options in subject.examples]
            if subject.family in PARTNERS:
                names = {subject.check, f"{subject.check} with {subject.name}"}
                declared = {one: subject.partner_class(one).expected_failures for one in subject.partners}
                willing = [one for one, failures in declared.items() if not names & set(failures)]
                pairs = [st.tuples(st.sampled_from(subject.examples), st.sampled_from(willing or [""]))]
            for_all(subject, st.tuples(bar_chains(**chains), *pairs), body, max(1, subject.draws // share))

        return made

    return decorated


def must_balance(result: Result, *, ledger: bool = True) -> None:
    """Raise `CheckFailed` unless the momentum of a run is balanced to round-off, and with `ledger` its energy too."""
    errors = {"momentum": result.summary["momentum"]["error"]}
    errors |= {"energy": result.summary["energy"]["ledger_error"]} if ledger else {}
    for name, error in errors.items():
        must(error <= BALANCED, f"the balance of {name} is open by {per_cent(error)}")


def must_compile(result: Result) -> None:
    """Raise `CheckFailed` if a kernel of a run could not be compiled."""
    for why in result.summary["compiled_why"]:
        must("cannot be compiled" not in why, f"{why}; a kernel in plain Python is about 100 times slower")


def per_cent(fraction: float) -> str:
    """Return a fraction in per cent, with three digits."""
    return f"{100.0 * fraction:.3g} %"


TWO_BARS = chain(
    {"a": bar(6, velocity=0.3), "b": bar(12, 2.0, at=1.0, velocity=-0.2)},
    probes=True,
    time={"steps": 40, "courant": 0.5},
)
# A bar that strikes a wall once and leaves it.
STRUCK_WALL = chain({"a": bar(20, velocity=0.5)}, wall=1.0, time={"steps": 40, "courant": 0.5})
