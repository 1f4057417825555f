"""Checks that expectations of a case and measures of a study share: entries that do not suit a quantity, and times."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from percuss.case.specs import quantity_named
from percuss.case.validation import Mistake
from percuss.errors import suggestion

ROUND_OFF = 1e-9  # relative, of the end of a run that is computed from its steps


def after_the_end(during: tuple[float, float] | None, at: float | None, end: float) -> tuple[str, str, str] | None:
    """Return key, message and advice if an interval or a time begins after the end of a run, else None."""
    first = during[0] if during is not None else at
    if first is None or first <= end * (1.0 + ROUND_OFF):
        return None
    key, what = ("during", "an interval that begins") if during is not None else ("at", "a time")
    message = f"expected {what} at or before the end of the run, {end:.9g}, found {first:g}"
    return key, message, "Choose an earlier time, or make the run longer."


def misfits(section: Any, statistic: str, key: str, contacts: Collection[str]) -> Iterator[Mistake]:
    """Yield the entries of an expectation or a measure that do not suit its quantity.

    Parameters
    ----------
    section
        The expectation or the measure.
    statistic, key
        The statistic that it takes, and the key at which it stands.
    contacts
        Names of the contacts that there are.
    """
    name, quantity, takes = section.quantity, quantity_named(section.quantity), key == "take"
    if section.at is not None and section.during is not None:
        yield Mistake(("at",), "has both `during` and `at`", "Keep one.", key=True)
    if quantity.axis is None:
        single = f"{name} is a single number of a run and has no"
        if statistic != "value":
            yield Mistake((key,), f"{single} {statistic}", "Remove `take:`." if takes else "Write `value:`.", key=True)
        for time in ("during", "at"):
            if getattr(section, time) is not None:
                yield Mistake((time,), f"{single} time", f"Remove `{time}:`.", key=True)
    elif statistic == "value" and section.at is None:
        advice = f"Add `at:`{', or `take: mean` or the like' if takes else ''}."
        yield Mistake(("at",), "missing (the time of the value)", advice, key=True)
    elif statistic != "value" and section.at is not None:
        message = f"{statistic} is taken over an interval, not at a time"
        yield Mistake(
            ("at",), message, f"Write `{'take: value' if takes else 'value:'}` instead, or `during:`.", key=True
        )
    for owner, words in (("contact", "a contact"), ("probe", "an end")):
        if quantity.of != owner and getattr(section, owner) is not None:
            yield Mistake((owner,), f"{name} is not a quantity of {words}", f"Remove `{owner}:`.", key=True)
    if quantity.of == "probe" and section.probe is None:
        yield Mistake(("probe",), f"missing (the owner of {name})", "Add `probe:` with an end.", key=True)
    if quantity.of == "contact" and section.contact is not None and section.contact not in contacts:
        advice = suggestion(section.contact, contacts, "name")
        yield Mistake(("contact",), f"there is no contact '{section.contact}'", advice)
