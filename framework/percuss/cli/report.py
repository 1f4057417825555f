"""The command ``percuss report``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from percuss.cli.common import reporting
from percuss.files import expect_writable

if TYPE_CHECKING:
    from percuss.reporting.study_data import StudyLike


def report(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="What `percuss study` made.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="The page; else STUDY.html beside it.")
    ] = None,
    figures: Annotated[
        Path | None, typer.Option("--figures", metavar="DIR", help="Pictures as svg and pdf; no page unless -o.")
    ] = None,
) -> None:
    """Write a study as one HTML page, or as figures for print."""
    with reporting(as_json=False):
        _expect_html(out)
        from percuss.studies.study_table import open_study

        for path in written(open_study(study), study, out, figures):
            print(path)


def written(study: StudyLike, source: Path, page: Path | None, folder: Path | None) -> list[Path]:
    """Write the figures of a study into `folder` and its page, by default named after `source`; return the paths."""
    from percuss.reporting.study_figures import study_figures
    from percuss.reporting.study_page import study_report

    if page is None and folder is None:
        page = source.with_suffix(".html")
    if page is not None:
        expect_writable(page, [("study", source)])
    out = study_figures(study, folder) if folder is not None else []
    return out if page is None else out + study_report(study, page)


def _expect_html(page: Path | None) -> None:
    """Refuse a page whose suffix is not of HTML, before the study is read."""
    from percuss.errors import InputError, Problem

    if page is not None and page.suffix.lower() not in {".html", ".htm"}:
        message = f"expected a page ending in .html, found {page.suffix or 'no ending'}"
        raise InputError([Problem(str(page), "", message, "Name it report.html.")])
