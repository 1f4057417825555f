"""Properties that several schemes do not keep, and the laws that they refuse for this reason."""

from __future__ import annotations

from typing import Any

DAMPING_SWINGS = {
    "energy-never-grows": "the scheme damps another quantity than the energy of the state, which oscillates while "
    "waves run; and a contact that opens or closes between two steps adds or removes energy",
}
ENERGY_SWINGS = {
    "energy-never-grows": "the energy of displacement and velocity at one time oscillates while waves run; and a "
    "contact that opens or closes between two steps adds or removes energy",
}
CONTACT_SWINGS = {
    "energy-never-grows with penalty": "a contact that opens or closes between two steps adds or removes energy",
    "energy-never-grows with bipenalty": "the same, and the penalty mass lets it pull before it opens: the energy has "
    "no bound",
}


def reason_against_overlap(law: Any, reason: str) -> str | None:
    """Return why a scheme refuses a law that guarantees "no penetration", or None for any other law."""
    return f"{reason}, and {law.name} allows no overlap" if "no penetration" in law.guarantees else None


def reason_against_pulling(law: Any) -> str | None:
    """Return why a scheme that extrapolates accelerations refuses a law that guarantees "never pulls", or None."""
    if "never pulls" not in law.guarantees:
        return None
    return (
        "the contact force of a step subtracts a part of the multiplier of the last step: it pulls after a contact "
        f"has opened, and {law.name} never pulls"
    )
