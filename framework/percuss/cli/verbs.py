"""The commands as functions for Python, where no single function of a lower room does the work of a command."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from percuss.case.arguments import expect_files, expect_suffix, wrong_argument
from percuss.case.case import Case, expect_case
from percuss.errors import wrong_input
from percuss.files import expect_writable, replacing
from percuss.jsonable import Entries
from percuss.methods.registry import Registry

if TYPE_CHECKING:
    from percuss.certificate.waves import Waves
    from percuss.reporting.component import Explanation
    from percuss.studies.study_table import Study


def check(case: Case) -> Explanation:
    """Return the explanation of a case: its bodies, contacts, step and stability, in words and numbers, without a run.

    Parameters
    ----------
    case
        The case.

    Returns
    -------
    Explanation
        Its ``text`` is what ``print`` shows, its ``data`` the same as plain numbers.
    """
    expect_case("percuss.check", case)
    from percuss.certificate.verdict import settled
    from percuss.reporting.explanation import explanation

    return explanation(*settled(case))


def waves(case: Case, contact: str = "") -> Waves:
    """Return how a closed contact transmits and reflects waves, over frequency.

    Parameters
    ----------
    case
        The case; its integrator, contact law, step and end elements are measured as they are in it.
    contact
        Name of the contact; by default the first.

    Raises
    ------
    InputError
        If there is no such contact.
    PercussError
        If waves are not known of this case; the message gives the reason.
    """
    expect_case("percuss.waves", case)
    from percuss.certificate.verdict import settled
    from percuss.certificate.waves import waves as measured

    return measured(settled(case).model, contact)


def report(
    study: Study | str | os.PathLike[str],
    page: str | os.PathLike[str] | None = None,
    figures: str | os.PathLike[str] | None = None,
    *,
    median: bool = False,
    files: Sequence[str | Path] = (),
) -> list[Path]:
    """Write a study as one HTML page that needs no other file, or its figures for print; return the written files.

    Parameters
    ----------
    study
        The study, or the path of its file.
    page
        Path of the page, ending in .html; by default the name of the study beside it, unless only figures are asked.
    figures
        Folder of the figures, as svg and pdf.
    median
        Whether lines and profiles show the median run of each pair of methods, instead of its best run. The page
        begins with it and offers both.
    files
        Single-file plug-ins whose methods the page describes beside those that are installed.
    """
    from percuss.reporting.study_figures import study_figures
    from percuss.reporting.study_page import report_html
    from percuss.studies.study_table import Study, open_study

    if page is not None:
        expect_suffix(page, "a page", (".html", ".htm"), "Name it report.html.")
    study = study if isinstance(study, Study) else open_study(str(study))
    if not study.counts:
        raise wrong_input(str(study.path), "expected a study with rows, found none", "Make them with `percuss study`.")
    if page is None and figures is None:
        page = study.path.with_suffix(".html")
    statistic = "median" if median else "best"
    written: list[Path] = []
    if page is not None:
        expect_writable(Path(page), [("study", study.path)])
        with replacing(page, ".html") as beside:
            beside.write_text(report_html(study, statistic, files), encoding="utf-8")
        written.append(Path(page))
    return written + (study_figures(study, figures, statistic) if figures is not None else [])


def plugins(name: str = "", files: Sequence[str | Path] = ()) -> Explanation:
    """Return the list of all registered methods, or the description of one.

    Parameters
    ----------
    name
        Name of a method; without it all are listed.
    files
        Single-file plug-ins beside those that are installed.

    Returns
    -------
    Explanation
        Its ``text`` is what ``print`` shows, its ``data`` the same as plain data.
    """
    from percuss.reporting import component

    expect_files("percuss.plugins", files)
    if not isinstance(name, str):
        raise wrong_argument("percuss.plugins", "expected the name of a method", name, "As percuss.plugins('penalty').")
    registry = Registry.load([Path(file) for file in files])
    if not name:
        return component.Explanation(component.registry_text(registry), component.registry_data(registry))
    keys = component.components_named(registry, name, "percuss plugins")
    text = "\n\n".join(component.component_text(registry, *key) for key in keys)
    return component.Explanation(text, {"components": [component.component_data(registry, *key) for key in keys]})


def schema(*, study: bool = False, files: Sequence[str | Path] = ()) -> Entries:
    """Return the JSON schema of a case, with which an editor completes and checks it.

    Parameters
    ----------
    study
        Whether to return the schema of a study file instead.
    files
        Single-file plug-ins whose options the schema contains too.
    """
    from percuss.case.json_schema import case_schema
    from percuss.studies.layout import study_schema

    expect_files("percuss.schema", files)
    registry = Registry.load([Path(file) for file in files])
    return study_schema(registry) if study else case_schema(registry)
