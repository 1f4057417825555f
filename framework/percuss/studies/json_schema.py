"""JSON schema of a study file, with which an editor completes and checks it."""

from __future__ import annotations

from typing import Any

from percuss.case.json_schema import DIALECT, component_schema, name_or, schema_of
from percuss.case.quantities import MEASURABLE, METRICS, name_schema
from percuss.methods.registry import Registry
from percuss.studies.layout import StudySection


def study_schema(registry: Registry) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a study.

    Parameters
    ----------
    registry
        Registry whose integrators and contact laws appear by name.
    """
    schema = schema_of(StudySection, registry)
    properties = schema["properties"]
    properties["vary"]["additionalProperties"] = {"type": ["array", "string", "number", "boolean"]}
    for family, family_schema in properties["methods"]["properties"].items():
        components = {name: registry.get(family, name) for name in registry.names(family)}
        # Options of the case are kept, and others are varied, so that none has to stand here.
        family_schema["items"] = component_schema(components, complete=False)
    columns = {name: quantity.label for name, quantity in METRICS.items()}
    columns |= {name: registry.get("measures", name).summary for name in registry.names("measures")}
    quantities = {name: quantity.label for name, quantity in {**MEASURABLE, **METRICS}.items()}
    measure = properties["measure"]["items"]
    measure["properties"]["quantity"] |= name_schema(quantities)
    properties["measure"]["items"] = name_or(name_schema(columns), measure)
    return {"$schema": DIALECT, "title": "percuss study", "description": "A study of percuss, format 1", **schema}
