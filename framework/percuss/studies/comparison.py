"""Comparison of methods: a study of one case that stays in memory, with its results; and orders of convergence."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.arguments import expect_methods, expect_names
from percuss.case.case import Case, expect_case
from percuss.case.overrides import as_given_by
from percuss.case.quantities import JUDGED_BY, METRICS, TRUE_ERRORS, by_two
from percuss.errors import InputError
from percuss.jsonable import Entries
from percuss.studies.columns import in_summary, metric
from percuss.studies.layout import combinations
from percuss.studies.perform import Run, perform
from percuss.studies.tasks import tasks, two_references

if TYPE_CHECKING:
    import pandas as pd

REFINED = "refine"
ROUND_OFF = 1e-12  # smaller errors are not discretisation errors


class Comparison(list[Run]):
    """The runs of a comparison.

    Attributes
    ----------
    notes
        Sentences about options of the case that were kept or dropped in other methods.
    """

    def __init__(self, runs: Iterable[Run] = (), notes: Iterable[str] = ()) -> None:
        super().__init__(runs)
        self.notes = list(dict.fromkeys(notes))

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
    laws, points = {name: name for name in contacts}, combinations(vary or {})
    case = two_references(case, laws, points)
    planned = list(tasks({"": case}, {name: name for name in integrators}, laws, points, tied=tied))
    # Mistakes are told as those of the option that gave the value.
    options = {f"method.{option}.name": f"--{option} " for option in ("integrator", "contact")}
    options |= {path: f"--vary {path}=" for path in vary or {}}
    runs: list[Run] = []
    notes, errors, pairs = [*case.notes], list[InputError](), sum(not task.tied for task in planned)
    for task in planned:
        run = perform(case, task)
        if run.status == "interrupted":
            raise KeyboardInterrupt
        if run.error is not None:
            told = as_given_by(options, run.error)
            run = replace(run, reason=str(told))
            errors += [told] if not task.tied else []
            if len(errors) == pairs:
                raise errors[0]
        runs.append(run)
        with contextlib.suppress(InputError):
            notes += task.changed(case).notes
        if progress is not None:
            progress(len(runs), len(planned))
    return Comparison(runs, notes)


def metrics(run: Run) -> Entries:
    """Return the numbers of a run by which runs are compared, as a study has them; empty if there is no result.

    They are the metrics, the time of the march, and where finer runs judge it, which ones and the errors against each.
    """
    if run.result is None:
        return {}
    summary = run.result.summary
    of_judges = [JUDGED_BY, *(path for name in TRUE_ERRORS for path in by_two(name))] if summary["estimated"] else []
    numbers = {name: metric(run.result, name) for name in METRICS} | {"seconds": summary["seconds"]["march"]}
    return numbers | {path: in_summary(summary, path) for path in of_judges}


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
    series: dict[Any, list[Run]] = {}
    for run in runs:
        if REFINED in run.varied and run.status == "done":
            others = tuple((path, value) for path, value in run.varied.items() if path != REFINED)
            series.setdefault((run.integrator, run.contact, others), []).append(run)
    orders_by_method = []
    for (integrator, contact, others), group in series.items() if max(map(len, series.values()), default=0) > 1 else ():
        group.sort(key=lambda run: run.varied[REFINED])
        refine = [run.varied[REFINED] for run in group]
        fitted: Entries = {"integrator": integrator, "contact": contact, **dict(others), "refine": refine}
        for name in TRUE_ERRORS:
            fitted[name] = errors = [metrics(run).get(name) for run in group]
            fitted[f"{name}_order"] = _order(refine, errors)
        orders_by_method.append(fitted)
    return orders_by_method


def _order(refine: list[float], errors: Sequence[float | None]) -> float | None:
    points = [one for one in zip(refine, errors, strict=True) if one[1] is not None and one[1] > ROUND_OFF]
    if len({factor for factor, _ in points}) < 2:
        return None
    factors, values = np.log(np.array(points, dtype=float)).T
    return -float(np.polyfit(factors, values, 1)[0])
