"""Checks of the arguments of the functions of `percuss`, which name the expected kind where a wrong one is given."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from percuss.case.hints import name_advice
from percuss.errors import InputError, Problem, refuse_if_any, shortened, wrong_input
from percuss.methods.blame import SINGULAR

if TYPE_CHECKING:
    from percuss.methods.registry import Registry


def wrong_argument(function: str, message: str, value: object, advice: str) -> InputError:
    """Return the error for an argument of the wrong kind."""
    shown = shortened(repr(value), 60)
    return wrong_input(function, f"{message}, found {shown} of type {type(value).__name__}", advice)


def expect_suffix(path: str | os.PathLike[str], what: str, suffixes: Sequence[str], advice: str) -> str:
    """Return the suffix of a file to be written, in small letters; raise InputError unless it is one of `suffixes`."""
    suffix = Path(str(path)).suffix
    if suffix.lower() not in suffixes:
        endings = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
        raise wrong_input(str(path), f"expected {what} ending in {endings}, found {suffix or 'no ending'}", advice)
    return suffix.lower()


def expect_paths(function: str, parameter: str, value: object, *, many: bool = False) -> None:
    """Raise InputError unless `value` is None or maps dotted paths to values; with `many`, each path to several."""
    advice = 'As {"method.contact.beta_s": [0.1, 1]}.' if many else 'As {"method.contact.beta_s": 1}.'
    if value is None:
        return
    if not isinstance(value, Mapping) or not all(isinstance(path, str) for path in value):
        raise wrong_argument(function, f"expected a mapping of dotted paths to values as `{parameter}`", value, advice)
    for path, items in value.items():
        if many and (isinstance(items, (str, bytes, Mapping)) or not isinstance(items, Iterable)):
            raise wrong_argument(function, f"expected a list of values for '{path}' of `{parameter}`", items, advice)


def expect_names(function: str, parameter: str, value: object, *, of: str = "names", example: str = "NAME") -> None:
    """Raise InputError unless `value` is a list of names; a text is refused, as it would be read letter by letter."""
    if isinstance(value, (str, bytes, os.PathLike)) or not isinstance(value, Iterable):
        shown = [str(value)] if isinstance(value, (str, os.PathLike)) else [example]
        raise wrong_argument(function, f"expected a list of {of} as `{parameter}`", value, f"As {shown}.")


def expect_files(function: str, value: object) -> None:
    """Raise InputError unless `value` is a list of files."""
    expect_names(function, "plugins", value, of="files", example="my_law.py")


def expect_methods(registry: Registry, integrators: Iterable[str], contacts: Iterable[str]) -> None:
    """Raise InputError unless all names of integrators and of contact laws are registered."""
    options = (("integrator", "integrators", integrators), ("contact", "contacts", contacts))
    refuse_if_any(
        [
            Problem(f"--{option}", "", f"unknown {SINGULAR[family]} '{name}'", name_advice(name, family, registry))
            for option, family, names in options
            for name in names
            if name not in registry.names(family)
        ]
    )
