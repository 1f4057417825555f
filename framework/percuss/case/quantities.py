"""Names of the quantities that a run records, for expectations, studies and the conformance kit."""

from __future__ import annotations

from typing import Literal, NamedTuple

__all__ = ["QUANTITIES", "STATISTICS", "SUMMARY", "Quantity"]


class Quantity(NamedTuple):
    """Kind of a recorded quantity.

    Attributes
    ----------
    of
        Entity that the quantity belongs to.
    kind
        ``"history"`` for a quantity with a value at every time, ``"scalar"`` for one number a run.
    """

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
