"""The command ``percuss plugins``."""

from __future__ import annotations

from typing import Annotated

import typer

from percuss.cli.common import AsJson, Plugins, reporting


def plugins(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="Method to describe.")] = "",
    plugin: Plugins = None,
    as_json: AsJson = False,
) -> None:
    """List the methods that percuss knows, or describe one."""
    with reporting(as_json) as answer:
        from percuss.cli import verbs
        from percuss.reporting.tables import Unbroken

        told = verbs.plugins(name, plugin or [])
        answer.show(told.data, [Unbroken(told.text)])
