"""Say what a component is: summary, formula, options, facts, references, a snippet for a case, and where it is from."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import percuss
from percuss.case.options import Option, options_of, schema_of
from percuss.case.type_words import describe, fact
from percuss.case.yaml_text import flow
from percuss.errors import InputError, Problem, suggestion
from percuss.methods.admission import OLDEST
from percuss.methods.interfaces import FAMILIES, AllowInf, Component

if TYPE_CHECKING:
    from percuss.methods.registry import Registry

__all__ = ["Docs", "component_data", "component_text", "components_named", "docs", "registry_data"]

FORMULA = "Formula:"
# facts that are told apart from the others
ELSEWHERE = (
    "family",
    "name",
    "summary",
    "references",
    "examples",
    "contract_version",
)


class Docs(NamedTuple):
    """A component's docstring in parts: its first paragraph, the one that begins with "Formula:", and the rest."""

    first: str
    formula: str
    rest: str


def docs(component: type[Component]) -> Docs:
    """Return the docstring of a component in parts, the marks of code left out."""
    first, *others = inspect.cleandoc(component.__doc__ or "").replace("``", "").split("\n\n")
    formula = next((one for one in others if one.startswith(FORMULA)), "")
    rest = "\n\n".join(one for one in others if one is not formula)
    return Docs(first, formula.removeprefix(FORMULA).strip(), rest)


def components_named(registry: Registry, name: str) -> list[tuple[str, str]]:
    """Return the (family, name) of every component called `name`.

    Raises
    ------
    InputError
        If there is none.
    """
    found = [key for key in registry.components if key[1] == name]
    if not found:
        known = {key[1] for key in registry.components}
        raise InputError([Problem("percuss plugins", "", f"unknown component '{name}'", suggestion(name, known))])
    return found


def component_data(registry: Registry, family: str, name: str) -> dict[str, Any]:
    """Return all that is known of a component, in the terms of JSON."""
    from percuss.jsonable import plain

    component = registry.get(family, name)
    source = registry.sources[family, name]
    about = docs(component)
    return plain(  # type: ignore[no-any-return]
        {
            "family": family,
            "name": name,
            "summary": component.summary,
            "about": about.first,
            "formula": about.formula,
            "details": about.rest,
            "options": [_option(one) for one in options_of(component).values()],
            "schema": schema_of(component),
            "facts": _facts(component),
            "references": list(component.references),
            "examples": list(component.examples),
            "snippet": "\n".join(snippet(component, "" if source.distribution else source.file)),
            "distribution": source.distribution,
            "version": source.version,
            "module": source.module,
            "file": source.file,
            "contract_version": component.contract_version,
        }
    )


def _option(option: Option) -> dict[str, Any]:
    """Return an option in the terms of JSON, what it expects in words."""
    infinite = ", may be .inf" if fact(option.annotation, AllowInf) is not None else ""
    return {
        "key": option.key,
        "what": option.doc,
        "unit": option.unit or "1",
        "expects": describe(option.annotation) + infinite,
        "required": option.required,
        "default": None if option.required else option.default,
    }


def _facts(component: type[Component]) -> dict[str, Any]:
    """Return the class facts that the contract of the family knows and the component declares or inherits."""
    known = [*FAMILIES[component.family].__annotations__, *Component.__annotations__]
    return {one: getattr(component, one) for one in known if one not in ELSEWHERE and hasattr(component, one)}


def component_text(registry: Registry, family: str, name: str) -> str:
    """Return the same in words."""
    data, component = component_data(registry, family, name), registry.get(family, name)
    lines = [f"{name} ({family}): {data['summary']}", "", data["about"]]
    lines += ["", "Formula", *_indented(data["formula"])] if data["formula"] else []
    lines += ["", data["details"]] if data["details"] else []
    lines += ["", "Options"]
    for one in data["options"]:
        default = "required" if one["required"] else f"default {flow(one['default'])}"
        default = default if one["required"] or one["default"] is not None else "not given by default"
        lines.append(f"  {one['key']} [{one['unit']}]: {one['what'] or 'not documented'}")
        lines.append(f"      {one['expects']}; {default}")
    lines += ["  none"] if not data["options"] else []
    facts = {key: value for key, value in data["facts"].items() if value not in ("", [], {}, None)}
    lines += ["", "Facts"] if facts else []
    for key, value in facts.items():
        if isinstance(value, Mapping):
            lines += [f"  {key}", *(f"    {one}: {why}" for one, why in value.items())]
        else:
            lines.append(f"  {key}: {', '.join(map(str, value)) if isinstance(value, list) else value}")
    lines += ["", "References", *(f"  {reference}" for reference in data["references"])] if data["references"] else []
    lines += ["", _WHERE.get(family, "In a case"), *_indented(data["snippet"])]
    origin = f"{data['distribution']} {data['version']}" if data["distribution"] else f"a file, {data['version']}"
    origin += f", written for contract {component.contract_version}" if component.contract_version else ""
    lines += ["", f"From {origin}, module {data['module']}, {data['file']}"]
    return "\n".join(lines)


def _indented(text: str) -> list[str]:
    return [f"  {line}" for line in text.splitlines()]


_WHERE = {"solutions": "On the command line", "measures": "In a study"}


def snippet(component: type[Component], file: str) -> list[str]:
    """Return lines to paste into a case: the component with its first example that sets something.

    Parameters
    ----------
    component
        What is to be used.
    file
        Of a single-file plug-in, which the case must name; else empty.
    """
    example = dict(next((one for one in component.examples if one), {}))
    named = f"{{name: {component.name}, {flow(example)[1:]}" if example else component.name
    alone = component.shorthand and list(example) == [component.shorthand]
    options = flow(example[component.shorthand]) if alone else flow(example)
    body = ["    material: {young: 100, density: 0.01}", "    area: 1"]
    families = {
        "integrators": ["method:", f"  integrator: {named}"],
        "contacts": ["method:", f"  contact: {named}"],
        "masses": ["method:", f"  mass: {named}"],
        "materials": ["bodies:", "  short:", f"    material: {named}"],
        "elements": ["bodies:", "  short:", f"    element: {named}"],
        "shapes": ["bodies:", "  short:", f"    {component.name}: {options}", *body],
        "loads": ["loads:", f"  push: {{{component.name}: {options}{_on(component)}}}"],
        "measures": ["measure:", f"  - {component.name}"],
        "solutions": [
            "percuss run CASE --exact-only",
            "# and every run of a case that it covers is told its true error, unasked",
        ],
    }
    lines = families[component.family]
    if file and component.family in _WHERE:
        return [*lines, f"# with --plugin {Path(file).name}"]
    return [f"plugins: [{flow(Path(file).name)}]", *lines] if file else lines


def _on(component: type[Component]) -> str:
    return "" if getattr(component, "everywhere", False) else ", on: short.left"


def registry_data(registry: Registry) -> dict[str, Any]:
    """Return every component and every failure, in the terms of JSON."""
    return {
        "percuss": percuss.__version__,
        "contract": percuss.CONTRACT,
        "oldest_contract": OLDEST,
        "components": [
            {
                "family": family,
                "name": name,
                "summary": component.summary,
                "distribution": registry.sources[family, name].distribution,
                "version": registry.sources[family, name].version,
                "module": registry.sources[family, name].module,
                "file": registry.sources[family, name].file,
                "contract_version": component.contract_version,
            }
            for (family, name), component in registry.components.items()
        ],
        "broken": [{"source": b.source, "error": b.error, "file": b.file} for b in registry.broken],
    }
