"""Times that a run reaches: what is to be measured after its end has no value."""

from __future__ import annotations

ROUND_OFF = 1e-9  # relative, of the end of a run that is computed from its steps


def after_the_end(during: tuple[float, float] | None, at: float | None, end: float) -> tuple[str, str, str] | None:
    """Return key, message and advice if an interval or a time begins after the end of a run, else None."""
    first = during[0] if during is not None else at
    if first is None or first <= end * (1.0 + ROUND_OFF):
        return None
    key, what = ("during", "an interval that begins") if during is not None else ("at", "a time")
    message = f"expected {what} at or before the end of the run, {end:.9g}, found {first:g}"
    return key, message, "Choose an earlier time, or make the run longer."
