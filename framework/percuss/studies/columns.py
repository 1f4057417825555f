"""Columns of the table of a study: their definitions in words, and how their values are taken from a result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from percuss.case.quantities import QUANTITIES, SUMMARY
from percuss.errors import nearest, suggestion
from percuss.results.measures import CannotMeasure, measure

if TYPE_CHECKING:
    from percuss.methods.registry import Registry
    from percuss.results.result import Result
    from percuss.results.summary import ExactErrors, Summary
    from percuss.studies.layout import MeasureSection

__all__ = ["ERRORS", "METRICS", "Column", "column", "column_by_name", "metric", "worst"]

ERRORS = ("force_error_l1", "force_error_l2", "impulse_error", "displacement_error")

_EXACT = "; of the worst contact"
METRICS = {
    "impulse": "sum over contacts of the impulse, step times the force at t_n added up",
    "peak_force": "largest contact force at any t_n, of the contact with the largest",
    "penetration": "largest overlap at any t_n, of the contact with the largest",
    "energy_kept": "1 + work of the contacts over the largest energy put in: at first, and by loads so far",
    "energy_max": "1 + largest work of the contacts so far over the largest energy put in",
    "ledger_error": "largest closure of the energy ledger over the largest energy so far",
    "energy_growth": "largest rise of energy with what contacts store above its smallest, over the largest energy",
    "force_error_l1": "L1 norm of force less exact force over that of the exact, both averaged over each step" + _EXACT,
    "force_error_l2": "L2 norm of force less exact force over that of the exact, both averaged over each step" + _EXACT,
    "impulse_error": "largest error of the cumulative impulse over the largest exact one" + _EXACT,
    "displacement_error": "L2 norm over all bars of the displacement's error at the end, relative",
    "noise": "total variation of the force over that of the exact force, both averaged over each step" + _EXACT,
    "overshoot": "peak force over the exact peak, averaged over each step, less one" + _EXACT,
    "steps": "number of steps",
    "node_steps": "number of steps times number of nodes: the cost, whatever the machine; stages are not counted",
}


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
    arguments
        Dotted path into the summary, or arguments of `percuss.results.measures.measure`.
    """

    name: str
    what: str
    kind: str
    arguments: tuple[tuple[str, Any], ...] = ()

    def take(self, result: Result, registry: Registry) -> Any:
        """Return the value for a result, or None if the result has none."""
        arguments = dict(self.arguments)
        if self.kind == "plug-in":
            component: Any = registry.get("measures", self.name)
            return component().of(result)
        if self.kind == "metric":
            return metric(result, self.name)
        if self.kind == "summary":
            return _largest(list(_values(result.summary, arguments["path"].split("."))))
        try:
            return measure(result, **arguments)
        except CannotMeasure:
            return None

    def unknown_to(self, summary: Mapping[str, Any]) -> tuple[str, str] | None:
        """Return the beginning of the dotted path that a summary lacks and the advice, or None if the path is in it.

        The beginning is empty if the path ends at a group of entries, not at a number.
        """
        if self.kind != "summary":
            return None
        entry: Any = summary
        parts = str(dict(self.arguments)["path"]).split(".")
        for n, part in enumerate(parts):
            if entry is None:
                return None  # the case has no exact solution, or no such number
            if part == "*" and isinstance(entry, Mapping):
                entry = next(iter(entry.values()), None)
            elif isinstance(entry, Mapping) and part in entry:
                entry = entry[part]
            else:
                keys = list(entry) if isinstance(entry, Mapping) else []
                return ".".join(parts[: n + 1]), suggestion(part, keys, "entry")
        return ("", "Name a number in it.") if isinstance(entry, Mapping | list) else None


def column_by_name(name: str, registries: Iterable[Registry] = ()) -> Column:
    """Return the column for a bare name: one of `METRICS`, a plug-in, or a dotted path into the summary.

    Raises
    ------
    ValueError
        With message and advice, if it is none of these.
    """
    if name in METRICS:
        return Column(name, METRICS[name], "metric")
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
        return Column(name, f"{name} of the run's summary{several}", "summary", (("path", name),))
    known_names = [*METRICS, *plug_ins, *SUMMARY]
    close = nearest(name, known_names) or nearest(parts[0], known_names)
    advice = f"Did you mean '{close}'?" if close else f"Known measures: {', '.join(METRICS)}."
    raise ValueError(f"unknown measure '{name}'", advice)


def column(section: MeasureSection, contacts: Sequence[str], bodies: Sequence[str]) -> Column:
    """Return the column for a measure that is written as a mapping.

    Raises
    ------
    ValueError
        With message, advice and key, if quantity, owner and statistic do not go together.
    """
    quantity = QUANTITIES.get(section.quantity)
    if quantity is None:
        base = column_by_name(section.quantity)
        return (
            Column(section.name, base.what, base.kind, base.arguments)
            if base.kind == "summary"
            else _refuse_mapping(section)
        )
    owners = {"contact": section.contact, "probe": section.probe}
    for owner, owner_name in owners.items():
        if owner_name is not None and quantity.of != owner:
            raise ValueError(f"{section.quantity} belongs to no {owner}", f"Remove `{owner}:`.", owner)
    if quantity.of == "probe" and section.probe is None:
        raise ValueError(f"missing (whose {section.quantity})", "Add `probe:` with an end.", "probe")
    if section.contact is not None and section.contact not in contacts:
        raise ValueError(f"there is no contact '{section.contact}'", suggestion(section.contact, contacts), "contact")
    if section.probe is not None and section.probe.partition(".")[0] not in bodies:
        raise ValueError(
            f"there is no body '{section.probe.partition('.')[0]}'", suggestion(section.probe, bodies), "probe"
        )
    if quantity.kind == "history" and section.take == "value" and section.at is None:
        raise ValueError("missing (the time of the value)", "Add `at:`, or `take: mean` or the like.", "at")
    if quantity.kind == "scalar" and section.take != "value":
        raise ValueError(f"{section.quantity} is one number a run, it has no {section.take}", "Remove `take:`.", "take")
    if section.at is not None and section.during is not None:
        raise ValueError("has both `during` and `at`", "Keep one.", "at")
    subject = section.contact or section.probe or ""
    axis = f", component {section.component}" if quantity.of == "probe" else ""
    when = (
        f" from {section.during[0]:g} to {section.during[1]:g}"
        if section.during
        else f" at {section.at:g}"
        if section.at is not None
        else ""
    )
    taken = f"{section.take} of " if section.take != "value" else ""
    arguments = {
        "quantity": section.quantity,
        "contact": section.contact,
        "probe": section.probe,
        "component": section.component,
        "during": section.during,
        "at": section.at,
        "statistic": section.take,
    }
    words = f"{taken}{section.quantity}{' of ' + subject if subject else ''}{axis}{when}"
    return Column(section.name, words, "history", tuple(arguments.items()))


def _refuse_mapping(section: MeasureSection) -> Column:
    """Raise ValueError: a metric is written as its bare name, not as a mapping."""
    raise ValueError(
        f"{section.quantity} is a measure by itself", f"Write `- {section.quantity}` instead of a mapping.", "quantity"
    )


def _values(entry: Any, path: list[str]) -> Iterator[Any]:
    """Yield the values at a dotted path, in which a star stands for all entries."""
    if not path:
        yield entry
    elif isinstance(entry, Mapping):
        for key in entry if path[0] == "*" else [path[0]]:
            yield from _values(entry.get(key), path[1:])


def _largest(values: list[Any]) -> Any:
    """Return the largest value, or a single value of any type; None, mappings and lists do not count."""
    scalars = [value for value in values if value is not None and not isinstance(value, Mapping | list)]
    return max(scalars, default=None) if len(scalars) > 1 else (scalars[0] if scalars else None)


def worst(exact: ExactErrors | None, name: str) -> float | None:
    """Return a true error of a run, the largest if each contact has its own, or None if it is not known."""
    if exact is None:
        return None
    if name in exact:
        return exact[name]  # type: ignore[literal-required, no-any-return]
    errors: list[float | None] = [contact[name] for contact in exact["contacts"].values()]  # type: ignore[literal-required]
    return max((error for error in errors if error is not None), default=None)


def metric(result: Result, name: str) -> Any:
    """Return the value of a column of `METRICS` for a result."""
    take = _METRIC.get(name)
    return take(result.summary) if take is not None else worst(result.summary["exact"], name)


def _energy_share(name: Literal["contact_work", "contact_work_max"]) -> Callable[[Summary], float | None]:
    def share(summary: Summary) -> float | None:
        # Relative to the energy put in, not to that at the end: a bar thrown upwards has none left where it turns.
        energy = summary["energy"]
        if energy.get("ledger_closed") is False:
            return None  # with an open ledger the contact work is not the energy lost
        put_in = energy["initial"] + (energy["external_work_max"] or 0.0)
        return 1.0 + energy[name] / put_in if put_in > 0 else None

    return share


_METRIC: dict[str, Callable[[Summary], Any]] = {
    "impulse": lambda s: sum(contact["impulse"] for contact in s["contacts"].values()),
    "peak_force": lambda s: max((contact["peak_force"] for contact in s["contacts"].values()), default=0.0),
    "penetration": lambda s: max(
        (contact["penetration"]["largest"] for contact in s["contacts"].values()), default=0.0
    ),
    "energy_kept": _energy_share("contact_work"),
    "energy_max": _energy_share("contact_work_max"),
    "ledger_error": lambda s: s["energy"]["ledger_error"],
    "energy_growth": lambda s: _largest_growth(s["energy_growth"]),
    "steps": lambda s: s["steps"],
    "node_steps": lambda s: s["steps"] * s["nodes"],
}


def _largest_growth(growth: Any) -> Any:
    return growth.get("largest") if isinstance(growth, Mapping) else growth
