"""What a case expects of its own run, checked against what a run records."""

from __future__ import annotations

from collections.abc import Mapping

from percuss.case.layout import ExpectSection
from percuss.case.quantities import QUANTITIES, SUMMARY, Quantity
from percuss.case.reader import Reader
from percuss.case.specs import Address, Expectation
from percuss.case.type_words import found
from percuss.case.yaml_text import KeyPath
from percuss.errors import suggestion

__all__ = ["expectations"]


def expectations(reader: Reader, dimension: int) -> tuple[Expectation, ...]:
    """Return the expectations of a case; what is wrong with them goes to the `reader`.

    Parameters
    ----------
    reader
        Has read bodies and contacts.
    dimension
        Number of dimensions of the case.
    """
    items = reader.source.get(("expect",), ())
    if not isinstance(items, tuple):
        reader.wrong(("expect",), f"expected a list of expectations, found {found(items)}", "Begin each with a dash.")
        return ()
    made = []
    for i, item in enumerate(items):
        path: KeyPath = ("expect", i)
        if not isinstance(item, Mapping):
            reader.wrong(path, f"expected a mapping as {{quantity: gap, ...}}, found {found(item)}")
            continue
        section = reader.section(ExpectSection, path, item, "the expectation")
        quantity = _quantity(reader, (*path, "quantity"), item.get("quantity"))
        if section is None or quantity is None:
            continue
        statistic, value = section.statistic
        within, relative = section.tolerance
        _taken(reader, path, section, quantity, statistic)
        if section.component and (quantity.of != "probe" or section.component >= dimension):
            limit = f"0 to {dimension - 1}" if quantity.of == "probe" and dimension > 1 else "0 only"
            reader.wrong((*path, "component"), f"expected {limit}, found {section.component}")
        contact = _contact(reader, path, section, quantity)
        probe = _probe(reader, path, section, quantity)
        made.append(
            Expectation(
                quantity=section.quantity,
                contact=contact,
                probe=probe,
                component=section.component,
                during=section.during,
                at=section.at,
                statistic=statistic,
                value=value,
                within=within,
                relative=relative,
                source=section.source,
                path=path,
            )
        )
    return tuple(made)


def _quantity(reader: Reader, path: KeyPath, name: object) -> Quantity | None:
    """Return what is known of a quantity; a path into the summary is a number of the run."""
    if not isinstance(name, str):
        return None
    if name in QUANTITIES:
        return QUANTITIES[name]
    head, dot, _ = name.partition(".")
    if head in SUMMARY:
        return Quantity("run", "scalar")
    known = [one + dot for one in SUMMARY] if dot else [*QUANTITIES, *SUMMARY]
    reader.wrong(path, f"unknown quantity '{name}'", suggestion(head + dot, known, "name"))
    return None


def _taken(reader: Reader, path: KeyPath, section: ExpectSection, quantity: Quantity, statistic: str) -> None:
    """Check that the statistic and the times suit the quantity."""
    name = section.quantity
    if quantity.kind == "scalar":
        if statistic != "value":
            message = f"{name} is one number a run, it has no {statistic}"
            reader.wrong((*path, statistic), message, "Write `value:`.", key=True)
        for time in ("during", "at"):
            if getattr(section, time) is not None:
                message = f"{name} is one number a run and belongs to no time"
                reader.wrong((*path, time), message, f"Remove `{time}:`.", key=True)
    elif statistic == "value" and section.at is None:
        reader.wrong((*path, "at"), "missing (the time at which `value` holds)", "Add `at:`.", key=True)
    elif statistic != "value" and section.at is not None:
        message = f"{statistic} is taken over an interval, not at a time"
        reader.wrong((*path, "at"), message, "Write `value:` instead, or `during:`.", key=True)


def _contact(reader: Reader, path: KeyPath, section: ExpectSection, quantity: Quantity) -> str | None:
    """Return the contact whose quantity is meant: the only one where none is named."""
    name, known = section.contact, reader.contact_names
    if quantity.of != "contact":
        if name is not None:
            reader.wrong(
                (*path, "contact"),
                f"{section.quantity} belongs to no contact",
                "Remove `contact:`.",
                key=True,
            )
        return None
    if name is None and len(known) == 1:
        return next(iter(known))
    if name is None and not known and reader.problems:
        return None  # the contacts are wrong, and said to be
    if name is None:
        advice = f"Add `contact:` with one of: {', '.join(sorted(known))}." if known else "The case has no contact."
        reader.wrong((*path, "contact"), f"missing (whose {section.quantity})", advice, key=True)
    elif name not in known:
        reader.wrong((*path, "contact"), f"there is no contact '{name}'", suggestion(name, known, "name"))
    return name


def _probe(reader: Reader, path: KeyPath, section: ExpectSection, quantity: Quantity) -> Address | None:
    """Return the end whose quantity is meant."""
    if quantity.of == "probe":
        if section.probe is not None:
            return reader.address((*path, "probe"), section.probe)
        reader.wrong((*path, "probe"), f"missing (whose {section.quantity})", "Add `probe:` with an end.", key=True)
    elif section.probe is not None:
        reader.wrong((*path, "probe"), f"{section.quantity} belongs to no end", "Remove `probe:`.", key=True)
    return None
