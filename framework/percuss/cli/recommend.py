"""The command ``percuss recommend``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percuss.cli.common import (
    AsJson,
    CaseFile,
    Outputs,
    Plugins,
    Workers,
    expect_drawable,
    names_in,
    option,
    print_json,
    print_verdict,
    progress_bar,
    reporting,
    tell,
)
from percuss.process import INTERRUPTED


def recommend(
    case: CaseFile,
    error: Annotated[str, option("--error BOUND", "Largest error, for example 1%.")] = "",
    energy: Annotated[str, option("--energy BOUND", "Largest share of the energy that contacts take or add.")] = "",
    time: Annotated[str, option("--time SECONDS", "Longest time of a march.")] = "",
    measure: Annotated[str, option("--measure NAME", "Error to bound.")] = "force_error_l1",
    integrator: Annotated[str, option("--integrator A,B", "Integrators to choose from; by default all.")] = "",
    contact: Annotated[str, option("--contact X,Y", "Contact laws to choose from; by default all.")] = "",
    runs: Annotated[int, option("--runs N", "Largest number of runs.")] = 400,
    seed: Annotated[int, option("--seed N", "Seed of the order in which pairs are tried.")] = 0,
    out: Annotated[
        Path | None,
        option("-o --out FILE", "File of the runs; by default CASE-recommend.sqlite."),
    ] = None,
    workers: Workers = None,
    plugin: Plugins = None,
    plot: Annotated[Path | None, option("--plot FILE", "Draw the error of all runs over their cost.")] = None,
    as_json: AsJson = False,
) -> None:
    """Search the cheapest methods, mesh and step within bounds.

    The same command given again continues the search.
    """
    with reporting(as_json):
        from percuss.reporting.tell_recommendation import recommendation_verdict, tell_recommendation
        from percuss.studies.recommendation import bound_of
        from percuss.studies.recommendation import recommend as search

        if plot is not None:
            expect_drawable(plot)
        bounds = {name: bound_of(text, f"--{name}") for name, text in (("error", error), ("energy", energy))}
        with progress_bar("runs") as progress:
            found = search(
                case,
                **bounds,
                seconds=bound_of(time, "--time"),
                measure=measure,
                integrators=names_in(integrator),
                contacts=names_in(contact),
                runs=runs,
                seed=seed,
                out=out,
                workers=workers,
                plugins=plugin or [],
                progress=progress,
                outputs=[plot] if plot is not None else [],
            )
        outputs = Outputs()
        if plot is not None:
            from percuss.reporting.recommendation_figure import recommendation_figure

            outputs.draw(plot, recommendation_figure(found))
        if as_json:
            print_json(found.as_dict())
        else:
            tell_recommendation(found)
        print_verdict(recommendation_verdict(found), as_json=as_json)
        outputs.finish()
        if not found.study.complete:
            tell("interrupted: the same command continues from here")
            raise typer.Exit(INTERRUPTED)
        if found.best is None:
            raise typer.Exit(1)
