"""JSON schema of a study file, with which an editor completes and checks it."""

from __future__ import annotations

from typing import Any

from percuss.case.json_schema import DIALECT, schema_of
from percuss.methods.registry import Registry
from percuss.studies.layout import StudySection


def study_schema(registry: Registry) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a study.

    Parameters
    ----------
    registry
        Registry whose integrators and contact laws appear by name.
    """
    from percuss.case.quantities import METRICS

    schema = schema_of(StudySection, registry)
    properties = schema["properties"]
    properties["vary"]["additionalProperties"] = {"type": ["array", "string", "number", "boolean"]}
    for family, family_schema in properties["methods"]["properties"].items():
        choices = [{"enum": registry.names(family)}, {"type": "object", "required": ["name"]}]
        family_schema["items"] = {"anyOf": choices}
    bare = {"anyOf": [{"enum": list(METRICS)}, {"type": "string", "pattern": r"^\w+(\.[\w*-]+)*$"}]}
    properties["measure"]["items"] = {"anyOf": [bare, properties["measure"]["items"]]}
    return {"$schema": DIALECT, "title": "percuss study", "description": "A study of percuss, format 1", **schema}
