"""The command ``percuss run``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from percuss.cli.common import (
    AsJson,
    CaseFile,
    Outputs,
    Plugins,
    Sets,
    exact_solution_shown,
    expect_drawable,
    load_case,
    print_json,
    print_notes,
    print_verdict,
    progress_bar,
    reporting,
    tell,
)
from percuss.errors import InputError, Problem, RunError
from percuss.files import expect_writable
from percuss.process import INTERRUPTED

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.results.result import Result


def run(
    case: CaseFile,
    set_: Sets = None,
    plugin: Plugins = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Save the result as NetCDF-4 (.nc).")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the result as png, svg or pdf."),
    ] = None,
    exact_only: Annotated[
        bool, typer.Option("--exact-only", help="Compute the exact solution only, without a method.")
    ] = False,
    nudge: Annotated[
        bool, typer.Option("--nudge", help="Also run a nudged twin: does the answer depend on round-off?")
    ] = False,
    tied: Annotated[bool, typer.Option("--tied", help="Tie the interfaces while the exact contact is closed.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run a case; print, save and draw its result."""
    with reporting(as_json):
        _expect_netcdf(out)
        if plot is not None:
            expect_drawable(plot)
        if tied and exact_only:
            both = "expected --tied or --exact-only, found both"
            raise InputError([Problem("percuss run", "", both, "An exact solution has no interface to tie.")])
        if exact_only:
            from percuss.results.exact_only import load_for_exact

            loaded = load_case(case, set_, plugin, read=load_for_exact)
        else:
            loaded = load_case(case, set_, plugin)
        if tied:
            from percuss.studies.perform import tied_twin

            loaded = tied_twin(loaded)
        if plot is not None and loaded.record.fields == 0:
            loaded = loaded.with_overrides({"record.fields": 400})
        if as_json:
            print_notes(loaded)
        for path in (out, plot):
            if path is not None:
                expect_writable(path, loaded.inputs)
        if exact_only:
            _solve(loaded, out, plot, as_json=as_json)
        else:
            search = shlex.join(["percuss", "recommend", str(case), *(f"--plugin={file}" for file in plugin or [])])
            _run(loaded, out, plot, "" if tied else search, nudge=nudge, as_json=as_json)


def _expect_netcdf(out: Path | None) -> None:
    """Refuse a result whose suffix is not of NetCDF, before the case is read."""
    if out is not None and out.suffix.lower() != ".nc":
        message = f"expected a result ending in .nc, found {out.suffix or 'no ending'}"
        raise InputError([Problem(str(out), "", message, "Name it result.nc.")])


def _solve(case: Case, out: Path | None, plot: Path | None, *, as_json: bool) -> None:
    """Print, save and draw the exact solution of a case."""
    from percuss.results.exact_only import run_exact

    with exact_solution_shown():
        result = run_exact(case)
    outputs = Outputs()
    if out is not None:
        outputs.write(result.save, out)
    if plot is not None:
        from percuss.reporting.exact_figure import plot_exact

        outputs.write(plot_exact, result, plot)
    if as_json:
        print_json({"title": result.title, **result.summary, "error": "; ".join(outputs.errors) or None})
    else:
        from percuss.reporting.terminal import tell_exact

        tell_exact(result)
    outputs.finish()
    if result.status != "done":
        raise typer.Exit(1)


def _run(case: Case, out: Path | None, plot: Path | None, search: str, *, nudge: bool, as_json: bool) -> None:
    """Run a case, and print, save and draw its result; `search` is a command that finds better methods, if there is."""
    from percuss.reporting.verdict import run_verdict
    from percuss.results.ledger import open_accounts
    from percuss.results.runner import run as run_case
    from percuss.studies.alternatives import alternatives

    failure: RunError | None = None
    with progress_bar() as progress, exact_solution_shown():
        try:
            result = run_case(case, nudge=nudge, progress=progress)
        except RunError as error:
            if error.result is None:  # a plug-in raised it
                raise
            failure, result = error, error.result
    outputs = _written_outputs(result, out, plot)
    if as_json:
        errors = [*([str(failure)] if failure else []), *outputs.errors]
        print_json({"title": result.title, **result.summary, "error": "; ".join(errors) or None})
    else:
        from percuss.reporting.terminal import tell_result

        tell_result(result)
    if failure is not None:
        tell(f"error: {failure}")
    print_verdict(run_verdict(result, alternatives(case, result) if search else None, search), as_json=as_json)
    outputs.finish()
    if result.status == "interrupted":
        raise typer.Exit(INTERRUPTED)
    if result.status != "done" or open_accounts(result.summary):
        raise typer.Exit(1)


def _written_outputs(result: Result, out: Path | None, plot: Path | None) -> Outputs:
    """Save and draw a result."""
    outputs = Outputs()
    if result.status == "unstable" and result.summary["steps"] == 0:
        return outputs  # A run that was not started has no result to save or draw.
    if out is not None:
        outputs.write(result.save, out)
    if plot is not None:
        from percuss.reporting.run_figure import plot_result

        outputs.write(plot_result, result, plot)
    return outputs
