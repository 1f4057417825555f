"""Quantities of a run, recorded over time or summarised as one number: the only table of their names, words and units.

Results, NetCDF files, expectations, studies, figures, tables and the conformance kit take labels and units from here.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal


def percent(value: float | None, digits: int = 3) -> str:
    """Return a fraction in per cent, as people read it; a dash where there is no number."""
    if value is None or not math.isfinite(value):
        return "-"
    hundredths = 100.0 * value
    return f"{hundredths:.{digits}g} %" if not 10.0**digits <= abs(hundredths) < 1e6 else f"{hundredths:.0f} %"


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Description of a quantity of a run.

    Attributes
    ----------
    of
        Entity that the quantity belongs to; a contact state has several values for each contact.
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
    """

    of: Literal["contact", "contact state", "probe", "element", "run"] = "run"
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

    def of_contact(self, contact: Mapping[str, Any]) -> Any:
        """Return the number from the entry of one contact in a summary; None if the entry lacks it."""
        return next(values_at(contact, self.path.partition("*.")[2]), None)


_WORST = "; of the worst contact"

QUANTITIES: dict[str, Quantity] = {
    # ------------------------------------------------------------------------------------------------- histories
    "contact_force": Quantity(
        of="contact",
        label="contact force",
        unit="force",
        axis="time",
        definition="contact force that moves the mass, compression positive",
        definition_multistage="mean contact force from t_n to t_n+1, compression positive",
        definition_exact="exact contact force, compression positive",
    ),
    "contact_force_end": Quantity(
        of="contact",
        label="penalty force at the end of the step",
        unit="force",
        axis="time",
        definition="penalty force at the end of the step, evaluated at t_n+1",
    ),
    "contact_force_exact": Quantity(
        of="contact",
        label="exact contact force",
        unit="force",
        axis="time",
        definition="exact contact force, averaged over the step around t_n",
        definition_multistage="exact contact force, averaged from t_n to t_n+1",
    ),
    "gap": Quantity(
        of="contact",
        label="gap",
        unit="length",
        axis="time",
        definition="gap at t_n, open positive",
        definition_exact="exact gap, open positive",
    ),
    "gap_exact": Quantity(of="contact", label="exact gap", unit="length", axis="time", definition="exact gap at t_n"),
    "displacement": Quantity(
        of="probe",
        label="displacement",
        unit="length",
        axis="time",
        definition="displacement at t_n",
        definition_exact="exact displacement",
    ),
    "velocity": Quantity(
        of="probe",
        label="velocity",
        unit="length/time",
        axis="time",
        definition="velocity at t_n, mean of n-1/2 and n+1/2",
        definition_multistage="velocity at t_n",
        definition_exact="exact velocity",
    ),
    "kinetic_energy": Quantity(
        label="kinetic energy",
        short="kinetic",
        unit="energy",
        axis="time_half",
        definition="kinetic energy at t_n+1/2",
        definition_multistage="kinetic energy at t_n+1",
        definition_exact="exact kinetic energy",
    ),
    "elastic_energy": Quantity(
        label="elastic energy",
        short="elastic",
        unit="energy",
        axis="time_half",
        definition="staggered strain energy at t_n+1/2",
        definition_multistage="strain energy at t_n+1",
        definition_exact="exact strain energy",
    ),
    "internal_work": Quantity(
        label="internal work",
        unit="energy",
        axis="time_half",
        definition="work of the internal forces of all bodies up to t_n+1/2, where one of them is not linear "
        "or the scheme is viscous",
    ),
    "dissipated_energy": Quantity(
        label="energy dissipated in bodies",
        unit="energy",
        axis="time_half",
        definition="energy that the materials of bodies say they have dissipated up to t_n; of a viscous "
        "or implicit scheme the internal work up to t_n+1/2 that the bodies do not store",
    ),
    "external_work": Quantity(
        label="external work",
        unit="energy",
        axis="time_half",
        definition="work of loads, supports and drives up to t_n+1/2",
        definition_multistage="work of loads, supports and drives up to t_n+1",
        definition_exact="work of loads, supports and drives",
    ),
    "contact_work": Quantity(
        label="contact work",
        unit="energy",
        axis="time_half",
        definition="work of the contact forces up to t_n+1/2",
        definition_multistage="work of the contact forces up to t_n+1",
    ),
    "contact_energy": Quantity(
        label="energy stored in contacts",
        unit="energy",
        axis="time_half",
        definition="energy that closed contacts store at t_n+1/2",
        definition_multistage="energy that the laws of contacts say they store at t_n+1; of other laws nothing",
    ),
    "contact_dissipation": Quantity(
        label="energy dissipated by contacts",
        unit="energy",
        axis="time_half",
        definition="energy that the laws of contacts say they have dissipated up to t_n+1/2",
        definition_multistage="energy that the laws of contacts say they have dissipated up to t_n+1",
    ),
    "contact_state": Quantity(
        of="contact state",
        label="state variables of contacts",
        unit="",  # each law has its own
        axis="time_half",
        definition="state variables of the law of each contact after the step from t_n",
    ),
    "energy": Quantity(
        label="energy", unit="energy", axis="time_half", definition="kinetic and elastic energy together"
    ),
    "energy_error": Quantity(
        label="closure of the energy ledger over time",
        axis="time_half",
        definition="closure of the energy ledger over the largest energy so far",
        definition_multistage=(
            "energy less all work, over the largest energy so far: what the scheme itself gains or loses"
        ),
        definition_exact="energies less external work, over the largest energy so far: round-off of the solution",
        is_fraction=True,
    ),
    "stress": Quantity(
        of="element", label="stress", unit="force/length^2", axis="time", definition="stress in the element"
    ),
    # ---------------------------------------------------------------------------------------- numbers of the contacts
    "impulse": Quantity(
        of="contact",
        label="impulse",
        unit="force*time",
        path="contacts.*.impulse",
        over_contacts="sum",
        metric="sum over contacts of the impulse, step times the force at t_n added up",
    ),
    "peak_force": Quantity(
        of="contact",
        label="peak force",
        unit="force",
        path="contacts.*.peak_force",
        over_contacts="max",
        metric="largest contact force at any t_n, of the contact with the largest",
    ),
    "first_closed": Quantity(
        of="contact", label="time of the first closing", short="closed at", unit="time", path="contacts.*.first_closed"
    ),
    "last_open": Quantity(
        of="contact", label="time of the last opening", short="open at", unit="time", path="contacts.*.last_open"
    ),
    "closed_time": Quantity(
        of="contact", label="time in contact", short="closed for", unit="time", path="contacts.*.closed_time"
    ),
    "penetration": Quantity(
        of="contact",
        label="largest penetration",
        short="penetration",
        unit="length",
        path="contacts.*.penetration.largest",
        over_contacts="max",
        metric="largest overlap at any t_n, or stage of a step, of the contact with the largest",
        is_error=True,
    ),
    # --------------------------------------------------------------------------------------------- numbers of the run
    "energy_kept": Quantity(
        label="energy kept at the end",
        short="energy kept",
        metric="1 + what contacts, scheme and materials add to the energy, over the largest energy put in: at first, "
        "and by loads so far",
        is_fraction=True,
    ),
    "energy_max": Quantity(
        label="largest energy",
        metric="1 + largest work of the contacts so far over the largest energy put in",
        is_fraction=True,
    ),
    "ledger_error": Quantity(
        label="closure of the energy ledger",
        path="energy.ledger_error",
        metric="largest closure of the energy ledger over the largest energy so far",
        is_error=True,
        is_fraction=True,
    ),
    "energy_growth": Quantity(
        label="growth of energy",
        axis="time_half",
        definition="growth of contact work with contact energy since the first step over the largest energy so far",
        definition_multistage="growth of contact work since the first step over the largest energy so far",
        path="energy_growth.largest",
        metric="largest rise of energy with what contacts store above its smallest, over the largest energy",
        is_error=True,
        is_fraction=True,
    ),
    "courant_critical": Quantity(label="critical Courant number", path="certificate.courant_critical"),
    # ------------------------------------------------------------------------------- errors against the exact solution
    "force_error_l1": Quantity(
        of="contact",
        label="force error, L1",
        short="force L1",
        path="exact.contacts.*.force_error_l1",
        over_contacts="max",
        metric="L1 norm of force less exact force over that of the exact, both averaged over each step" + _WORST,
        is_error=True,
        is_fraction=True,
    ),
    "force_error_l2": Quantity(
        of="contact",
        label="force error, L2",
        short="force L2",
        path="exact.contacts.*.force_error_l2",
        over_contacts="max",
        metric="L2 norm of force less exact force over that of the exact, both averaged over each step" + _WORST,
        is_error=True,
        is_fraction=True,
    ),
    "impulse_error": Quantity(
        of="contact",
        label="error of the cumulative impulse",
        short="impulse",
        path="exact.contacts.*.impulse_error",
        over_contacts="max",
        metric="largest error of the cumulative impulse over the largest exact one" + _WORST,
        is_error=True,
        is_fraction=True,
    ),
    "displacement_error": Quantity(
        label="displacement error, L2",
        short="displ.",
        path="exact.displacement_error",
        metric="L2 norm over all bars of the displacement's error at the end, relative",
        is_error=True,
        is_fraction=True,
    ),
    "noise": Quantity(
        of="contact",
        label="noise of the force",
        short="noise",
        path="exact.contacts.*.noise",
        over_contacts="max",
        metric="total variation of the force over that of the exact force, both averaged over each step" + _WORST,
        is_fraction=True,
    ),
    "overshoot": Quantity(
        of="contact",
        label="overshoot of the peak",
        short="overshoot",
        path="exact.contacts.*.overshoot",
        over_contacts="max",
        metric="peak force over the exact peak, averaged over each step, less one" + _WORST,
        is_fraction=True,
    ),
    # Delays have a sign, so that the smaller is not the better; None of them is a column by its bare name.
    "closing_error": Quantity(
        of="contact", label="delay of the closing", unit="time", path="exact.contacts.*.closing_error"
    ),
    "opening_error": Quantity(
        of="contact", label="delay of the opening", unit="time", path="exact.contacts.*.opening_error"
    ),
    # ------------------------------------------------------------------------------------------- costs of the run
    "steps": Quantity(label="steps", path="steps", metric="number of steps"),
    "node_steps": Quantity(
        label="steps times nodes",
        metric="number of steps times number of nodes: the cost, whatever the machine; stages are not counted",
    ),
}

# Numbers that the summary of a run has of each contact.
CONTACT_NUMBERS = {name: quantity for name, quantity in QUANTITIES.items() if quantity.path.startswith("contacts.")}
# Quantities that an expectation of a case or a measure of a study may name with a contact, a probe or times.
MEASURABLE = {
    name: quantity
    for name, quantity in QUANTITIES.items()
    if (quantity.axis is not None and quantity.of not in {"element", "contact state"}) or name in CONTACT_NUMBERS
}
# Quantities that are columns of the table of a study by their bare names, in this order.
METRICS = {name: quantity for name, quantity in QUANTITIES.items() if quantity.metric}
TRUE_ERRORS = tuple(name for name, quantity in METRICS.items() if quantity.against_exact and quantity.is_error)

# Columns of the table of a comparison, columns of the table of the best runs of a study, and panels of its figures.
COMPARISON_TABLE = (*TRUE_ERRORS, "peak_force", "penetration", "energy_kept", "energy_max", "steps")
STUDY_TABLE = ("force_error_l2", "impulse_error", "displacement_error", "noise", "energy_growth", "steps")
STUDY_PANELS = ("force_error_l1", "impulse_error", "noise", "penetration", "peak_force", "energy_max")
# Histories by which the conformance kit compares two runs.
COMPARED_BY_KIT = ("contact_force", "gap", "displacement")

# First keys of the dotted paths into the summary of a run, such as `energy.final`.
SUMMARY = (
    "certificate",
    "contacts",
    "dt",
    "energy",
    "energy_growth",
    "exact",
    "momentum",
    "nodes",
    "seconds",
    "steps",
)

STATISTICS = ("mean", "max", "min", "final", "integral", "value")


# Kinds of units that a case may name, and those that follow from others where it does not.
UNIT_KINDS = ("length", "mass", "time", "force", "energy", "stress")
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


def values_at(entry: Any, path: str) -> Iterator[Any]:
    """Yield the values at a dotted path into a summary, in which a star stands for all entries."""
    key, _, rest = path.partition(".")
    if isinstance(entry, Mapping):
        for name in entry if key == "*" else [key]:
            yield from values_at(entry.get(name), rest) if rest else [entry.get(name)]


def name_schema(labels: Mapping[str, str]) -> dict[str, Any]:
    """Return the JSON schema of a name of a quantity, or of a dotted path into the summary of a run.

    Parameters
    ----------
    labels
        The names that an editor offers, each with words for it.
    """
    names = {"enum": list(labels), "enumDescriptions": list(labels.values())}
    return {"anyOf": [names, {"type": "string", "pattern": rf"^({'|'.join(SUMMARY)})(\..+)?$"}]}
