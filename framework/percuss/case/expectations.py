"""Expectations of a case about its own run, checked against the quantities that a run records."""

from __future__ import annotations

from collections.abc import Mapping

from percuss.case.layout import ExpectSection
from percuss.case.quantities import MEASURABLE, SUMMARY, Quantity
from percuss.case.reader import Reader
from percuss.case.specs import Address, Expectation
from percuss.case.type_words import found
from percuss.case.yaml_text import KeyPath
from percuss.errors import suggestion

__all__ = ["expectations"]


def expectations(reader: Reader, dimension: int) -> tuple[Expectation, ...]:
    """Return the expectations of a case, and report mistakes in them to the `reader`.

    Parameters
    ----------
    reader
        Reader of the case, which has read bodies and contacts already.
    dimension
        Number of dimensions of the case.
    """
    items = reader.source.get(("expect",), ())
    if not isinstance(items, tuple):
        reader.wrong(("expect",), f"expected a list of expectations, found {found(items)}", "Begin each with a dash.")
        return ()
    out = []
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
        _check_statistic(reader, path, section, quantity, statistic)
        if section.component and (quantity.of != "probe" or section.component >= dimension):
            limit = f"0 to {dimension - 1}" if quantity.of == "probe" and dimension > 1 else "0 only"
            reader.wrong((*path, "component"), f"expected {limit}, found {section.component}")
        contact = _contact(reader, path, section, quantity)
        probe = _probe(reader, path, section, quantity)
        out.append(
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
    return tuple(out)


def _quantity(reader: Reader, path: KeyPath, name: object) -> Quantity | None:
    """Return the quantity of a name; a dotted path into the summary is one number of the run."""
    if not isinstance(name, str):
        return None
    if name in MEASURABLE:
        return MEASURABLE[name]
    head, dot, _ = name.partition(".")
    if head in SUMMARY:
        return Quantity(label=name)
    names = [key + dot for key in SUMMARY] if dot else [*MEASURABLE, *SUMMARY]
    reader.wrong(path, f"unknown quantity '{name}'", suggestion(head + dot, names, "name"))
    return None


def _check_statistic(reader: Reader, path: KeyPath, section: ExpectSection, quantity: Quantity, statistic: str) -> None:
    """Report to the `reader` a statistic or a time that does not suit the quantity."""
    name = section.quantity
    if quantity.axis is None:
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
    """Return the name of the contact of the quantity; without a name it is the only contact of the case."""
    name, contact_names = section.contact, reader.contact_names
    if quantity.of != "contact":
        if name is not None:
            reader.wrong(
                (*path, "contact"),
                f"{section.quantity} belongs to no contact",
                "Remove `contact:`.",
                key=True,
            )
        return None
    if name is None and len(contact_names) == 1:
        return next(iter(contact_names))
    if name is None and not contact_names and reader.problems:
        return None  # The mistakes in the contacts have been reported already.
    if name is None:
        advice = (
            f"Add `contact:` with one of: {', '.join(sorted(contact_names))}."
            if contact_names
            else "The case has no contact."
        )
        reader.wrong((*path, "contact"), f"missing (whose {section.quantity})", advice, key=True)
    elif name not in contact_names:
        reader.wrong((*path, "contact"), f"there is no contact '{name}'", suggestion(name, contact_names, "name"))
    return name


def _probe(reader: Reader, path: KeyPath, section: ExpectSection, quantity: Quantity) -> Address | None:
    """Return the address of the end of the quantity, or None where it belongs to no end or none is given."""
    if quantity.of == "probe":
        if section.probe is not None:
            return reader.address((*path, "probe"), section.probe)
        reader.wrong((*path, "probe"), f"missing (whose {section.quantity})", "Add `probe:` with an end.", key=True)
    elif section.probe is not None:
        reader.wrong((*path, "probe"), f"{section.quantity} belongs to no end", "Remove `probe:`.", key=True)
    return None
