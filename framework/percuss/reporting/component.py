"""Description of a component: summary, formula, options, facts, references, and its origin."""

from __future__ import annotations

import inspect
import math
import re
import shutil
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from percuss import version
from percuss.case.json_schema import schema_of
from percuss.case.options import PER_AREA, Option, options_of
from percuss.case.type_words import describe, fact
from percuss.case.yaml_text import flow
from percuss.errors import InputError, Problem, printable, suggestion
from percuss.jsonable import Entries
from percuss.methods.admission import contract_of
from percuss.methods.interfaces import FAMILIES, AllowInf, Component

if TYPE_CHECKING:
    from percuss.methods.registry import Registry

FORMULA = "Formula:"
NAMES = 30  # characters before the summaries in the list of components
MOST = 100  # characters in a line on a wide terminal
# These facts have entries of their own in the description.
ELSEWHERE = (
    "family",
    "name",
    "summary",
    "references",
    "examples",
    "contract_version",
)


@dataclass(frozen=True, repr=False)
class Explanation:
    """The text that explains a case, a component or a registry, and the same as plain data; it shows as its text."""

    text: str
    data: Entries

    def __repr__(self) -> str:
        return printable(self.text)


class Docs(NamedTuple):
    """The parts of a component's docstring: its first paragraph, the one that begins with "Formula:", and the rest."""

    first: str
    formula: str
    rest: str


def docs(component: type[Component]) -> Docs:
    """Return the parts of a component's docstring, without the double backquotes around code and each line break.

    Lines that are indented or begin with a dash or an asterisk stay lines of their own.
    """
    text = re.sub(r"(?<!\n)\n(?![\s*-])", " ", inspect.cleandoc(component.__doc__ or ""))
    first, *others = text.replace("``", "").split("\n\n")
    formula = next((paragraph for paragraph in others if paragraph.startswith(FORMULA)), "")
    rest = "\n\n".join(paragraph for paragraph in others if paragraph is not formula)
    return Docs(first, formula.removeprefix(FORMULA).strip(), rest)


def components_named(registry: Registry, name: str, place: str) -> list[tuple[str, str]]:
    """Return the (family, name) of every component called `name`.

    Parameters
    ----------
    registry
        The components.
    name
        Name that the user gave.
    place
        Command or option with which it was given, for the message.

    Raises
    ------
    InputError
        If there is no such component.
    """
    keys = [key for key in registry.components if key[1] == name]
    if not keys:
        names = {key[1] for key in registry.components}
        advice = f"Name the file as --plugin {name}." if name.endswith(".py") else suggestion(name, names)
        raise InputError([Problem(place, "", f"unknown component '{name}'", advice)])
    return keys


def component_data(registry: Registry, family: str, name: str) -> Entries:
    """Return the full description of a component in the types of JSON."""
    from percuss.jsonable import plain

    component = registry.get(family, name)
    about = docs(component)
    return plain(  # type: ignore[no-any-return]
        {
            **_origin(registry, family, name),
            "about": about.first,
            "formula": about.formula,
            "details": about.rest,
            "options": [_option(family, option) for option in options_of(component).values()],
            "schema": schema_of(component),
            "facts": _facts(component),
            "references": list(component.references),
            "examples": list(component.examples),
        }
    )


def _origin(registry: Registry, family: str, name: str) -> Entries:
    """Return what a component is in one line, and where it comes from."""
    component, source = registry.get(family, name), registry.sources[family, name]
    return {
        "family": family,
        "name": name,
        "summary": component.summary,
        "distribution": source.distribution,
        "version": source.version,
        "module": source.module,
        "file": source.file,
        "contract_version": contract_of(component),
    }


def _option(family: str, option: Option) -> Entries:
    """Return an option in the types of JSON, with the expected values in words."""
    between = "; per area between surfaces" if family == "contacts" and option.unit in PER_AREA else ""
    infinite = ", may be .inf" if fact(option.annotation, AllowInf) is not None else ""
    return {
        "key": option.key,
        "what": f"{option.doc}{between}",
        "unit": option.unit or "1",
        "expects": describe(option.annotation) + infinite,
        "required": option.required,
        "default": None if option.required else option.default,
    }


def _facts(component: type[Component]) -> Entries:
    """Return the class facts that the family's contract names and the component declares or inherits, by name."""
    names = [*FAMILIES[component.family].__annotations__, *Component.__annotations__]
    values = {name: getattr(component, name) for name in names if name not in ELSEWHERE and hasattr(component, name)}
    return {
        name: "follows from the options" if isinstance(value, (property, cached_property)) else value
        for name, value in values.items()
    }


def method_text(registry: Registry, family: str, name: str) -> str:
    """Return what a component is: summary, formula, options, facts, references."""
    data = component_data(registry, family, name)
    declared = {key: value for key, value in data["facts"].items() if value not in ("", [], {}, None)}
    return filled("method.txt.jinja", {**data, "declared": declared, "flow": flow})


def component_text(registry: Registry, family: str, name: str) -> str:
    """Return the full description of a component as text that fits the terminal, with its origin."""
    data = _origin(registry, family, name)
    lines = [piece for line in method_text(registry, family, name).splitlines() for piece in _folded(line)]
    origin = f"{data['distribution']} {data['version']}" if data["distribution"] else f"a file, {data['version']}"
    origin += f", written for contract {data['contract_version']}" if data["contract_version"] else ""
    return "\n".join([*lines, "", *_folded(f"From {origin}, module {data['module']}, {data['file']}")])


def filled(template: str, values: Mapping[str, object]) -> str:
    """Return the text of a template of this folder, in which `g` writes a number with six or more digits."""
    from jinja2 import Environment, StrictUndefined

    # What is written is text for a terminal, no HTML.
    environment = Environment(trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined, autoescape=False)  # noqa: S701
    environment.filters |= {"g": lambda value, digits=6: f"{value:.{digits}g}", "isfinite": math.isfinite}
    text = (Path(__file__).parent / template).read_text(encoding="utf-8")
    return environment.from_string(text).render(values).rstrip()


def _folded(line: str, indent: str = "") -> list[str]:
    """Return a line in pieces that fit the terminal; those after the first are indented by two more, or by `indent`."""
    width = min(shutil.get_terminal_size().columns, MOST)
    own = line[: len(line) - len(line.lstrip())]
    after = indent or (f"{own}  " if own else "")
    return textwrap.wrap(line, width, subsequent_indent=after, break_long_words=False, break_on_hyphens=False) or [""]


def registry_data(registry: Registry) -> Entries:
    """Return all components and all plug-ins that are not usable, in the types of JSON."""
    return {
        "percuss": version.__version__,
        "contract": version.CONTRACT,
        "components": [_origin(registry, *key) for key in registry.components],
        "broken": [{"source": plugin.source, "error": plugin.error, "file": plugin.file} for plugin in registry.broken],
    }


def registry_text(registry: Registry) -> str:
    """Return the list of components by family, each with its summary, and the plug-ins that are not usable."""
    lines = []
    for family in FAMILIES:
        lines += [family] if registry.names(family) else []
        for name in registry.names(family):
            component, source = registry.get(family, name), registry.sources[family, name]
            facts = [f"{source.distribution} {source.version}" if source.distribution else source.file]
            facts += [f"contract {contract}"] if (contract := contract_of(component)) else []
            origin = "" if source.distribution == "percuss" else f" (from {', '.join(facts)})"
            lines += _folded(f"  {name}  ".ljust(NAMES) + component.summary + origin, " " * NAMES)
        lines.append("")
    for broken in registry.broken:
        lines += _folded(f"not usable: {broken.source}{f' ({broken.file})' if broken.file else ''}: {broken.error}")
    lines += _folded(f"percuss {version.__version__}, contract {version.CONTRACT}")
    return "\n".join([*lines, "`percuss plugins NAME` describes one; --json gives the file of each."])
