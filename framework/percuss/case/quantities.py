"""Quantities of a run, recorded over time or summarised as one number: their names, words and units.

`quantities.toml` is the only table of them. Results, NetCDF files, expectations, studies, figures, tables and the
conformance kit take labels and units from here.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from percuss.files import PACKAGE
from percuss.jsonable import Data, Entries


def percent(value: float | None, digits: int = 3) -> str:
    """Return a fraction in per cent, as people read it; a dash where there is no number."""
    if value is None or not math.isfinite(value):
        return "-"
    hundredths = 100.0 * value
    text = f"{hundredths:.{digits}g}"
    return f"{hundredths:.0f} %" if "e+" in text and abs(hundredths) < 1e6 else f"{text} %"


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Description of a quantity of a run.

    Attributes
    ----------
    of
        Entity that the quantity belongs to; a contact state or vector has several values for each contact, and a
        quantity of a support is a vector.
    label
        Plain words for axes and legends of figures and for menus.
    unit
        Unit in words, as for options of methods; ``"1"`` for a number without one.
    short
        Words for the head of a column in a narrow table; `label` where none are given.
    axis
        Times of a history: ``time``, the times t_n, or ``time_half``, those of the energies. None for a quantity that
        is one number a run.
    definition, definition_multistage, definition_exact
        Definition of a history; the second is that in a multi-stage scheme, where it is another, the third that of an
        exact solution that is sampled by itself, empty where it has no such history.
    path
        Dotted path of the number in the summary of a run, in which a star stands for all contacts. Empty for a history
        without such a number, and for a number that is computed from several entries.
    over_contacts
        Reduction of the numbers of the contacts to one number a run.
    metric
        Definition of the one number a run in the table of a study; empty if it is no column by its bare name.
    is_error
        Whether runs are ranked by the number, smaller being better.
    is_fraction
        Whether it is a fraction, which people read in per cent.
    beside
        What a sentence says in brackets beside a value.
    """

    of: Literal[
        "contact", "contact state", "contact vector", "probe", "support", "element", "point", "point vector", "run"
    ] = "run"
    label: str
    unit: str = "1"
    short: str = ""
    axis: Literal["time", "time_half"] | None = None
    definition: str = ""
    definition_multistage: str = ""
    definition_exact: str = ""
    path: str = ""
    over_contacts: Literal["sum", "max"] | None = None
    metric: str = ""
    is_error: bool = False
    is_fraction: bool = False
    beside: str = ""

    def text(self, value: Any, digits: int = 3) -> str:
        """Return a value for readers: a fraction in per cent, a dash where there is none."""
        if self.is_fraction:
            return percent(value, digits)
        return "-" if value is None else f"{value:.{digits}g}" if isinstance(value, float) else str(value)

    @property
    def head(self) -> str:
        """Head of a column in a narrow table."""
        return self.short or self.label

    @property
    def against_exact(self) -> bool:
        """Whether the number compares the run with the exact solution of its case."""
        return self.path.startswith("exact.")

    def of_contact(self, contact: Data) -> Any:
        """Return the number from the entry of one contact in a summary; None if the entry lacks it."""
        return next(values_at(contact, self.path.partition("*.")[2]), None)


# The table itself is data: each entry has the keys of a `Quantity`.
_TABLE = tomllib.loads((PACKAGE / "case" / "quantities.toml").read_text(encoding="utf-8"))
FIELD_COORDINATES: Data = _TABLE.pop("coordinates of fields")  # axes, label and unit of each
QUANTITIES = {name: Quantity(**entry) for name, entry in _TABLE.items()}

# Numbers that the summary of a run has of each contact.
CONTACT_NUMBERS = {name: quantity for name, quantity in QUANTITIES.items() if quantity.path.startswith("contacts.")}
# Quantities that an expectation of a case or a measure of a study may name with an owner or times.
MEASURABLE = {
    name: quantity
    for name, quantity in QUANTITIES.items()
    if (
        quantity.axis is not None
        and quantity.of not in {"element", "point", "point vector", "contact state", "contact vector"}
    )
    or name in CONTACT_NUMBERS
}
# Quantities that are columns of the table of a study by their bare names, in this order.
METRICS = {name: quantity for name, quantity in QUANTITIES.items() if quantity.metric}
TRUE_ERRORS = tuple(name for name, quantity in METRICS.items() if quantity.against_exact and quantity.is_error)


# Errors by two finer runs: where a summary has them, and words for them.
BY_TWO = {
    "estimated.second.": "against the second finer run",
    "estimated.apart.": "of the second finer run against the first",
    "estimated.": "against the first finer run",
}


def by_two(error: str) -> tuple[str, str, str]:
    """Return the paths of an error against the first and the second of two finer runs, and between these two."""
    second, apart, first = (METRICS[error].path.replace("exact.", prefix, 1) for prefix in BY_TWO)
    return first, second, apart


def of_column(name: str) -> Quantity:
    """Return the quantity in a column of the table of a study, which has a name or a path; one without a unit else."""
    found = QUANTITIES.get(name) or METRICS.get(name.rpartition(".")[2]) or Quantity(label=name)
    words = next((words for prefix, words in BY_TWO.items() if name.startswith(prefix)), "")
    return replace(found, label=f"{found.label}, {words}") if words and found.against_exact else found


def ranking(names: Iterable[str]) -> list[str]:
    """Return the columns by which runs are ranked, all of them better when smaller; true errors come first."""
    ranked = [name for name in names if ("error" in name or of_column(name).is_error) and name != "ledger_error"]
    return sorted(ranked, key=lambda name: name.rpartition(".")[2] not in TRUE_ERRORS)


# Columns of the table of a comparison, columns of the table of the best runs of a study, and panels of its figures.
COMPARISON_TABLE = (*TRUE_ERRORS, "peak_force", "penetration", "energy_kept", "energy_max", "steps")
STUDY_TABLE = ("force_error_l2", "impulse_error", "displacement_error", "noise", "energy_growth", "steps")
# Histories by which the conformance kit compares two runs.
COMPARED_BY_KIT = ("contact_force", "gap", "displacement")

JUDGED_BY = "estimated.solution"  # path into the summary: the finer run that judged a run, if one did
# First keys of the dotted paths into the summary of a run, such as `energy.final`.
SUMMARY = (
    "angular_momentum",
    "bodies",
    "certificate",
    "contacts",
    "dt",
    "energy",
    "energy_growth",
    "estimated",
    "exact",
    "exact_reason",
    "momentum",
    "nodes",
    "seconds",
    "stages",
    "steps",
    "stretch",
    "supports",
)

STATISTICS = ("mean", "max", "min", "final", "integral", "value")


# Kinds of units that a case may name, and those that follow from others where it does not.
DERIVED_UNITS = {"stress": "force/length^2", "energy": "force*length"}


def unit_name(unit: str, names: Mapping[str, str]) -> str:
    """Return the name of a unit, as ``N/m²`` for ``force/length^2``; empty where the case does not name all parts."""
    kind = next((kind for kind, parts in DERIVED_UNITS.items() if unit in (kind, parts) and names.get(kind)), None)
    if kind is not None:
        return names[kind]
    parts = DERIVED_UNITS.get(unit, unit)
    if unit in ("", "1") or not all(names.get(part) for part in re.findall("[a-z]+", parts)):
        return ""
    return re.sub("[a-z]+", lambda part: names[part[0]], parts).replace("*", "·").replace("^2", "²").replace("^3", "³")


def with_unit(label: str, unit: str, names: Mapping[str, str]) -> str:
    """Return a label with its unit in brackets, as ``contact force [N]``, where the case names it."""
    name = unit_name(unit, names)
    return f"{label} [{name}]" if name else label


def in_unit(value: float, digits: int, unit: str, names: Mapping[str, str]) -> str:
    """Return a number with the name of its unit, as ``4.8e-07 s``, where the case names it."""
    return f"{value:.{digits}g} {unit_name(unit, names)}".rstrip()


def first_key(path: str, names: Collection[str]) -> tuple[str, str]:
    """Return the first key of a dotted path below which there are `names`, and the rest of the path.

    The names of supports have dots themselves.
    """
    found = [name for name in names if f"{path}.".startswith(f"{name}.")]
    unknown = path.rpartition(".")[0] or path if any("." in name for name in names) else path.partition(".")[0]
    key = max(found, key=len, default=unknown)
    return key, path[len(key) + 1 :]


def values_at(entry: Any, path: str) -> Iterator[Any]:
    """Yield the values at a dotted path into a summary, in which a star stands for all entries."""
    if isinstance(entry, Mapping):
        key, rest = first_key(path, entry)
        for name in entry if key == "*" else [key]:
            yield from values_at(entry.get(name), rest) if rest else [entry.get(name)]


def name_schema(labels: Mapping[str, str]) -> Entries:
    """Return the JSON schema of a name of a quantity, or of a dotted path into the summary of a run.

    Parameters
    ----------
    labels
        The names that an editor offers, each with words for it.
    """
    names = {"enum": list(labels), "enumDescriptions": list(labels.values())}
    return {"anyOf": [names, {"type": "string", "pattern": rf"^({'|'.join(SUMMARY)})(\..+)?$"}]}
