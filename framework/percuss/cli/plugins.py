"""The command ``percuss plugins``."""

from __future__ import annotations

from typing import Annotated

import typer

from percuss.cli.common import AsJson, Plugins, print_json, reporting
from percuss.errors import printable


def plugins(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="A component to describe.")] = "",
    plugin: Plugins = None,
    as_json: AsJson = False,
) -> None:
    """List the methods that percuss knows, or describe one."""
    with reporting(as_json):
        from percuss.methods.registry import Registry
        from percuss.reporting import component

        registry = Registry.load(plugin or [])
        if name:
            keys = component.components_named(registry, name, "percuss plugins")
            if as_json:
                print_json({"components": [component.component_data(registry, *key) for key in keys]})
            else:
                print(printable("\n\n".join(component.component_text(registry, *key) for key in keys)))
        elif as_json:
            print_json(component.registry_data(registry))
        else:
            print(printable(component.registry_text(registry)))
