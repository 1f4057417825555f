"""The case inside a result, run again: whether every bit agrees, and if not, what differs and what has changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from percuss.case.quantities import QUANTITIES
from percuss.errors import InputError, PercussError, RunError, wrong_input
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import Floats, Integers
from percuss.results.exact_only import run_exact
from percuss.results.provenance import case_inside
from percuss.results.result import Result, open_result
from percuss.results.runner import run

# Entries of a summary in which two runs of one case may differ: times and threads, and sentences about the way to the
# case.
_NOT_COMPARED = {"seconds", "threads", "notes", "compiled_why"}


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
    """

    quantity: str
    then: object
    now: object
    time: float | None = None
    of: str = ""
    largest: float | None = None


@dataclass(frozen=True)
class Change:
    """Something that is not as it was when a result was made: its name, then and now; None where it was not there."""

    what: str
    then: str | None
    now: str | None


@dataclass(frozen=True)
class Rerun:
    """Comparison of a result with another run of the case inside it.

    Attributes
    ----------
    path
        Path of the result.
    title
        Title of the case.
    differences
        Quantities whose bits differ.
    changes
        What has changed since the result was made.
    error
        Why there is no other result, if there is none; else empty.
    """

    path: str
    title: str
    differences: tuple[Difference, ...]
    changes: tuple[Change, ...]
    error: str = ""

    @property
    def passed(self) -> bool:
        """Whether all bits agree."""
        return not self.differences and not self.error

    def as_dict(self) -> Entries:
        """Return the comparison as plain data for JSON."""
        told = asdict(self)
        return {"result": told.pop("path"), "passed": self.passed, **told}


def rerun(path: Path, plugins: Sequence[Path] = ()) -> Rerun:
    """Run the case inside a result again and compare all that was recorded and summed up.

    A run that was stopped is expected to stop again.

    Parameters
    ----------
    path
        Path of the result.
    plugins
        Single-file plug-ins that stand in for those of the result.

    Raises
    ------
    InputError
        If the file is no result, is damaged or of a run that Ctrl-C ended, or its case cannot be read; see
        `case_inside`.
    """
    then = open_result(path)
    if then.marched and then.status == "interrupted":
        raise wrong_input(str(path), "expected a whole run, found one that Ctrl-C ended", "Go on with it by --resume.")
    case = case_inside(then.provenance, plugins=plugins, name=str(path))
    try:
        if then.marched:
            now = run(case, compiled=then.summary["compiled"], nudge=then.summary.get("fragile") is not None)
        else:
            now = run_exact(case)
    except RunError as stopped:
        now = stopped.result
    except InputError:
        raise
    except PercussError as refused:
        return Rerun(str(path), then.title, (), (), f"there is no result any more: {refused}")
    if now.marched and now.status == "interrupted":
        raise KeyboardInterrupt  # Ctrl-C ended the second run
    found = differences(then, now), changes(then.provenance, now.provenance)
    return Rerun(str(path), then.title, tuple(found[0]), tuple(found[1]))


def differences(then: Result, now: Result) -> list[Difference]:
    """Return all quantities whose bits differ: histories in the order of their first difference, then numbers."""
    histories = [
        *_of_arrays(then.arrays, now.arrays, then.coordinates),
        *_of_arrays(then.field_arrays, now.field_arrays, {}, "fields."),
    ]
    histories.sort(key=lambda difference: -np.inf if difference.time is None else difference.time)
    before, after = (_compared(each.summary) | {"resolved": each.provenance.get("resolved")} for each in (then, now))
    return [*histories, *_of_numbers(before, after, "")]


def row_differences(then: Data, now: Data, histories_then: Data, histories_now: Data) -> list[Difference]:
    """Return all quantities of a row of a study whose bits differ: histories that are kept, then numbers."""
    return [*_of_arrays(histories_then, histories_now, {}), *_of_numbers(then, now, "")]


def _compared(summary: Data) -> Entries:
    return {name: value for name, value in summary.items() if name not in _NOT_COMPARED}


def _of_arrays(then: Data, now: Data, coordinates: Mapping[str, list[str]], of: str = "") -> Iterator[Difference]:
    """Yield the arrays whose bits differ; the first axis of those over time is that of ``time``."""
    for name in dict.fromkeys([*then, *now]):
        before, after = np.asarray(then.get(name)), np.asarray(now.get(name))
        if before.shape != after.shape or before.dtype.kind not in "fiu":
            if before.shape != after.shape or (before != after).any():
                yield Difference(f"{of}{name}", str(before.shape), str(after.shape))
            continue
        differs = _bits(before) != _bits(after)
        if not differs.any():
            continue
        first = np.unravel_index(int(np.argmax(differs)), differs.shape)
        times, quantity = then.get("time", ()), QUANTITIES.get(name)
        names = coordinates.get(quantity.of if quantity else "", [])
        yield Difference(
            f"{of}{name}",
            _plain(before[first]),
            _plain(after[first]),
            time=float(times[first[0]]) if len(times) == len(before) else None,
            of=str(names[first[1]]) if len(first) > 1 and first[1] < len(names) else "",
            largest=_size(before, after),
        )


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _bits(values: Floats) -> Integers:
    """Return the bits of numbers, in which all that is not a number is one."""
    values = np.ascontiguousarray(values, dtype=float)
    return np.where(np.isnan(values), np.nan, values).view(np.int64)


def _size(before: Floats, after: Floats) -> float:
    """Return the largest difference between numbers."""
    with np.errstate(all="ignore"):
        difference = np.abs(after.astype(float) - before.astype(float))
        return float(np.max(difference, where=np.isfinite(difference), initial=0.0))


def _of_numbers(then: object, now: object, path: str) -> Iterator[Difference]:
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for name in dict.fromkeys([*then, *now]):
            yield from _of_numbers(then.get(name), now.get(name), f"{path}.{name}" if path else str(name))
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for place, (before, after) in enumerate(zip(then, now, strict=True)):
            yield from _of_numbers(before, after, f"{path}[{place}]")
    elif repr(then) != repr(now):  # of a number, the shortest text that gives back its bits
        numeric = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (then, now))
        yield Difference(path, then, now, largest=_size(np.array([then]), np.array([now])) if numeric else None)


def changes(then: Data, now: Data) -> list[Change]:
    """Return what has changed between the provenances of two results: versions, sources, plug-ins, processor.

    What one of them does not know is no change, but a plug-in that it does not use is one.
    """
    before, after = _facts(then), _facts(now)
    names = [name for name in {**before, **after} if (name in before and name in after) or name.startswith("plug-in ")]
    return [Change(name, before.get(name), after.get(name)) for name in names if before.get(name) != after.get(name)]


def _facts(provenance: Data) -> dict[str, str]:
    """Return all that numbers depend on, by its name in words."""
    facts = {f"version of {name}": version for name, version in provenance.get("versions", {}).items()}
    facts |= {"sources of percuss": provenance.get("source_digest")}
    facts |= {"processor": provenance.get("machine", {}).get("cpu")}
    facts |= {f"plug-in {name}": _plugin_words(origin) for name, origin in provenance["plugins"].items()}
    return {name: value for name, value in facts.items() if value is not None}


def _plugin_words(origin: Data) -> str:
    """Return version and digest of a plug-in; its place is no change."""
    version = f"{origin['distribution']} {origin['version']}" if origin["distribution"] else "a file"
    return f"{version}, sources {origin['digest'] or 'edited while they were in use'}"
