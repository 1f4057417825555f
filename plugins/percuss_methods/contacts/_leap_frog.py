"""The refusal of laws that relate the states before and after the one force of a leap-frog step."""

from __future__ import annotations

from percuss import Integrator, LeapFrog


def reason_against(integrator: Integrator, states: str) -> str | None:
    """Return why a law that relates `states`, in words, makes no sense with a scheme of another kind, or None."""
    if isinstance(integrator.bind(1.0), LeapFrog):
        return None
    return f"the law relates {states}, and {integrator.name} computes several forces in a step"
