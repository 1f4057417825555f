"""The command ``percuss schema``."""

from __future__ import annotations

from typing import Annotated

import typer

from percuss.cli.common import Plugins, print_json, reporting


def schema(
    plugin: Plugins = None,
    study: Annotated[bool, typer.Option("--study", help="That of a study file.")] = False,
) -> None:
    """Print the JSON schema of a case or a study, for editors."""
    with reporting(as_json=False):
        from percuss.case.json_schema import case_schema
        from percuss.methods.registry import Registry
        from percuss.studies.json_schema import study_schema

        registry = Registry.load(plugin or [])
        print_json(study_schema(registry) if study else case_schema(registry))
