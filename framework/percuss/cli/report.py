"""The command ``percuss report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percuss.cli.common import reporting


def report(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="What `percuss study` made.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="The page; else STUDY.html beside it.")
    ] = None,
    figures: Annotated[
        Path | None, typer.Option("--figures", metavar="DIR", help="Pictures as svg and pdf; no page unless -o.")
    ] = None,
    median: Annotated[
        bool, typer.Option("--median", help="Draw the median run of each pair of methods; else the best run.")
    ] = False,
) -> None:
    """Write a study as one HTML page, or as figures for print."""
    with reporting(as_json=False):
        from percuss.cli import verbs

        for path in verbs.report(study, out, figures, median=median):
            print(path)
