"""The command ``percuss new``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percuss.cli.common import AsJson, option, reporting


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the method, as it is written in a case.")],
    kind: Annotated[str, option("--kind KIND", "Kind of the method, as contact, material or solid-material.")],
    out: Annotated[Path, option("-o --out FOLDER", "Folder to write into.")] = Path(),
    as_json: AsJson = False,
) -> None:
    """Write the first files of a method of your own.

    They are a plug-in, NAME.py, and a case, NAME.yaml, and run as they are.
    """
    with reporting(as_json) as answer:
        from percuss.cli.scaffold import new as write
        from percuss.reporting.tables import Unbroken

        made = write(name, kind, out)
        files = [str(file) for file in made.files]
        written = f"{made.component}, a method of the family {made.family}, is written and runs:"
        lines = [written, *(f"  {file}" for file in files), "next:", *(f"  {line}" for line in made.next)]
        answer.show({**vars(made), "files": files, "next": list(made.next)}, map(Unbroken, lines))
