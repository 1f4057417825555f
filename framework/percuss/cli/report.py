"""The command ``percuss report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percuss.cli.common import option, reporting


def report(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="File of rows that `percuss study` wrote.")],
    out: Annotated[
        Path | None,
        option("-o --out FILE", "Page to write; by default STUDY.html beside the study."),
    ] = None,
    figures: Annotated[
        Path | None, option("--figures DIR", "Write figures as svg and pdf; a page only with -o.")
    ] = None,
    median: Annotated[bool, option("--median", "Draw the median run of each pair, instead of the best.")] = False,
) -> None:
    """Write a study as one HTML page, or as figures for print."""
    with reporting(as_json=False):
        from percuss.cli import verbs

        for path in verbs.report(study, out, figures, median=median):
            print(path)
