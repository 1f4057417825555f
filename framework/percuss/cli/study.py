"""The command ``percuss study``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from percuss.cli import common
from percuss.cli.common import option
from percuss.errors import Problem, refuse_if_any
from percuss.process import INTERRUPTED

if TYPE_CHECKING:
    from percuss.jsonable import Data


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY", help="YAML file of the study.")],
    out: Annotated[
        Path | None,
        option("-o --out FILE", "File of the rows; by default STUDY.sqlite in this folder."),
    ] = None,
    workers: common.Workers = None,
    scheduler: Annotated[str | None, option("--scheduler ADDRESS", "Use the workers of this Dask scheduler.")] = None,
    plugin: common.Plugins = None,
    reference: common.Reference = "",
    again: Annotated[
        list[str] | None,
        option("--again STATUS", "Make the runs of a status again, for example failed. Repeatable."),
    ] = None,
    export: Annotated[Path | None, option("--export FILE", "Write the table as csv or parquet.")] = None,
    dry_run: Annotated[
        bool, option("--dry-run", "Check and count the runs and estimate the time; store nothing.")
    ] = False,
    as_json: common.AsJson = False,
) -> None:
    """Make the runs of a study; given again, continue it."""
    with common.reporting(as_json) as answer:
        from percuss.reporting.terminal import study_lines
        from percuss.reporting.verdict import rows_verdict
        from percuss.studies.dispatch import number_of_workers
        from percuss.studies.forecast import forecast
        from percuss.studies.study import study as make_study
        from percuss.studies.study_table import exportable

        if dry_run:
            of_rows = {"--out": out, "--export": export, "--again": again, "--scheduler": scheduler}
            message, advice = "expected --dry-run or {}, found both", "A dry run makes no rows."
            given = [name for name, value in of_rows.items() if value]
            refuse_if_any([Problem("percuss study", "", message.format(name), advice) for name in given])
            workers = number_of_workers(workers)
            with common.progress_bar("runs") as progress:
                found = forecast(file, plugin or [], progress, workers=workers, changes=common.reference_of(reference))
            answer.show(found, _forecast_lines(found, workers))
            answer.conclude(rows_verdict(found["rows"], []))
            answer.exit_code = 0 if found["counts"].get("waiting") else 1
            return
        if export is not None:
            exportable(export)
        with common.progress_bar("runs") as progress:
            notice = _ResumeNotice(progress)
            tables = [export] if export is not None else []
            made = make_study(
                file,
                out,
                workers,
                scheduler,
                notice,
                plugins=plugin or [],
                again=again or [],
                outputs=tables,
                changes=common.reference_of(reference),
            )
        rows, counts = made.as_records(), made.counts
        answer.write(export, made.export, export)
        data = {"title": made.title, "file": str(made.path), "rows": rows}
        data |= {name: getattr(made, name) for name in ("found", "complete", "counts", "columns")}
        answer.show(data, study_lines(made))
        answer.conclude(rows_verdict(rows, list(made.columns)))
        answer.exit_code = 0 if made.complete and counts.get("done") else 1
        if counts.get("waiting"):
            common.tell("interrupted: the same command continues from here")
            answer.exit_code = INTERRUPTED
        if lost := counts.get("lost"):
            common.tell(f"{lost} of {len(rows)} runs failed because of the machine: the same command makes them again")


def _forecast_lines(found: Data, workers: int) -> Iterator[str]:
    """Yield how many runs a study has, which of them can be made, and what these cost."""
    from percuss.reporting.tables import duration

    can_run, part = f"{found['counts'].get('waiting', 0)} can run", found["examined"] < found["runs"]
    yield f"{found['title'] or 'untitled study'}: {found['runs']} runs; none was stored"
    if part:
        yield f"examined: {found['examined']} runs at equal distances, of which {can_run}"
    if found["seconds"] is not None:
        cores = f"{workers} worker{'s' if workers != 1 else ''}"
        time = f"roughly {duration(found['seconds'])} with {cores} by the time of the cheapest run"
        whose = "all runs, estimated from these" if part else can_run
        yield f"{whose}: {found['node_steps']:.3g} steps times stages times nodes, {time}"


class _ResumeNotice:
    """A progress callback that prints at its first call how many runs are done already, and passes every call on."""

    def __init__(self, progress: Callable[[int, int], None]) -> None:
        self.progress, self.announced = progress, False

    def __call__(self, done: int, total: int) -> None:
        if not self.announced and done:
            common.tell(f"{done} of {total} runs are stored already")
        self.announced = True
        self.progress(done, total)
