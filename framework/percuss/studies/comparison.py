"""Comparison of methods on one case: a run for each pair, also a refused or unstable one; and orders of convergence."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.arguments import expect_methods, expect_names
from percuss.case.case import Case, expect_case
from percuss.case.overrides import as_given_by
from percuss.case.quantities import METRICS, TRUE_ERRORS
from percuss.errors import InputError, PercussError
from percuss.jsonable import Entries
from percuss.studies.columns import metric
from percuss.studies.parameters import combinations
from percuss.studies.perform import Run, perform
from percuss.studies.tasks import Task, tasks
from percuss.studies.two_references import two_references

if TYPE_CHECKING:
    import pandas as pd


class Comparison(list[Run]):
    """The runs of a comparison."""

    @property
    def table(self) -> pd.DataFrame:
        """The runs as a table: their methods, varied values, status and reason, and the numbers to compare them by."""
        import pandas as pd

        shown = ("integrator", "contact", "status", "reason")
        return pd.DataFrame(
            [{**{name: getattr(run, name) for name in shown}, **run.varied, **metrics(run)} for run in self]
        )

    def __repr__(self) -> str:
        return "\n".join(f"{run.label}: {run.status}" for run in self)


def compare(
    case: Case,
    integrators: Sequence[str] = (),
    contacts: Sequence[str] = (),
    vary: Mapping[str, Sequence[object]] | None = None,
    *,
    tied: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Run every pair of the named integrators and contact laws on one case.

    Parameters
    ----------
    case
        The case; its own integrator or law is used where none is named.
    integrators, contacts
        Names of methods; options of the case that a named method has too are kept. A law named here also replaces the
        contacts' own.
    vary
        Values of dotted paths; every combination is run.
    tied
        Whether each integrator also runs with its interfaces tied while the exact contact is closed, which shows the
        error of the bulk alone.
    progress
        Called with (runs made, runs in all).

    Returns
    -------
    Comparison
        A list of the runs in the order integrator, law, varied values; the tied runs come last. Its ``table`` is a
        pandas DataFrame with a row for each.

    Raises
    ------
    InputError
        If a name is not registered, or a varied path or value is wrong in every run.
    """
    expect_case("percuss.compare", case, many=True, vary=vary)
    expect_names("percuss.compare", "integrators", integrators)
    expect_names("percuss.compare", "contacts", contacts)
    expect_methods(case.registry, integrators, contacts)
    if contacts:
        case = case.with_one_law()
    methods = {name: name for name in integrators}, {name: name for name in contacts}
    axes = vary or {}
    points = combinations(axes)
    case = two_references(case, methods[1], points)
    planned = list(tasks("", case, *methods, points, tied=tied))
    used = {path for task in planned for path in task.varied}
    if any(path not in used for point in points for path in point):  # no pair has such an option: let the runs say so
        planned = list(tasks("", case, *methods, points, tied=tied, strict=True))
    pairs = [task for task in planned if not task.tied]
    outcomes = []
    for task in pairs:
        outcomes.append(_perform(case, task, axes))
        if progress is not None:
            progress(len(outcomes), len(planned))
    errors = [error for _, error in outcomes if error is not None]
    if errors and len(errors) == len(pairs):
        raise errors[0]
    return Comparison([run for run, _ in outcomes] + [_perform(case, task, axes)[0] for task in planned if task.tied])


def _perform(case: Case, task: Task, vary: Mapping[str, Sequence[object]]) -> tuple[Run, InputError | None]:
    """Make the run of a task; mistakes are told as those of the option that gave the value."""
    run, error = perform(case, task)
    if run.status == "interrupted":
        raise KeyboardInterrupt
    if error is None:
        return run, None
    given = {f"method.{option}.name": f"--{option} " for option in ("integrator", "contact")}
    told = as_given_by({**given, **{path: f"--vary {path}=" for path in vary}}, error)
    return replace(run, reason=str(told)), told


def notes_of_swaps(
    case: Case,
    integrators: Sequence[str] = (),
    contacts: Sequence[str] = (),
    vary: Mapping[str, Sequence[object]] | None = None,
) -> list[str]:
    """Return notes on the options of the methods of a case that a comparison keeps or drops in other methods.

    Parameters
    ----------
    case, integrators, contacts, vary
        As for `compare`; varied options are not mentioned.
    """
    case = case.with_one_law() if contacts else case
    first_values = {path: values[0] for path, values in (vary or {}).items() if values}
    notes = list(case.notes)
    for family, names in (("integrator", integrators), ("contact", contacts)):
        for name in names:
            with contextlib.suppress(PercussError):  # the run itself reports the mistake
                notes += case.with_overrides({f"method.{family}.name": name, **first_values}).notes
    return list(dict.fromkeys(notes))


def own_laws(case: Case) -> list[str]:
    """Return the names of the contacts whose own law is replaced by a comparison of laws."""
    return [name for name, contact in case.contacts.items() if contact.own_law]


def metrics(run: Run) -> Entries:
    """Return the numbers of a run by which runs are compared; empty if there is no result."""
    if run.result is None:
        return {}
    seconds = run.result.summary["seconds"]["march"]
    return {**{name: metric(run.result, name) for name in METRICS}, "seconds": seconds}


REFINED = "refine"
ROUND_OFF = 1e-12  # smaller errors are not discretisation errors


def orders(runs: list[Run]) -> list[Entries]:
    """Return the observed order of each error for each method, fitted over the values of ``refine``.

    Parameters
    ----------
    runs
        Runs of a comparison that varies ``refine``.

    Returns
    -------
    list of dict
        ``integrator``, ``contact``, the other varied values, and for each error its order (None where fewer than two
        meshes have an error above round-off) and the errors themselves; empty if no method ran on two meshes.
    """
    orders_by_method = []
    runs_by_method = _runs_by_method(runs)
    for key, series in runs_by_method.items() if any(len(series) > 1 for series in runs_by_method.values()) else ():
        fitted: Entries = {"integrator": key[0], "contact": key[1], **dict(key[2])}
        fitted["refine"] = [run.varied[REFINED] for run in series]
        for name in TRUE_ERRORS:
            errors = [metrics(run).get(name) for run in series]
            fitted[name] = errors
            fitted[f"{name}_order"] = _order(fitted["refine"], errors)
        orders_by_method.append(fitted)
    return orders_by_method


def _runs_by_method(runs: list[Run]) -> dict[Any, list[Run]]:
    """Return the runs of each method that differ by mesh alone, from coarse to fine."""
    series: dict[Any, list[Run]] = {}
    for run in runs:
        if REFINED in run.varied and run.status == "done":
            others = tuple((path, value) for path, value in run.varied.items() if path != REFINED)
            series.setdefault((run.integrator, run.contact, others), []).append(run)
    return {key: sorted(group, key=lambda run: run.varied[REFINED]) for key, group in series.items()}


def _order(refine: list[float], errors: Sequence[float | None]) -> float | None:
    points = [
        (factor, error) for factor, error in zip(refine, errors, strict=True) if error is not None and error > ROUND_OFF
    ]
    if len({factor for factor, _ in points}) < 2:
        return None
    slope = np.polyfit(np.log([factor for factor, _ in points]), np.log([error for _, error in points]), 1)[0]
    return float(-slope)
