"""Columns of the table of a study: their definitions in words, and how their values are taken from a result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args, get_origin, get_type_hints, is_typeddict

import numpy as np

from percuss.case.case import Case
from percuss.case.quantities import CONTACT_NUMBERS, MEASURABLE, METRICS, SUMMARY, first_key, values_at
from percuss.case.specs import MeasureSection
from percuss.case.type_words import branches
from percuss.certificate.verdict import OF_CRITICAL_STEP
from percuss.errors import nearest, suggestion
from percuss.jsonable import Data
from percuss.methods.plugin_calls import answer
from percuss.methods.registry import Registry
from percuss.results.exact import ROUND_OFF
from percuss.results.result import Result
from percuss.results.runner import timed_run
from percuss.results.summary import Summary
from percuss.results.true_error import errors_of_contacts
from percuss.results.verify import CannotMeasure, describe, measure


@dataclass(frozen=True)
class Column:
    """A column of the table of a study.

    Attributes
    ----------
    name
        Name in the table.
    what
        Definition in words: quantity, norm, averaging.
    kind
        ``metric``, ``summary``, ``history`` or ``plug-in``.
    path, section
        Dotted path into the summary; measure of a history.
    """

    name: str
    what: str
    kind: str
    path: str = ""
    section: MeasureSection | None = None

    def take(self, result: Result, registry: Registry) -> Any:
        """Return the value for a result, or None if the result has none."""
        if self.kind == "plug-in":
            component: Any = registry.get("measures", self.name)
            for array in result.arrays.values():  # which the measures after this one read, too
                array.flags.writeable = False
            return answer(component(), "of", result)
        if self.kind == "metric":
            return metric(result, self.name)
        if self.section is None:
            return in_summary(result.summary, self.path)
        try:
            return measure(result, self.section)
        except CannotMeasure:
            return None

    def check(self, names: Mapping[str, Iterable[str]]) -> None:
        """Check that the dotted path leads to a number in the summary of a run that has these ``contacts`` and so on.

        Entries of the certificate and times by name differ between runs: they are not checked.

        Raises
        ------
        ValueError
            With message and advice, if it does not.
        """
        kind: Any = Summary
        part, rest = "", self.path if self.kind == "summary" else ""
        while rest:
            kind, before = next(branches(kind)), part
            known = get_type_hints(kind) if is_typeddict(kind) else {}
            if get_origin(kind) is dict:
                inside = get_args(kind)[1]
                here = ["*", *names[before]] if is_typeddict(inside) else [rest.partition(".")[0]]
                known = dict.fromkeys(here, inside)
            part, rest = first_key(rest, known)
            if part not in known:
                message = f"the summary of a run has no '{self.path.removesuffix(f'.{rest}')}'"
                raise ValueError(message, suggestion(part, known, "entry"))
            kind = known[part]
        if part and (is_typeddict(next(branches(kind))) or get_origin(next(branches(kind))) in (dict, list)):
            raise ValueError(f"{self.name} is not one number", "Name a number in it.")


@dataclass(frozen=True)
class RowSettings:
    """Settings of a study on which each of its rows depends.

    Attributes
    ----------
    columns
        Measured columns.
    nudge
        Whether a nudged twin is run.
    histories
        Largest number of points kept of each history; 0 keeps none.
    repeats
        Number of marches; None for as many as agree.
    """

    columns: tuple[Column, ...]
    nudge: bool
    histories: int
    repeats: int | None

    def run(self, case: Case) -> Result:
        """Return the result of a case, with a repeated march to measure its cost.

        The critical step of a stable run is not searched unless a column asks for it.
        """
        asked = any(column.path in OF_CRITICAL_STEP for column in self.columns)
        return timed_run(case, nudge=self.nudge, repeats=self.repeats, critical_step=asked)


def column_by_name(name: str, registries: Iterable[Registry] = ()) -> Column:
    """Return the column for a bare name: one of `METRICS`, a plug-in, or a dotted path into the summary.

    Raises
    ------
    ValueError
        With message and advice, if it is none of these.
    """
    if name in METRICS:
        return Column(name, METRICS[name].metric, "metric")
    plug_ins = {
        measure_name: registry.get("measures", measure_name)
        for registry in registries
        for measure_name in registry.names("measures")
    }
    if name in plug_ins:
        component: Any = plug_ins[name]
        return Column(name, getattr(component, "what", component.summary), "plug-in")
    parts = name.split(".")
    if parts[0] in SUMMARY:
        several = "; the largest over contacts" if "*" in parts else ""
        return Column(name, f"{name} of the run's summary{several}", "summary", name)
    known_names = [*METRICS, *plug_ins, *SUMMARY]
    close = nearest(name, known_names) or nearest(parts[0], known_names)
    advice = f"Did you mean '{close}'?" if close else f"Known measures: {', '.join(METRICS)}."
    raise ValueError(f"unknown measure '{name}'", advice)


def column(section: MeasureSection, bodies: Sequence[str]) -> Column:
    """Return the column for a measure that is written as a mapping, whose entries suit its quantity.

    Raises
    ------
    ValueError
        With message, advice and key, if there is no such quantity or no such body.
    """
    quantity = MEASURABLE.get(section.quantity)
    if quantity is None:
        base = column_by_name(section.quantity)
        if base.kind != "summary":
            advice = f"Write `- {section.quantity}` instead of a mapping."
            raise ValueError(f"{section.quantity} is a measure by itself", advice, "quantity")
        return replace(base, name=section.name)
    if section.probe is not None and section.probe.body not in bodies:
        advice = suggestion(str(section.probe), bodies)
        raise ValueError(f"there is no body '{section.probe.body}'", advice, "probe")
    axis = f", component {section.component}" if quantity.of in ("probe", "support") else ""
    return Column(section.name, f"{describe(section)}{axis}", "history", section=section)


def in_summary(summary: Data, path: str) -> Any:
    """Return the largest value at a path, or a single value of any type; None, mappings and lists do not count."""
    values = (value for value in values_at(summary, path) if value is not None)
    scalars = [value for value in values if not isinstance(value, Mapping | list)]
    return max(scalars, default=None) if len(scalars) > 1 else (scalars[0] if scalars else None)


def metric(result: Result, name: str) -> Any:
    """Return the value of a column of `METRICS` for a result, or None if the result has none."""
    summary, quantity = result.summary, METRICS[name]
    if not quantity.path:
        return _computed(summary, name)
    values = list(values_at(summary, quantity.path))
    if quantity.against_exact:
        errors: Any = summary["exact"] or summary.get("estimated") or {}
        # Of two finer runs that against which the error is larger: it does not favour the methods of either.
        judges = [one for one in (errors, errors.get("second") if quantity.is_error else None) if one]
        values = [one.get(name) for one in judges]
        if "*" in quantity.path:
            values = [value for one in judges for value in errors_of_contacts(summary, one, name).values()]
    values = [value for value in values if value is not None]
    if name == "penetration":
        moved = float(np.abs(result.arrays["displacement"]).max(initial=0.0))
        values = [value if value > ROUND_OFF * moved else 0.0 for value in values]
    if quantity.over_contacts == "sum":
        return sum(values)
    # The force and the overlap of a run without contacts are zero; an error that no contact has is not known.
    return max(values, default=0.0 if name in CONTACT_NUMBERS else None)


def _computed(summary: Summary, name: str) -> float | None:
    """Return a metric that is computed from several entries of a summary, or None if it is not known."""
    if name == "node_steps":
        return int(summary["steps"] * summary.get("stages", 1) * summary["nodes"])
    energy = summary["energy"]
    if energy.get("ledger_closed") is False:
        return None  # with an open ledger the difference of energies is no loss
    # Relative to the energy put in, not to that at the end: a bar thrown upwards has none left where it turns.
    put_in = energy["initial"] + (energy["external_work_max"] or 0.0)
    gained = energy["contact_work_max"]
    if name == "energy_kept":
        gained = energy["final"] - energy["initial"] - energy["external_work"]
    return 1.0 + float(gained) / put_in if put_in > 0 else None
