"""The command ``percuss recommend``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percuss.cli import common
from percuss.cli.common import option
from percuss.files import expect_writable
from percuss.process import INTERRUPTED

CONTINUES = "interrupted: the same command continues from here"


def recommend(
    case: common.CaseFile,
    error: Annotated[str, option("--error BOUND", "Largest error, for example 1%.")] = "",
    energy: Annotated[str, option("--energy BOUND", "Largest share of the energy that a run takes or adds.")] = "",
    integrator: Annotated[str, option("--integrator A,B", "Integrators to choose from; by default all.")] = "",
    contact: Annotated[str, option("--contact X,Y", "Contact laws to choose from; by default all.")] = "",
    runs: Annotated[int, option("--runs N", "Largest number of runs.")] = 400,
    out: Annotated[Path | None, option("-o --out FILE", "File of the runs; by default CASE-recommend.sqlite.")] = None,
    workers: common.Workers = None,
    longest: common.Longest = None,
    plugin: common.Plugins = None,
    reference: common.Reference = "",
    plot: Annotated[Path | None, option("--plot FILE", "Draw the error of all runs over their cost.")] = None,
    as_json: common.AsJson = False,
) -> None:
    """Search the cheapest methods, mesh and step within bounds.

    The same command given again continues the search.
    """
    with common.reporting(as_json) as answer:
        from percuss.reporting.recommendation_words import recommendation_lines, recommendation_verdict
        from percuss.reporting.study_figures import check_drawable, work_and_precision, write
        from percuss.studies.recommendation import bound_of
        from percuss.studies.recommendation import recommend as search

        if plot is not None:
            check_drawable(plot)
            expect_writable(plot)
        bounds = {name: bound_of(text, f"--{name}") for name, text in (("error", error), ("energy", energy))}
        try:
            with common.progress_bar("runs") as progress:
                found = search(
                    case,
                    **bounds,
                    integrators=common.names_in(integrator),
                    contacts=common.names_in(contact),
                    runs=runs,
                    out=out,
                    workers=workers,
                    plugins=plugin or [],
                    progress=progress,
                    changes=common.reference_of(reference),
                    longest=longest,
                )
        except KeyboardInterrupt:  # between two rounds of the search
            common.tell(CONTINUES)
            raise typer.Exit(INTERRUPTED) from None
        if plot is not None:
            answer.write(plot, write, work_and_precision(found.study), plot)
        answer.show(found.as_dict(), recommendation_lines(found))
        answer.conclude(recommendation_verdict(found))
        answer.exit_code = 0 if found.best is not None else 1
        if not found.study.complete:
            common.tell(CONTINUES)
            answer.exit_code = INTERRUPTED
