"""The command ``percuss study``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from percuss.cli.common import (
    AsJson,
    Outputs,
    Plugins,
    Workers,
    duration,
    option,
    print_json,
    print_verdict,
    progress_bar,
    reporting,
    tell,
)
from percuss.errors import Problem, printable, refuse_if_any
from percuss.process import INTERRUPTED


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY", help="YAML file of the study.")],
    out: Annotated[
        Path | None,
        option("-o --out FILE", "File of the rows; by default STUDY.sqlite in this folder."),
    ] = None,
    workers: Workers = None,
    scheduler: Annotated[str | None, option("--scheduler ADDRESS", "Use the workers of this Dask scheduler.")] = None,
    plugin: Plugins = None,
    again: Annotated[
        list[str] | None,
        option("--again STATUS", "Make the runs of a status again, for example failed. Repeatable."),
    ] = None,
    export: Annotated[Path | None, option("--export FILE", "Write the table as csv or parquet.")] = None,
    dry_run: Annotated[
        bool, option("--dry-run", "Check and count the runs and estimate the time; store nothing.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Make the runs of a study; given again, continue it."""
    with reporting(as_json):
        from percuss.reporting.verdict import rows_verdict
        from percuss.studies.study import study as make_study
        from percuss.studies.study_table import exportable

        if dry_run:
            of_rows = {"--out": out, "--export": export, "--again": again, "--scheduler": scheduler}
            message, advice = "expected --dry-run or {}, found both", "A dry run makes no rows."
            given = [name for name, value in of_rows.items() if value]
            refuse_if_any([Problem("percuss study", "", message.format(name), advice) for name in given])
            _print_forecast(file, plugin or [], workers or os.cpu_count() or 1, as_json=as_json)
            return
        if export is not None:
            exportable(export)
        with progress_bar("runs") as progress:
            notice = _ResumeNotice(progress)
            tables = [export] if export is not None else []
            made = make_study(
                file, out, workers, scheduler, notice, plugins=plugin or [], again=again or [], outputs=tables
            )
        outputs = Outputs()
        if export is not None:
            outputs.write(made.export, export)
        if as_json:
            print_json(_study_data(made))
        else:
            from percuss.reporting.tell_study import tell_study

            tell_study(made)
        rows = made.as_records()
        print_verdict(rows_verdict(rows, list(made.columns)), as_json=as_json)
        counts = made.counts
        if counts.get("waiting"):
            tell("interrupted: the same command continues from here")
        if lost := counts.get("lost"):
            tell(f"{lost} of {len(rows)} runs failed because of the machine: the same command makes them again")
        outputs.finish()
        if counts.get("waiting"):
            raise typer.Exit(INTERRUPTED)
        if not made.complete or not made.counts.get("done"):
            raise typer.Exit(1)


def _print_forecast(file: Path, plugins: list[Path], workers: int, *, as_json: bool) -> None:
    """Print how many runs a study has, which of them cannot be made, and what the others cost."""
    from percuss.reporting.verdict import rows_verdict
    from percuss.studies.forecast import forecast

    with progress_bar("runs") as progress:
        found = forecast(file, plugins, progress, workers=workers)
    able, part = found["counts"].get("waiting", 0), found["examined"] < found["runs"]
    if as_json:
        print_json(found)
    else:
        print(printable(f"{found['title'] or 'untitled study'}: {found['runs']} runs; none was stored"))
        can_run = f"{able} can run"
        if part:
            print(f"examined: {found['examined']} runs at equal distances, of which {can_run}")
        if found["seconds"] is not None:
            cores = f"{workers} worker{'s' if workers != 1 else ''}"
            time = f"roughly {duration(found['seconds'])} with {cores} by the time of the cheapest run"
            whose = "all runs, estimated from these" if part else can_run
            print(f"{whose}: {found['node_steps']:.3g} steps times nodes, {time}")
    print_verdict(rows_verdict(found["rows"], []), as_json=as_json)
    if not able:
        raise typer.Exit(1)


class _ResumeNotice:
    """A progress callback that prints at its first call how many runs are done already, and passes every call on."""

    def __init__(self, progress: Any) -> None:
        self.progress, self.announced = progress, False

    def __call__(self, done: int, total: int) -> None:
        if not self.announced and done:
            tell(f"{done} of {total} runs are stored already")
        self.announced = True
        self.progress(done, total)


def _study_data(made: Any) -> dict[str, Any]:
    return {
        "title": made.title,
        "file": str(made.path),
        "found": made.found,
        "complete": made.complete,
        "counts": made.counts,
        "columns": made.columns,
        "rows": made.as_records(),
    }
