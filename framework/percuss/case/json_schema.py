"""JSON schemas of cases and of components, with which an editor completes and checks a case.

They are made from the classes that validate a case, so that the two cannot drift apart. Conditions of a class's
``__post_init__`` and of several parts of a case are beyond a schema.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from percuss.case.options import options_of
from percuss.case.specs import CaseSection
from percuss.case.type_words import fact
from percuss.case.validation import NO_KEY, Keyed, Named, adapter
from percuss.jsonable import Entries
from percuss.methods.interfaces import Component
from percuss.methods.registry import Registry

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def case_schema(registry: Registry) -> Entries:
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
    about = {"$schema": DIALECT, "title": "percuss case", "description": "A case of percuss, format 1"}
    return {**about, **schema_of(CaseSection, registry)}


def schema_of(cls: type, registry: Registry | None = None) -> Entries:
    """Return the JSON schema of a dataclass's options: types, bounds, units, descriptions and defaults.

    Parameters
    ----------
    cls
        The dataclass. Its `exactly_one`, where it has one, lists groups of options of which one is given.
    registry
        Registry of the components that may be named; needed for sections only.
    """
    generator = type("Generator", (_Generator,), {"registry": registry})
    return adapter(cls).json_schema(schema_generator=generator)


def component_schema(components: Mapping[str, type[Component]], *, default: str = "", complete: bool = True) -> Entries:
    """Return the schema of ``NAME`` or ``{name: NAME, option: ...}``.

    The name decides by ``if`` and ``then`` which options there are, so that an editor offers these alone and a mistake
    has the place of the option.

    Parameters
    ----------
    components
        The components that may be named.
    default
        Name of the component that a mapping without a name has; empty if there is none.
    complete
        Whether options without a default are required; otherwise they may be given elsewhere.
    """
    schemas = {name: schema_of(cls) for name, cls in components.items()}
    bare = {name: cls for name, cls in components.items() if not complete or "required" not in schemas[name]}
    conditions = []
    for name, schema in schemas.items():
        options = {
            **schema,
            "properties": {"name": {"const": name}, **schema["properties"]},
            "required": schema.get("required", []) if complete else [],
            "description": components[name].summary,
        }
        named = {"properties": {"name": {"const": name}}}  # which a mapping without a name is too
        conditions.append({"if": named if name == default else {**named, "required": ["name"]}, "then": options})
    return name_or(
        _names_of(bare),
        {
            "properties": {"name": _names_of(components)},
            "required": [] if default in components else ["name"],
            "allOf": conditions,
        },
    )


def name_or(names: Entries, mapping: Entries) -> Entries:
    """Return the schema of an entry that is a name or a mapping.

    A mapping passes ``anyOf`` whatever is in it, so that its mistakes are reported by ``then``, at their own places.
    """
    return {"anyOf": [names, {"type": "object"}], "if": {"type": "object"}, "then": mapping}


def _names_of(components: Mapping[str, type[Component]]) -> Entries:
    return {"enum": list(components), "enumDescriptions": [cls.summary for cls in components.values()]}


class _Generator(GenerateJsonSchema):
    """Generator of a schema with units, and with the components of a registry by name."""

    registry: Registry | None = None

    def field_title_should_be_set(self, schema: object) -> bool:  # noqa: ARG002
        """Return False, as the keys themselves are the titles."""
        return False

    def dict_schema(self, schema: Any) -> Entries:
        """Return the schema of parts by name."""
        out = super().dict_schema(schema)
        for pattern, values in out.pop("patternProperties", {}).items():
            out |= {"propertyNames": {"pattern": pattern}, "additionalProperties": values}
        return out

    def typed_dict_schema(self, schema: Any) -> Entries:
        """Return the schema of the options of a dataclass."""
        cls = schema["metadata"]["percuss"]
        out = super().typed_dict_schema(schema)
        out.setdefault("properties", {})
        required = out.pop("required", [])
        for key, option in options_of(cls).items():
            entry = out["properties"][key]
            named = fact(option.annotation, Named)
            default = named.default if named and option.required else option.default
            if option.unit:
                entry["x-unit"] = option.unit
            if isinstance(default, bool | int | float | str | tuple) and default not in (float("inf"), -float("inf")):
                entry["default"] = list(default) if isinstance(default, tuple) else default
            if option.doc:
                entry["description"] = option.doc + option.shown_unit
            if named and option.required and default not in entry["anyOf"][0]["enum"]:
                required.append(key)
        if NO_KEY in required:
            required.remove(NO_KEY)
            keyed = out["properties"].pop(NO_KEY)
            out["properties"] |= keyed["properties"]
            out["oneOf"] = keyed["oneOf"]
        if required:
            out["required"] = required
        if groups := getattr(cls, "exactly_one", ()):
            out["allOf"] = [{"oneOf": [{"required": [key]} for key in group]} for group in groups]
        return out

    def function_plain_schema(self, schema: Any) -> Entries:
        """Return the schema of a component."""
        mark = schema["metadata"]["percuss"]
        if isinstance(mark, Named):
            return component_schema(self._components(mark.family), default=mark.default)
        return self._keyed(mark)

    def _components(self, family: str) -> Entries:
        return {name: self.registry.get(family, name) for name in self.registry.names(family)} if self.registry else {}

    def _keyed(self, keyed: Keyed) -> Entries:
        """Return the schemas of the values of each key that is the name of a shape or load."""
        properties = {}
        for name, cls in self._components(keyed.family).items():
            schema = {**schema_of(cls), "description": cls.summary}
            forms = [schema]
            if cls.shorthand:
                forms.append(schema["properties"][cls.shorthand])
            elif "required" not in schema:
                forms.append({"type": "null"})
            properties[name] = schema if len(forms) == 1 else {"anyOf": forms, "description": cls.summary}
        return {"properties": properties, "oneOf": [{"required": [name]} for name in properties]}
