"""Differences between two results of one case, to the last bit, and between what they were made with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from percuss.case.quantities import QUANTITIES
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import Floats, Integers
from percuss.results.result import Result

# Entries of a summary in which two runs of one case may differ: times, and sentences about the way to the case.
_NOT_COMPARED = {"seconds", "notes", "compiled_why"}
_MACHINE_WORDS = {
    "cpu": "processor",
    "processor": "architecture",
    "compiled_for": "processor that numba compiles for",
    "instructions": "instructions of the processor that numba uses",
}


@dataclass(frozen=True)
class Difference:
    """A quantity in which two results differ.

    Attributes
    ----------
    quantity
        Name of a history, or dotted path of a number in the summary.
    then, now
        Value in the earlier and in the later result: of a history the first values that differ, or its shape.
    time
        Time of the first difference of a history; None for a number of the summary, or if the shapes differ.
    of
        Contact, probe or body with that difference; may be empty.
    largest
        Largest difference, None where it is no number.
    relative
        The same over the largest magnitude of the earlier values.
    """

    quantity: str
    then: object
    now: object
    time: float | None = None
    of: str = ""
    largest: float | None = None
    relative: float | None = None


@dataclass(frozen=True)
class Change:
    """Something that is not as it was when a result was made: its name, then and now; None where it was not there."""

    what: str
    then: str | None
    now: str | None


def differences(then: Result, now: Result) -> list[Difference]:
    """Return all quantities whose bits differ: histories in the order of their first difference, then numbers."""
    histories = [
        *_of_arrays(then.arrays, now.arrays, then.coordinates),
        *_of_arrays(_fields(then.field_arrays), _fields(now.field_arrays), {"body": then.field_arrays.get("body", [])}),
    ]
    histories.sort(key=lambda difference: -np.inf if difference.time is None else difference.time)
    numbers = [
        *_of_numbers(_compared(then.summary), _compared(now.summary), ""),
        *_of_numbers(then.provenance.get("resolved"), now.provenance.get("resolved"), "resolved"),
    ]
    return [*histories, *numbers]


def row_differences(then: Data, now: Data, histories_then: Data, histories_now: Data) -> list[Difference]:
    """Return all quantities of a row of a study whose bits differ: histories that are kept, then numbers."""
    before, after = ({k: v for k, v in each.items() if k != "contact"} for each in (histories_then, histories_now))
    return [*_of_arrays(before, after, {}), *_of_numbers(then, now, "")]


def _compared(summary: Data) -> Entries:
    return {name: value for name, value in summary.items() if name not in _NOT_COMPARED}


def _fields(arrays: Data) -> Entries:
    words = {name: f"{name.replace('_', ' ')} of the fields" for name in arrays if name != "stress"}
    return {words.get(name, name): values for name, values in arrays.items() if not isinstance(values, list)}


def _of_arrays(then: Data, now: Data, coordinates: Mapping[str, list[str]]) -> Iterator[Difference]:
    for name in dict.fromkeys([*then, *now]):
        before, after = then.get(name), now.get(name)
        if before is None or after is None or np.shape(before) != np.shape(after):
            yield Difference(name, _shape(before), _shape(after))
            continue
        differs = _bits(before) != _bits(after)
        if not differs.any():
            continue
        first = tuple(int(i) for i in np.unravel_index(int(np.argmax(differs)), differs.shape))
        quantity = QUANTITIES.get(name)
        times = then.get("time_half" if quantity and quantity.axis == "time_half" else "time")
        times = then.get("time of the fields") if times is None else times
        largest, relative = _size(before, after)
        yield Difference(
            name,
            _plain(before[first]),
            _plain(after[first]),
            time=None if times is None or len(times) != len(before) else float(times[first[0]]),
            of=_owner(quantity.of if quantity else "", first, coordinates),
            largest=largest,
            relative=relative,
        )


def _shape(values: Floats | None) -> str | None:
    return None if values is None else f"{' x '.join(map(str, np.shape(values)))} values"


def _bits(values: Floats) -> Integers:
    """Return the bits of numbers, in which all that is not a number is one."""
    values = np.ascontiguousarray(values, dtype=float)
    return np.where(np.isnan(values), np.nan, values).view(np.int64)


def _size(before: Floats, after: Floats) -> tuple[float | None, float | None]:
    """Return the largest difference between numbers, and the same over the largest magnitude before."""
    with np.errstate(all="ignore"):
        difference = np.abs(np.asarray(after, dtype=float) - np.asarray(before, dtype=float))
        largest = float(np.max(difference, where=np.isfinite(difference), initial=0.0))
        scale = float(np.max(np.abs(before), where=np.isfinite(before), initial=0.0))
    return largest, largest / scale if scale > 0.0 else None


def _owner(of: str, first: tuple[int, ...], coordinates: Mapping[str, list[str]]) -> str:
    names = coordinates.get("body" if of == "element" else of, [])
    return str(names[first[1]]) if len(first) > 1 and first[1] < len(names) else ""


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _of_numbers(then: object, now: object, path: str) -> Iterator[Difference]:
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for name in dict.fromkeys([*then, *now]):
            yield from _of_numbers(then.get(name), now.get(name), f"{path}.{name}" if path else str(name))
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for place, (before, after) in enumerate(zip(then, now, strict=True)):
            yield from _of_numbers(before, after, f"{path}[{place}]")
    elif repr(then) != repr(now):  # of a number, the shortest text that gives back its bits
        numeric = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (then, now))
        largest, relative = _size(np.array([then]), np.array([now])) if numeric else (None, None)
        yield Difference(path, then, now, largest=largest, relative=relative)


def changes(then: Data, now: Data) -> list[Change]:
    """Return what has changed between the provenances of two results: versions, settings, sources, plug-ins, machine.

    What one of them does not know, such as the instructions of the processor where nothing was compiled, is no change.
    """
    out = []
    for what, before, after in _facts(then, now):
        if before != after and (None not in {before, after} or what.startswith(("setting ", "plug-in "))):
            out.append(Change(what, before, after))
    return out


def _facts(then: Data, now: Data) -> Iterator[tuple[str, str | None, str | None]]:
    """Yield name, earlier and later value of each fact about the provenances of two results."""
    for part, words in (("versions", "version of "), ("settings", "setting ")):
        before, after = then.get(part) or {}, now.get(part) or {}
        yield from ((f"{words}{name}", before.get(name), after.get(name)) for name in sorted({*before, *after}))
    yield "sources of percuss", then.get("source_digest"), now.get("source_digest")
    before, after = then.get("machine") or {}, now.get("machine") or {}
    for name in sorted({*before, *after}):
        first, second = before.get(name), after.get(name)
        if name == "instructions" and first and second:
            first, second = _without_common_words(first, second), _without_common_words(second, first)
        yield _MACHINE_WORDS.get(name, name), first, second
    for name in {**then["plugins"], **now["plugins"]}:
        yield f"plug-in {name}", _plugin_words(then["plugins"].get(name)), _plugin_words(now["plugins"].get(name))


def _without_common_words(text: str, other: str) -> str:
    return " ".join(sorted({*text.split()} - {*other.split()}))


def _plugin_words(origin: Data | None) -> str | None:
    """Return version and digest of a plug-in; its place is no change."""
    if origin is None:
        return None
    version = f"{origin['distribution']} {origin['version']}" if origin["distribution"] else "a file"
    return f"{version}, sources {origin['digest'] or 'edited while they were in use'}"
