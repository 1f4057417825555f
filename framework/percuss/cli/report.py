"""The command ``percuss report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percuss.cli.common import Plugins, option, reporting


def report(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="File of rows that `percuss study` wrote.")],
    out: Annotated[Path | None, option("-o --out FILE", "Page; by default STUDY.html beside the study.")] = None,
    figures: Annotated[Path | None, option("--figures DIR", "Write svg and pdf; a page only with -o.")] = None,
    plugin: Plugins = None,
    median: Annotated[bool, option("--median", "Draw the median run of each pair, instead of the best.")] = False,
) -> None:
    """Write a study as one HTML page, or as figures for print."""
    with reporting(as_json=False):
        from percuss.cli import verbs

        for path in verbs.report(study, out, figures, median=median, files=plugin or []):
            print(path)
