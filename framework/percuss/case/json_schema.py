"""The JSON schema of a case, from the components at hand: with it an editor completes and checks a case.

It is made from the classes that `percuss.case.case` validates with, so the two cannot drift apart. What a
class checks in its ``__post_init__``, and what depends on several parts of a case, is beyond a schema.
"""

from __future__ import annotations

from typing import Any

from percuss.case.layout import CaseSection, Each, Items, Named, Part
from percuss.case.options import Option, described, option_schema, options_of, schema_of
from percuss.case.type_words import fact
from percuss.methods.interfaces import NAME_PATTERN
from percuss.methods.registry import Registry


def case_schema(registry: Registry) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a case.

    Parameters
    ----------
    registry
        Its components appear by name, each with its options, units and descriptions.

    Returns
    -------
    dict
        Plain data, ready for ``json.dumps``.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "percuss case",
        "description": "A case of percuss, format 1",
        **section_schema(CaseSection, registry),
    }


def section_schema(section: type, registry: Registry, family: str = "") -> dict[str, Any]:
    """Return the schema of a section; with a `family`, one key of it is the name of a component."""

    def schema_for(option: Option) -> dict[str, Any] | None:
        made = _entry(option, registry)
        return None if made is None else described(made, option)

    schema = schema_of(section, schema_for)
    # a component has a default, unless the default itself has options without one
    missing = [key for key, option in options_of(section).items() if _has_default(option, registry)]
    schema["required"] = [key for key in schema.get("required", ()) if key not in missing]
    if family:
        names = registry.names(family)
        schema["properties"] |= {name: _keyed(registry.get(family, name)) for name in names}
        schema["oneOf"] = [{"required": [name]} for name in names]
    return schema


def _entry(option: Option, registry: Registry) -> dict[str, Any] | None:
    """Return the schema of an entry that is a section, a component, or several; None for a plain value."""
    named, part = fact(option.annotation, Named), fact(option.annotation, Part)
    each, items = fact(option.annotation, Each), fact(option.annotation, Items)
    if named is not None:
        return _named(named, registry)
    if part is not None:
        return section_schema(part.section, registry)
    if each is not None:
        return {
            "type": "object",
            "propertyNames": {"pattern": f"^{NAME_PATTERN.pattern}$"},
            "additionalProperties": section_schema(each.section, registry, each.family),
            **({"minProperties": 1} if option.required else {}),
        }
    return {"type": "array", "items": section_schema(items.section, registry)} if items is not None else None


def _has_default(option: Option, registry: Registry) -> bool:
    named = fact(option.annotation, Named)
    if named is None:
        return False
    return named.optional or not _required(named.default, named.family, registry)


def _required(name: str, family: str, registry: Registry) -> list[str]:
    if name not in registry.names(family):
        return []
    return [key for key, option in options_of(registry.get(family, name)).items() if option.required]


def _named(named: Named, registry: Registry) -> dict[str, Any]:
    """Return the schema of ``NAME`` or ``{name: NAME, option: ...}``."""
    names = registry.names(named.family)
    classes = {name: registry.get(named.family, name) for name in names}
    bare = [
        {"const": name, "description": cls.summary}
        for name, cls in classes.items()
        if not _required(name, named.family, registry)
    ]
    whole = []
    for name, cls in classes.items():
        schema = schema_of(cls)
        schema["properties"] = {"name": {"const": name}, **schema["properties"]}
        needed = [] if name == named.default else ["name"]
        whole.append({**schema, "description": cls.summary, "required": [*needed, *schema.get("required", ())]})
    return {"anyOf": [*bare, *whole], "default": named.default} if not named.optional else {"anyOf": [*bare, *whole]}


def _keyed(cls: type[Any]) -> dict[str, Any]:
    """Return the schema of the value of a shape's or load's key."""
    schema = {**schema_of(cls), "description": cls.summary}
    forms = [schema]
    if cls.shorthand:
        forms.append(option_schema(cls, options_of(cls)[cls.shorthand]))
    elif "required" not in schema:
        forms.append({"type": "null"})
    return schema if len(forms) == 1 else {"anyOf": forms, "description": cls.summary}
