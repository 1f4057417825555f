"""The names of what a run records: what expectations, studies and the kit may ask for."""

from __future__ import annotations

from typing import Literal, NamedTuple

__all__ = ["QUANTITIES", "STATISTICS", "SUMMARY", "Quantity"]


class Quantity(NamedTuple):
    """What a quantity belongs to, and whether it has a value at every time or one a run."""

    of: Literal["contact", "probe", "run"]
    kind: Literal["history", "scalar"]


QUANTITIES: dict[str, Quantity] = {
    "contact_force": Quantity("contact", "history"),
    "contact_force_end": Quantity("contact", "history"),
    "gap": Quantity("contact", "history"),
    "displacement": Quantity("probe", "history"),
    "velocity": Quantity("probe", "history"),
    "kinetic_energy": Quantity("run", "history"),
    "elastic_energy": Quantity("run", "history"),
    "external_work": Quantity("run", "history"),
    "contact_work": Quantity("run", "history"),
    "contact_energy": Quantity("run", "history"),
    "energy": Quantity("run", "history"),
    "energy_error": Quantity("run", "history"),
    "energy_growth": Quantity("run", "history"),
    "impulse": Quantity("contact", "scalar"),
    "peak_force": Quantity("contact", "scalar"),
    "first_closed": Quantity("contact", "scalar"),
    "last_open": Quantity("contact", "scalar"),
    "closed_time": Quantity("contact", "scalar"),
    "penetration": Quantity("contact", "scalar"),
}

# first words of the dotted paths into a run's summary, as `energy.final`
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
