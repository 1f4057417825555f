"""Options of a component, or keys of a section, as the annotations of a frozen dataclass declare them.

The annotations are the only statement of what is allowed: types, bounds, units and documentation are taken from them
for validation, for messages and for the JSON schema alike.
"""

from __future__ import annotations

import dataclasses
import functools
import typing
from typing import Any, NamedTuple

from percuss.case.type_words import fact
from percuss.errors import PluginError
from percuss.methods.interfaces import Doc, Unit

# A product of three numbers between these bounds neither overflows nor underflows.
SMALLEST_NUMBER, LARGEST_NUMBER = 1e-100, 1e100
UNITS = "Choose units in which lengths, masses and times are nearer to 1."

# Units of the options of contact laws that are per area of contact, where contact points have areas.
PER_AREA = {"force", "force/length", "mass"}


@dataclasses.dataclass(frozen=True)
class Key:
    """Key of a field in the input, where the key is not the name of the field."""

    key: str


@dataclasses.dataclass(frozen=True)
class Computed:
    """Mark of a field that no input sets, because it follows from the rest of the case."""


class Option(NamedTuple):
    """An option as its dataclass declares it.

    Attributes
    ----------
    key
        Key in a case: that of `Key`, else the name of the field without a trailing underscore, which avoids keywords.
    field
        Name of the field.
    annotation
        Type with bounds.
    unit, doc
        Texts of `Unit` and `Doc`; empty where they are absent.
    required
        Whether there is no default.
    default
        The default, or `dataclasses.MISSING`.
    """

    key: str
    field: str
    annotation: Any
    unit: str
    doc: str
    required: bool
    default: Any

    @property
    def shown_unit(self) -> str:
        """The unit in brackets after a space, as messages and descriptions show it; empty for a pure number."""
        return f" [{self.unit}]" if self.unit not in ("", "1") else ""


@functools.cache
def options_of(cls: Any) -> dict[str, Option]:
    """Return the options of a dataclass by key, in the order of its fields.

    Raises
    ------
    PluginError
        If its annotations cannot be read.
    """
    try:
        hints = typing.get_type_hints(cls, include_extras=True)
    except (NameError, TypeError, AttributeError, SyntaxError) as error:
        raise PluginError(f"{cls.__name__}: its annotations cannot be read: {error}") from None
    options = {}
    for field in dataclasses.fields(cls):
        annotation = hints[field.name]
        if not field.init or fact(annotation, Computed) is not None:
            continue
        key, unit, doc = fact(annotation, Key), fact(annotation, Unit), fact(annotation, Doc)
        default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
        option = Option(
            key=key.key if key else field.name.rstrip("_"),
            field=field.name,
            annotation=annotation,
            unit=unit.unit if unit else "",
            doc=doc.text if doc else "",
            required=default is dataclasses.MISSING,
            default=default,
        )
        options[option.key] = option
    return options
