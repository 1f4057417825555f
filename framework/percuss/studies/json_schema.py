"""JSON schema of a study file, with which an editor completes and checks it."""

from __future__ import annotations

from typing import Any

from percuss.case.json_schema import section_schema
from percuss.methods.registry import Registry
from percuss.studies.layout import MeasureSection, RangeSection, StudySection


def study_schema(registry: Registry) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a study.

    Parameters
    ----------
    registry
        Registry whose integrators and contact laws appear by name.
    """
    from percuss.case.quantities import METRICS

    section = section_schema(StudySection, registry)
    properties = {key.replace("_", "-"): value for key, value in section["properties"].items()}
    mapping = {"type": "object"}
    properties["set"] |= mapping
    properties["vary"] |= {"type": "object", "additionalProperties": {"type": ["array", "string", "number", "boolean"]}}
    properties["paired"] |= {"type": "array", "items": mapping}
    for family, family_schema in properties["methods"]["properties"].items():
        choices = [{"enum": registry.names(family)}, {"type": "object", "required": ["name"]}]
        family_schema |= {"type": "array", "items": {"anyOf": choices}}
    ranges = {"type": "object", "additionalProperties": section_schema(RangeSection, registry)}
    properties["sample"]["properties"]["of"] |= ranges
    bare = {"anyOf": [{"enum": list(METRICS)}, {"type": "string", "pattern": r"^\w+(\.[\w*-]+)*$"}]}
    properties["measure"] |= {"type": "array", "items": {"anyOf": [bare, section_schema(MeasureSection, registry)]}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "percuss study",
        "description": "A study of percuss, format 1",
        **section,
        "properties": properties,
        "required": [key.replace("_", "-") for key in section["required"]],
    }
