"""The columns of a study's table: what each is, in words, and how it is taken from a result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from percuss.case.quantities import QUANTITIES, SUMMARY
from percuss.errors import nearest, suggestion
from percuss.results.measures import CannotMeasure, measure

if TYPE_CHECKING:
    from percuss.methods.registry import Registry
    from percuss.results.result import Result
    from percuss.studies.layout import MeasureSection

__all__ = ["ERRORS", "METRICS", "Column", "column", "metric", "named", "worst"]

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
    """One column of a study's table.

    Attributes
    ----------
    name
        As in the table.
    what
        In words: quantity, norm, averaging.
    kind
        ``metric``, ``summary``, ``history`` or ``plug-in``.
    arguments
        Of what takes it: a dotted path, or those of `percuss.results.measures.measure`.
    """

    name: str
    what: str
    kind: str
    arguments: tuple[tuple[str, Any], ...] = ()

    def take(self, result: Result, registry: Registry) -> Any:
        """Return the value, None where this result has none."""
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
        """Return where a dotted path leaves a summary and the advice; None where it does not."""
        if self.kind != "summary":
            return None
        here: Any = summary
        parts = str(dict(self.arguments)["path"]).split(".")
        for n, part in enumerate(parts):
            if here is None:
                return None  # of a case that has no exact solution, or no such number
            if part == "*" and isinstance(here, Mapping):
                here = next(iter(here.values()), None)
            elif isinstance(here, Mapping) and part in here:
                here = here[part]
            else:
                known = list(here) if isinstance(here, Mapping) else []
                return ".".join(parts[: n + 1]), suggestion(part, known, "entry")
        return ("", "Name a number in it.") if isinstance(here, Mapping | list) else None


def named(name: str, registries: Iterable[Registry] = ()) -> Column:
    """Return the column that a bare name stands for: one of `METRICS`, a plug-in, or a dotted path into the summary.

    Raises
    ------
    ValueError
        With message and advice, if it is neither.
    """
    if name in METRICS:
        return Column(name, METRICS[name], "metric")
    plugged = {one: registry.get("measures", one) for registry in registries for one in registry.names("measures")}
    if name in plugged:
        told: Any = plugged[name]
        return Column(name, getattr(told, "what", told.summary), "plug-in")
    parts = name.split(".")
    if parts[0] in SUMMARY:
        several = "; the largest over contacts" if "*" in parts else ""
        return Column(name, f"{name} of the run's summary{several}", "summary", (("path", name),))
    known = [*METRICS, *plugged, *SUMMARY]
    close = nearest(name, known) or nearest(parts[0], known)
    advice = f"Did you mean '{close}'?" if close else f"Known measures: {', '.join(METRICS)}."
    raise ValueError(f"unknown measure '{name}'", advice)


def column(section: MeasureSection, contacts: Sequence[str], bodies: Sequence[str]) -> Column:
    """Return the column that a measure written out stands for.

    Raises
    ------
    ValueError
        With message, advice and key, if quantity, owner and statistic do not go together.
    """
    quantity = QUANTITIES.get(section.quantity)
    if quantity is None:
        base = named(section.quantity)
        return Column(section.name, base.what, base.kind, base.arguments) if base.kind == "summary" else _bare(section)
    of = {"contact": section.contact, "probe": section.probe}
    for owner, given in of.items():
        if given is not None and quantity.of != owner:
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
    whose = section.contact or section.probe or ""
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
    words = f"{taken}{section.quantity}{' of ' + whose if whose else ''}{axis}{when}"
    return Column(section.name, words, "history", tuple(arguments.items()))


def _bare(section: MeasureSection) -> Column:
    raise ValueError(
        f"{section.quantity} is a measure by itself", f"Write `- {section.quantity}` instead of a mapping.", "quantity"
    )


def _values(here: Any, path: list[str]) -> Iterator[Any]:
    """Yield what stands at a dotted path; a star stands for every entry."""
    if not path:
        yield here
    elif isinstance(here, Mapping):
        for key in here if path[0] == "*" else [path[0]]:
            yield from _values(here.get(key), path[1:])


def _largest(found: list[Any]) -> Any:
    known = [one for one in found if one is not None and not isinstance(one, Mapping | list)]
    return max(known, default=None) if len(known) > 1 else (known[0] if known else None)


def worst(exact: dict[str, Any] | None, name: str) -> float | None:
    """Return an error of a run, that of its worst contact where each contact has one; None where it is not known."""
    if exact is None:
        return None
    if name in exact:
        return exact[name]  # type: ignore[no-any-return]
    known = [c[name] for c in exact["contacts"].values() if c[name] is not None]
    return max(known, default=None)


def metric(result: Result, name: str) -> Any:
    """Return one of `METRICS` of a result."""
    take = _METRIC.get(name)
    return take(result.summary) if take is not None else worst(result.summary["exact"], name)


def _of_contacts(summary: Mapping[str, Any], name: str) -> list[Any]:
    return [one[name] for one in summary["contacts"].values()]


def _share(name: str) -> Callable[[Mapping[str, Any]], float | None]:
    def share(summary: Mapping[str, Any]) -> float | None:
        # not over what is there at the end: a bar thrown up has none left where it turns
        energy = summary["energy"]
        if energy.get("ledger_closed") is False:
            return None  # then what the contacts took is not what is missing
        put_in = energy["initial"] + (energy["external_work_max"] or 0.0)
        return 1.0 + energy[name] / put_in if put_in > 0 else None

    return share


_METRIC: dict[str, Callable[[Mapping[str, Any]], Any]] = {
    "impulse": lambda s: sum(_of_contacts(s, "impulse")),
    "peak_force": lambda s: max(_of_contacts(s, "peak_force"), default=0.0),
    "penetration": lambda s: max((one["largest"] for one in _of_contacts(s, "penetration")), default=0.0),
    "energy_kept": _share("contact_work"),
    "energy_max": _share("contact_work_max"),
    "ledger_error": lambda s: s["energy"]["ledger_error"],
    "energy_growth": lambda s: _growth(s["energy_growth"]),
    "steps": lambda s: s["steps"],
    "node_steps": lambda s: s["steps"] * s["nodes"],
}


def _growth(told: Any) -> Any:
    return told.get("largest") if isinstance(told, Mapping) else told
