"""The command ``percuss run``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from percuss.case.arguments import expect_suffix
from percuss.cli.common import (
    AsJson,
    CaseFile,
    Outputs,
    Plugins,
    Sets,
    exact_solution_shown,
    expect_drawable,
    load_case,
    option,
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

SEARCHED = ("method.contact", "method.integrator", "refine", "time.courant")  # values that a recommendation finds


def run(
    case: CaseFile,
    set_: Sets = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, option("-o --out FILE", "Save the result as NetCDF-4 (.nc).")] = None,
    plot: Annotated[
        Path | None,
        option("--plot FILE", "Draw the result as png, svg or pdf."),
    ] = None,
    animate: Annotated[
        Path | None, option("--animate FILE", "Show the waves as they run: gif or mp4 by suffix.")
    ] = None,
    exact_only: Annotated[bool, option("--exact-only", "Compute the exact solution only, without a method.")] = False,
    nudge: Annotated[bool, option("--nudge", "Also run a nudged twin: does the answer depend on round-off?")] = False,
    tied: Annotated[bool, option("--tied", "Tie the interfaces while the exact contact is closed.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run a case; print, save and draw its result."""
    with reporting(as_json):
        files = _Files(out, plot, animate)
        files.check_names()
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
        if (plot or animate) and loaded.record.fields == 0:
            loaded = loaded.with_overrides({"record.fields": 400})
        if as_json:
            print_notes(loaded)
        for path in files:
            if path is not None:
                expect_writable(path, loaded.inputs)
        words = shlex.join(["percuss", "recommend", str(case), *(f"--plugin={file}" for file in plugin or [])])
        lost = any(not change.startswith(SEARCHED) for change in set_ or [])
        search = f"`{words}`{' (first write the values of --set into the case)' if lost else ''}"
        _run(loaded, files, "" if tied else search, exact_only=exact_only, nudge=nudge, as_json=as_json)


class _Files(NamedTuple):
    """Files that the command writes, each a path or None."""

    out: Path | None
    plot: Path | None
    animate: Path | None

    def check_names(self) -> None:
        """Refuse a suffix that is not that of such a file, before the case is read."""
        if self.out is not None:
            expect_suffix(self.out, "a result", (".nc",), "Name it result.nc.")
        if self.plot is not None:
            expect_drawable(self.plot)
        if self.animate is not None:
            from percuss.reporting.animation import check_animation

            check_animation(self.animate)

    def write(self, result: Result) -> Outputs:
        """Save, draw and animate a result; a run that was not started has none."""
        outputs = Outputs()
        if result.status == "unstable" and result.summary["steps"] == 0:
            return outputs
        if self.out is not None:
            outputs.write(result.save, self.out)
        if self.plot is not None:
            outputs.write(result.plot, self.plot)
        if self.animate is not None:
            from percuss.reporting.animation import animate

            outputs.write(animate, result, self.animate)
        return outputs


def _run(case: Case, files: _Files, search: str, *, exact_only: bool, nudge: bool, as_json: bool) -> None:
    """Run a case or solve it exactly, and print, save and draw the result.

    `search` is a command that finds better methods, if there is.
    """
    from percuss.reporting.verdict import run_verdict
    from percuss.results.exact_only import run_exact
    from percuss.results.ledger import open_accounts
    from percuss.results.runner import run as run_case
    from percuss.studies.alternatives import alternatives

    failure: RunError | None = None
    with progress_bar() as progress, exact_solution_shown():
        try:
            result = run_exact(case) if exact_only else run_case(case, nudge=nudge, progress=progress)
        except RunError as error:
            if error.result is None:  # a plug-in raised it
                raise
            failure, result = error, error.result
    outputs = files.write(result)
    if as_json:
        errors = [*([str(failure)] if failure else []), *outputs.errors]
        print_json({"title": result.title, **result.summary, "error": "; ".join(errors) or None})
    else:
        from percuss.reporting.terminal import tell_result

        tell_result(result)
    if failure is not None:
        tell(f"error: {failure}")
    if result.marched:
        print_verdict(run_verdict(result, alternatives(case, result) if search else None, search), as_json=as_json)
    outputs.finish()
    if result.status == "interrupted" and result.marched:
        raise typer.Exit(INTERRUPTED)
    if result.status != "done" or open_accounts(result.summary):
        raise typer.Exit(1)
