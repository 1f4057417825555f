"""What several schemes have in common: what they cannot keep, and the laws that they therefore refuse."""

from __future__ import annotations

from typing import Any

DAMPING_SWINGS = {
    "energy-never-grows": "what it damps is not quite the energy of the state, which swings while waves run; and a "
    "contact that opens or closes between two steps adds or takes some",
}
ENERGY_SWINGS = {
    "energy-never-grows": "the energy of displacement and velocity at one time swings while waves run; and a "
    "contact that opens or closes between two steps adds or takes some",
}


def reason_against_overlap(law: Any, reason: str) -> str | None:
    """Return why a scheme refuses a law that guarantees "no penetration", or None for any other law."""
    return f"{reason}, and {law.name} lets nothing overlap" if "no penetration" in law.guarantees else None


def reason_against_pulling(law: Any) -> str | None:
    """Return why a scheme that extrapolates accelerations refuses a law that guarantees "never pulls", or None."""
    if "never pulls" not in law.guarantees:
        return None
    return (
        "the contact force of a step takes a part of the multiplier of the step before back: it pulls after a "
        f"contact has opened, and {law.name} never pulls"
    )
