"""The one escape from the contact equation: laws whose multipliers come from a kernel of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact import POINT
from percuss.contracts import ContactLaw, Trial
from percuss.errors import PluginError
from percuss.specialise import Specialiser, compile_error

if TYPE_CHECKING:
    from percuss.contracts import Floats

Answer = tuple[float, float]


def multipliers(bound: Any, trial: Trial, multiplier: Floats) -> None:
    """Slot: fill the multipliers of one law's points."""
    raise NotImplementedError


def tail(bound: Any, points: Any, dt: float, time: float, answer: Answer, first: int) -> None:
    """Slot: the laws behind this one; none unless bound."""


def one_law(bound: Any, points: Any, dt: float, time: float, answer: Answer, first: int) -> None:
    """Let one law fill the multipliers of its points, which start at `first`, then those behind it."""
    mine = points[first : first + bound[1]]
    trial = Trial(
        mine.gap, mine.predicted_gap, mine.rate, mine.predicted_rate, mine.delassus, dt, time, answer[0], answer[1]
    )
    multipliers(bound[0], trial, mine.multiplier)
    tail(bound[2], points, dt, time, answer, first + bound[1])


def laws(bound: Any, points: Any, dt: float, time: float, answer: Answer) -> None:
    """Let every law that is not rows fill its multipliers; a template around `first_law`.

    `answer` is what a multiplier of 1/s adds to the predicted gap and to the predicted rate.
    """
    first_law(bound[1], points, dt, time, answer, bound[0])


def first_law(bound: Any, points: Any, dt: float, time: float, answer: Answer, first: int) -> None:
    """Slot: the first law that is not rows; nothing to do where there is none."""


def nest(entries: list[dict[str, Any]], before: int) -> Any:
    """Return the bound arrays of `entries` as `laws` reads them: (first point, (arrays, points, (...)))."""
    nested: Any = (0,)
    for entry in reversed(entries):
        nested = (entry["bound"], len(entry["where"]), nested)
    return (before, nested)


def bind(maker: Specialiser, entries: list[dict[str, Any]], plain: frozenset[str]) -> Callable[..., None]:
    """Return the kernel that calls those of all `entries` in turn."""
    behind: Any = None
    for entry in reversed(entries):
        kernel = kernel_of(entry["law"])
        python = f"contact law {entry['law'].name}" in plain
        part = maker.with_slots({multipliers: kernel} | ({tail: behind} if behind is not None else {}))
        part.jit = maker.jit and not python
        behind = part.bind(one_law, plain=python)
    slots = {first_law: behind} if behind is not None else {}
    return maker.with_slots(slots).bind(laws, plain=bool(plain))


def kernel_of(law: ContactLaw) -> Callable[..., None]:
    """Return a law's own kernel.

    Raises
    ------
    PluginError
        If it has none, and its `bind` returned no rows either.
    """
    kernel = getattr(type(law), "multipliers", None)
    if kernel is None:
        raise PluginError(
            f"contact law {law.name}: bind returned no Rows, and the class has no static method "
            "`multipliers(bound, trial, multiplier)`"
        )
    return kernel  # type: ignore[no-any-return]


def why_not(entry: dict[str, Any]) -> Exception | None:
    """Return why the kernel of a bound law cannot be compiled, or None."""
    points = np.recarray(len(entry["where"]), dtype=POINT)
    points[:] = np.ones((), dtype=POINT)
    try:
        bind(Specialiser(counting=True), [entry], frozenset())(nest([entry], 0), points, 1.0, 0.0, (1.0, 1.0))
    except compile_error() as error:
        return error
    return None
