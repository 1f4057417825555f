"""Many runs as a list: every case, pair of methods and point a task, and every task, whatever becomes of it, a row."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from percuss.errors import InputError, PercussError, RefusedPair, RunError
from percuss.runner import AGAINST, NOT_VALID, run

if TYPE_CHECKING:
    from percuss.case import Case
    from percuss.result import Result

TIED = "tied"


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
        ``done``, ``interrupted``, ``unstable``, ``refused`` or ``failed``.
    reason
        Why it is not ``done``; empty if it is.
    said_by
        Which component refused the pair; empty otherwise.
    result
        The result, also of a run that was stopped; None where there was no run.
    """

    integrator: str
    contact: str
    varied: Mapping[str, Any]
    status: str
    reason: str = ""
    said_by: str = ""
    result: Result | None = field(default=None, repr=False)

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
) -> Iterator[Task]:
    """Yield the tasks of one case: every pair with every point, then the tied twin of every integrator and point.

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
    """
    firsts = list(integrators.items()) or [(case.method.integrator.name, None)]
    seconds = list(contacts.items()) or [(case.method.contact.name, None)]
    for (one, first), (two, second) in itertools.product(firsts, seconds):
        changes = {**_change("method.integrator", first), **_change("method.contact", second)}
        for point in points:
            names = _own(point, "method.integrator") or one, _own(point, "method.contact") or two
            yield Task(label, *names, point, {**changes, **point})
    for (one, first), point in itertools.product(firsts, _without_law(points) if tied else ()):
        changes = _change("method.integrator", first)
        yield Task(label, _own(point, "method.integrator") or one, TIED, point, {**changes, **point}, tied=True)


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


def perform(  # noqa: PLR0911 - a way out for each way to end
    case: Case, task: Task, *, nudge: bool = False
) -> tuple[Row, InputError | None]:
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
    names = task.integrator, task.contact, task.varied
    try:
        twin = _tied(case.with_overrides(task.changes) if task.changes else case) if task.tied else {}
        result = run(case, {**task.changes, **twin}, nudge=nudge)
    except RefusedPair as error:
        return Row(*names, "refused", error.reason, error.said_by), None
    except _NoTwin as error:
        return Row(*names, "refused", str(error), TIED), None
    except RunError as error:
        return Row(*names, "unstable", str(error), result=error.result), None
    except InputError as error:
        return Row(*names, "failed", str(error)), error
    except PercussError as error:
        return Row(*names, "failed", str(error)), None
    except Exception as error:  # noqa: BLE001 - whatever a plug-in does costs its own rows alone
        return Row(*names, "failed", f"{type(error).__name__}: {error}"), None
    reason = "; ".join(note for note in result.summary["notes"] if note.startswith((AGAINST, NOT_VALID)))
    reason = "Ctrl-C" if result.status == "interrupted" else reason
    return Row(*names, result.status, reason, result=result), None


class _NoTwin(PercussError):
    """There is no exact solution that says when the twin's interfaces are to be tied."""


def _tied(case: Case) -> dict[str, Any]:
    """Return the changes that tie each contact of a case while the exact one is closed."""
    from percuss.certificate import settled
    from percuss.truth import exact_solution

    always = {f"contacts.{name}.method": TIED for name in case.contacts}
    model = settled(case.with_overrides(always) if always else case)
    solution, _, reason = exact_solution(model, (model.steps + 1) * model.dt)
    if solution is None or reason:
        raise _NoTwin(f"nothing says when the exact contact is closed: {reason}")
    return {
        f"contacts.{name}.method": {"name": TIED, "during": contact.closed}
        for name, contact in solution.contacts.items()
    }
