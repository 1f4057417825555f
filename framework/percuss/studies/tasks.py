"""Many runs as a list: every case, pair of methods and point a task, and every task, whatever becomes of it, a row."""

from __future__ import annotations

import itertools
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from percuss.case.options import options_of
from percuss.errors import InputError, PercussError, RefusedPair, RunError, TooLargeError
from percuss.results.assemble import AGAINST, NOT_VALID
from percuss.results.runner import run, timed_run

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.methods.interfaces import ContactLaw
    from percuss.methods.registry import Registry
    from percuss.results.result import Result

TIED = "tied"  # in place of a contact law, in the rows of tied twins
LOST = "lost"  # status of a row that says nothing of its methods: the run is made again
# errors of the machine, whoever's code meets them: a file that is gone, no memory, a package that is missing
ENVIRONMENT = (OSError, MemoryError, ImportError, EOFError)


@dataclass(frozen=True)
class Task:
    """One run to be made.

    Attributes
    ----------
    case, integrator, contact
        What the row is called by.
    varied
        Value of each varied path.
    changes
        All values replaced in the case, those of `varied` among them.
    tied
        Whether the interfaces are tied while the exact contact is closed.
    """

    case: str
    integrator: str
    contact: str
    varied: Mapping[str, Any]
    changes: Mapping[str, Any]
    tied: bool = False


@dataclass(frozen=True)
class Row:
    """One run of a comparison.

    Attributes
    ----------
    integrator, contact
        Names of the pair.
    varied
        Value of each varied path.
    status
        ``done``, ``interrupted``, ``unstable``, ``refused``, ``failed``; or `LOST` where the machine or percuss
        itself failed and nothing is known of the methods.
    reason
        Why it is not ``done``; empty if it is.
    said_by
        Which component refused the pair; empty otherwise.
    result
        The result, also of a run that was stopped; None where there was no run.
    unread
        Whether the run failed because the case could not be read with the values of this row.
    """

    integrator: str
    contact: str
    varied: Mapping[str, Any]
    status: str
    reason: str = ""
    said_by: str = ""
    result: Result | None = field(default=None, repr=False)
    unread: bool = False

    @property
    def label(self) -> str:
        """The pair and what was varied, in one line."""
        return " ".join(
            [
                f"{self.integrator} + {self.contact}",
                *(f"{k.split('.')[-1]}={v}" for k, v in self.varied.items()),
            ]
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the row in the terms of JSON."""
        return {
            "integrator": self.integrator,
            "contact": self.contact,
            **self.varied,
            "status": self.status,
            "reason": self.reason,
            "said_by": self.said_by,
            "summary": self.result.summary if self.result is not None else None,
        }


def tasks(
    label: str,
    case: Case,
    integrators: Mapping[str, Any],
    contacts: Mapping[str, Any],
    points: Sequence[Mapping[str, Any]],
    *,
    tied: bool = False,
    strict: bool = False,
) -> Iterator[Task]:
    """Yield the tasks of one case: every pair with every point, then the tied twin of every integrator and point.

    Points that differ only in options which a pair does not have are one task of it, without these options.

    Parameters
    ----------
    label
        What the case is called.
    case
        The case; its own integrator or law takes part where there is none to choose from.
    integrators, contacts
        A name, or a mapping with a name and options, by label. A name alone keeps the options that the case gives.
    points
        Values of dotted paths.
    tied
        Whether there are twins.
    strict
        Whether every pair gets every value of a point, also those that it has no option for.
    """
    firsts = list(integrators.items()) or [(case.method.integrator.name, None)]
    seconds = list(contacts.items()) or [(case.method.contact.name, None)]
    for (one, first), (two, second) in itertools.product(firsts, seconds):
        changes = {**_change("method.integrator", first), **_change("method.contact", second)}
        for point in points if strict else _applicable(case, points, first, second):
            names = _own(point, "method.integrator") or one, _own(point, "method.contact") or two
            yield Task(label, *names, point, {**changes, **point})
    bare = _without_law(points) if tied else []
    for one, first in firsts:
        changes = _change("method.integrator", first)
        for point in bare if strict else _applicable(case, bare, first, None):
            yield Task(label, _own(point, "method.integrator") or one, TIED, point, {**changes, **point}, tied=True)


def _applicable(
    case: Case, points: Sequence[Mapping[str, Any]], first: Any, second: Any
) -> Iterator[Mapping[str, Any]]:
    """Yield the points without the options that an integrator or a law does not have, each of these once.

    A value of such an option changes nothing: the run is one, and the value is none of its row.
    """
    made = set()
    for point in points:
        known = {
            path: set(options_of(case.registry.get(family, name)))
            for path, family, given, own in (
                ("method.integrator", "integrators", first, case.method.integrator.name),
                ("method.contact", "contacts", second, case.method.contact.name),
            )
            if (name := _own(point, path) or _name(given) or own) in case.registry.names(family)
        }
        lacking = {
            path
            for path in point
            for method, options in known.items()
            if path.startswith(f"{method}.") and path.split(".")[2] not in {"name", *options}
        }
        fitting = {path: value for path, value in point.items() if path not in lacking}
        which = repr(sorted(fitting.items(), key=repr))
        if lacking and which in made:
            continue
        if lacking:
            made.add(which)
        yield fitting


def _name(given: Any) -> str:
    """Return the name of a method as it is listed, alone or with options; nothing where none is listed."""
    name = given.get("name") if isinstance(given, Mapping) else given
    return name if isinstance(name, str) else ""


def _without_law(points: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the points without what belongs to the law that the twin does not have, each once."""
    law = ("method.contact", "method.contact.")
    bare = [
        {path: v for path, v in point.items() if path != law[0] and not path.startswith(law[1])} for point in points
    ]
    return list({repr(sorted(point.items())): point for point in bare}.values())


def _change(path: str, value: Any) -> dict[str, Any]:
    if value is None:
        return {}
    return {f"{path}.name": value} if isinstance(value, str) else {path: value}


def _own(point: Mapping[str, Any], path: str) -> str:
    """Return the method that a point itself names, where the methods are varied by their path."""
    value = point.get(path, point.get(f"{path}.name"))
    name = value.get("name") if isinstance(value, Mapping) else value
    return name if isinstance(name, str) else ""


def perform(case: Case, task: Task, *, nudge: bool = False) -> tuple[Row, InputError | None]:
    """Make one run.

    Parameters
    ----------
    case
        The case of the task.
    task
        What to run.
    nudge
        Whether to run the nudged twin too.

    Returns
    -------
    row
        Whatever became of the run.
    error
        What is wrong with the input, where that is why there is no result.
    """
    return _perform(case, task, lambda changed: run(changed, nudge=nudge))


def perform_timed(case: Case, task: Task, *, nudge: bool = False, repeats: int | None = None) -> Row:
    """Make one run of a study, whose march is repeated to tell its cost; parameters as of `perform`."""
    return _perform(case, task, lambda changed: timed_run(changed, nudge=nudge, repeats=repeats))[0]


def _perform(  # noqa: PLR0911 - a way out for each way to end
    case: Case, task: Task, make: Callable[[Case], Result]
) -> tuple[Row, InputError | None]:
    names = task.integrator, task.contact, task.varied
    try:
        changed = case.with_overrides(task.changes) if task.changes else case
    except InputError as error:
        return Row(*names, "failed", str(error), unread=True), error
    try:
        if task.tied:
            changed = case.with_overrides({**task.changes, **_tied(changed)})
        result = make(changed)
    except RefusedPair as error:
        return Row(*names, "refused", error.reason, error.said_by), None
    except _NoTwin as error:
        return Row(*names, "refused", str(error), TIED), None
    except RunError as error:
        return Row(*names, "unstable", str(error), result=error.result), None
    except InputError as error:
        return Row(*names, LOST if isinstance(error, TooLargeError) else "failed", str(error)), error
    except PercussError as error:
        return Row(*names, "failed", str(error)), None
    except Exception as error:  # noqa: BLE001 - whatever a plug-in does costs its own rows alone
        return Row(*names, *blamed(error, case.registry)), None
    reason = "; ".join(note for note in result.summary["notes"] if note.startswith((AGAINST, NOT_VALID)))
    reason = "Ctrl-C" if result.status == "interrupted" else reason
    return Row(*names, result.status, reason, result=result), None


def blamed(error: Exception, registry: Registry) -> tuple[str, str]:
    """Return status and reason of a run that an unexpected error ended: `LOST` unless a plug-in's code raised it."""
    said = f"{type(error).__name__}: {error}"
    files = {source.file for source in registry.sources.values() if source.file}
    packages = {source.module.partition(".")[0] for source in registry.sources.values() if source.distribution}
    in_plugin = any(
        frame.f_code.co_filename in files or str(frame.f_globals.get("__name__")).partition(".")[0] in packages
        for frame, _ in traceback.walk_tb(error.__traceback__)
    )
    if in_plugin and not isinstance(error, ENVIRONMENT):
        return "failed", said
    return LOST, f"the machine or percuss itself failed, which says nothing of the methods: {said}"


class _NoTwin(PercussError):
    """There is no exact solution that says when the twin's interfaces are to be tied."""


def tying_law(registry: Registry) -> type[ContactLaw]:
    """Return the registered contact law that ties its contacts during given intervals.

    Raises
    ------
    PercussError
        If there is none.
    """
    laws: list[Any] = [registry.get("contacts", name) for name in registry.names("contacts")]
    found = [law for law in laws if law.tied_during]
    if not found:
        raise _NoTwin("no contact law is registered that ties its contacts during intervals of time")
    return found[0]  # type: ignore[no-any-return]


def _tied(case: Case) -> dict[str, Any]:
    """Return the changes that tie each contact of a case while the exact one is closed."""
    from percuss.certificate.verdict import settled
    from percuss.results.exact import exact_solution

    law = tying_law(case.registry)
    always = {f"contacts.{name}.method": law.name for name in case.contacts}
    model = settled(case.with_overrides(always) if always else case)
    solution, _, reason = exact_solution(model, (model.steps + 1) * model.dt)
    if solution is None or reason:
        raise _NoTwin(f"nothing says when the exact contact is closed: {reason}")
    return {
        f"contacts.{name}.method": {"name": law.name, law.tied_during: contact.closed}
        for name, contact in solution.contacts.items()
    }
