"""Compare methods on one case: every pair a row, also one that is refused, fails or blows up."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from percuss.errors import InputError, PercussError, Problem, RefusedPair, RunError, suggestion
from percuss.runner import run

if TYPE_CHECKING:
    from percuss.case import Case
    from percuss.result import Result


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


def compare(
    case: Case,
    integrators: Sequence[str] = (),
    contacts: Sequence[str] = (),
    vary: Mapping[str, Sequence[Any]] | None = None,
    *,
    tied: bool = False,
) -> list[Row]:
    """Run every pair of the named integrators and contact laws on one case.

    Parameters
    ----------
    case
        The case; its own integrator or law takes part where none is named.
    integrators, contacts
        Names; options that the case gives and a named law has are kept. A law named here also replaces the contacts'
        own.
    vary
        Values of dotted paths; every combination is run.
    tied
        Whether each integrator also runs with its interfaces tied while the exact contact is closed: the error of the
        bulk alone.

    Returns
    -------
    list of Row
        In the order integrator, law, varied values.

    Raises
    ------
    InputError
        If a name is not registered, or a varied path or value is wrong in every run.
    """
    known = [("integrator", "integrators", integrators), ("contact", "contacts", contacts)]
    problems = [
        Problem(f"--{option}", "", f"unknown {option} '{name}'", suggestion(name, case.registry.names(family)))
        for option, family, names in known
        for name in names
        if name not in case.registry.names(family)
    ]
    if problems:
        raise InputError(problems)
    varied = dict(vary or {})
    if contacts:
        case = case.with_one_law()
    rows: list[Row] = []
    errors: list[InputError] = []
    own: tuple[str | None, ...] = (None,)
    for integrator, contact in itertools.product(integrators or own, contacts or own):
        for values in itertools.product(*varied.values()):
            point = dict(zip(varied, values, strict=True))
            row, error = _row(case, integrator, contact, point)
            rows.append(row)
            errors += [error] if error is not None else []
    if len(errors) == len(rows) and errors:
        raise errors[0]
    return rows + (_twins(case, rows) if tied else [])


def own_laws(case: Case) -> list[str]:
    """Return the contacts whose own law a comparison of laws replaces."""
    return [name for name, contact in case.contacts.items() if contact.own_law]


def _row(
    case: Case,
    integrator: str | None,
    contact: str | None,
    values: Mapping[str, Any],
    *,
    point: Mapping[str, Any] | None = None,
    label: str = "",
) -> tuple[Row, InputError | None]:
    point = values if point is None else point
    changes = {"method.integrator.name": integrator, "method.contact.name": contact}
    changes = {path: name for path, name in changes.items() if name is not None}
    names = (integrator or case.method.integrator.name, label or contact or case.method.contact.name)
    try:
        result = run(case, {**changes, **values})
    except RefusedPair as error:
        return Row(*names, point, "refused", error.reason, error.said_by), None
    except RunError as error:
        return Row(*names, point, "unstable", str(error), result=error.result), None
    except InputError as error:
        return Row(*names, point, "failed", str(error)), error
    except PercussError as error:
        return Row(*names, point, "failed", str(error)), None
    reason = "Ctrl-C" if result.status == "interrupted" else ""
    return Row(*names, point, result.status, reason, result=result), None


def _twins(case: Case, rows: list[Row]) -> list[Row]:
    """Return, for each integrator and varied point, the run with interfaces tied while the exact contact is closed."""
    twins: dict[tuple[str, str], Row] = {}
    for row in rows:
        key = (row.integrator, repr(sorted(row.varied.items())))
        if key in twins or row.result is None or row.result.exact is None:
            continue
        during = {name: contact.closed for name, contact in row.result.exact.contacts.items()}
        methods = {f"contacts.{name}.method": {"name": "tied", "during": spans} for name, spans in during.items()}
        twins[key] = _row(case, row.integrator, None, {**row.varied, **methods}, point=row.varied, label="tied")[0]
    return list(twins.values())


def metrics(row: Row) -> dict[str, Any]:
    """Return what the table of a comparison shows of a row; empty where there is no result."""
    if row.result is None:
        return {}
    summary = row.result.summary
    contacts = summary["contacts"].values()
    energy = summary["energy"]
    put_in = max(energy["initial"], energy["initial"] + energy["external_work"])
    exact = summary["exact"]
    return {
        "impulse": sum(c["impulse"] for c in contacts),
        "peak_force": max((c["peak_force"] for c in contacts), default=0.0),
        "penetration": max((c["penetration"]["largest"] for c in contacts), default=0.0),
        "energy_kept": energy["final"] / put_in if put_in > 0 else None,
        "energy_max": energy["max"] / put_in if put_in > 0 else None,
        "ledger_error": energy["ledger_error"],
        **{name: worst(exact, name) for name in ERRORS},
        "steps": summary["steps"],
        "seconds": summary["seconds"]["march"],
    }


ERRORS = ("force_error_l1", "force_error_l2", "impulse_error", "displacement_error")


def worst(exact: dict[str, Any] | None, name: str) -> float | None:
    """Return an error of a run, that of its worst contact where each contact has one; None where it is not known."""
    if exact is None:
        return None
    if name in exact:
        return exact[name]  # type: ignore[no-any-return]
    known = [c[name] for c in exact["contacts"].values() if c[name] is not None]
    return max(known, default=None)
