"""The command ``percuss run``."""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from percuss.case.arguments import expect_suffix
from percuss.cli import common
from percuss.cli.common import option
from percuss.errors import InputError, Problem, RunError
from percuss.files import expect_writable
from percuss.interrupt import heard_by
from percuss.process import INTERRUPTED

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.jsonable import Data
    from percuss.results.result import Result

RESULTS = (".nc", ".vtkhdf")


def run(
    case: common.CaseFile,
    set_: common.Sets = None,
    plugin: common.Plugins = None,
    out: Annotated[Path | None, option("-o --out FILE", "Save as .nc (NetCDF-4), or .vtkhdf (ParaView).")] = None,
    plot: Annotated[Path | None, option("--plot FILE", "Draw the result as png, svg or pdf.")] = None,
    animate: Annotated[Path | None, option("--animate FILE", "Show stress and motion as gif or mp4.")] = None,
    exact_only: Annotated[bool, option("--exact-only", "Compute the exact solution only, without a method.")] = False,
    nudge: Annotated[bool, option("--nudge", "Also run a nudged twin: does the answer depend on round-off?")] = False,
    tied: Annotated[bool, option("--tied", "Tie the interfaces while the exact contact is closed.")] = False,
    reference: common.Reference = "",
    row: Annotated[str, option("--row KEY", "CASE is the file of a study: make its row with this key.")] = "",
    resume: Annotated[bool, option("--resume", "Go on from the state that a killed run has saved.")] = False,
    threads: Annotated[int | None, option("--threads N", "Number of threads; by default one a core.")] = None,
    as_json: common.AsJson = False,
) -> None:
    """Run a case; print, save and draw its result."""
    with common.reporting(as_json) as answer:
        from percuss.reporting.terminal import result_lines
        from percuss.reporting.verdict import run_verdict
        from percuss.results.ledger import open_accounts
        from percuss.results.netcdf import expect_meshes

        for_paraview = out is not None and expect_suffix(out, "a result", RESULTS, "Name it result.nc.") == RESULTS[1]
        common.expect_drawable(plot)
        if animate is not None:
            from percuss.reporting import animation

            animation.check_animation(animate)
        others = {"--tied": tied, "--resume": resume, "--threads": threads is not None}
        if exact_only and any(others.values()):
            both = f"expected {next(filter(others.get, others))} or --exact-only, found both"
            advice = "An exact solution has no interface to tie." if tied else "An exact solution makes no steps."
            raise InputError([Problem("percuss run", "", both, advice)])
        loaded = common.load_case(case, set_, plugin, partial(_of_row, row) if row else None, reference)
        if tied:
            from percuss.studies.perform import tied_twin

            loaded = tied_twin(loaded)
        if out is not None and for_paraview:
            expect_meshes(out, present=not loaded.of_bars)
        if (plot or animate or for_paraview) and loaded.record.fields == 0:
            loaded = loaded.with_overrides({"record.fields": 400 if loaded.of_bars else 100})
        if as_json:
            common.print_notes(loaded)
        for path in filter(None, (out, plot, animate)):
            expect_writable(path, loaded.inputs)
        result, failure = _outcome(loaded, exact_only=exact_only, nudge=nudge, resume=resume, threads=threads)
        if result.status != "unstable" or result.summary["steps"]:  # a run that was not started has nothing to show
            answer.write(out, result.save, out)
            answer.write(plot, result.plot, plot)
            if animate is not None:
                answer.write(animate, animation.animate, result, animate)
        errors = [*([str(failure)] if failure else []), *answer.unwritten]
        # A case that is somebody else's may name plug-ins, whose code has been executed.
        files = [str(file.path) for file in loaded.registry.single_files]
        data = {"title": result.title, **result.summary, "plugin_files": files, "error": "; ".join(errors) or None}
        answer.show(data, (*result_lines(result), *(f"plug-in: {file}" for file in files)))
        if failure is not None:
            common.tell(f"error: {failure}")
        answer.exit_code = 1 if result.status != "done" or open_accounts(result.summary) else 0
        if result.marched:
            search = "" if tied or row or loaded.bonds else f"`percuss recommend {shlex.quote(str(case))} --error 1%`"
            answer.conclude(run_verdict(result, search))
            if result.status == "interrupted":
                answer.exit_code = INTERRUPTED


def _of_row(row: str, file: Path, overrides: Data, plugins: list[Path]) -> Case:
    """Return the case of a row of a study."""
    from percuss.studies.study_table import StoredRows

    rows = StoredRows(file, plugins)
    return rows.case(rows.key(row)).with_overrides(overrides)


def _outcome(
    case: Case, *, exact_only: bool, nudge: bool, resume: bool, threads: int | None
) -> tuple[Result, RunError | None]:
    """Return the result of a case or its exact solution, and the error that stopped the run, if one did."""
    from percuss.results.runner import run as run_case

    of_exact = common.progress_bar("percent of the exact solution")
    with common.progress_bar() as progress, of_exact as show, heard_by(lambda share: show(int(100 * share), 100)):
        try:
            if not exact_only:
                return run_case(case, nudge=nudge, progress=progress, resume=resume, threads=threads), None
            from percuss.results.exact_only import run_exact

            return run_exact(case), None
        except RunError as error:
            if error.result is None:  # a plug-in raised it
                raise
            return error.result, error
