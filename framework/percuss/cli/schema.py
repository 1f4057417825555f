"""The command ``percuss schema``."""

from __future__ import annotations

import contextlib
import sys
from typing import Annotated

from percuss.cli.common import Plugins, option, print_json, reporting


def schema(
    plugin: Plugins = None,
    study: Annotated[bool, option("--study", "Print the schema of a study file.")] = False,
) -> None:
    """Print the JSON schema of a case or a study, for editors.

    An editor finds the saved schema by the first line of a case: # yaml-language-server: $schema=FILE
    """
    with reporting(as_json=False):
        from percuss.cli import verbs

        with contextlib.redirect_stdout(sys.stderr):  # what plug-ins print
            schema = verbs.schema(study=study, files=plugin or [])
        print_json(schema)
