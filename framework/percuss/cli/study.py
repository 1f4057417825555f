"""The command ``percuss study``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percuss.case.arguments import expect_suffix
from percuss.cli import common
from percuss.cli.common import option
from percuss.process import INTERRUPTED


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY", help="YAML file of the study.")],
    out: Annotated[Path | None, option("-o --out FILE", "File of the rows; by default STUDY.sqlite here.")] = None,
    workers: common.Workers = None,
    scheduler: Annotated[str | None, option("--scheduler ADDRESS", "Use the workers of this Dask scheduler.")] = None,
    longest: common.Longest = None,
    plugin: common.Plugins = None,
    reference: common.Reference = "",
    again: Annotated[list[str] | None, option("--again STATUS", "Make the runs of a status again.")] = None,
    export: Annotated[Path | None, option("--export FILE", "Write the table as csv.")] = None,
    dry_run: Annotated[bool, option("--dry-run", "Check the study and count its runs; make none.")] = False,
    as_json: common.AsJson = False,
) -> None:
    """Make the runs of a study; given again, continue it."""
    with common.reporting(as_json) as answer:
        from percuss.reporting.terminal import study_lines
        from percuss.reporting.verdict import rows_verdict
        from percuss.studies.pool import number_of_workers
        from percuss.studies.spec import read_study
        from percuss.studies.study import planned
        from percuss.studies.study import study as make_study

        if dry_run:
            number_of_workers(workers)
            spec = read_study(file, plugin or [], common.reference_of(reference))
            title, runs = str(spec.data.get("title", "")), len(planned(spec)[0])
            answer.show({"title": title, "runs": runs}, [f"{title or 'untitled study'}: {runs} runs; none was made"])
            return
        if export is not None:
            expect_suffix(export, "a table", (".csv",), "Name it table.csv.")
        with common.progress_bar("runs") as progress:
            made = make_study(
                file,
                out,
                workers,
                scheduler,
                progress,
                plugins=plugin or [],
                again=again or [],
                outputs=[export] if export is not None else [],
                changes=common.reference_of(reference),
                longest=longest,
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
        if lost := [row["reason"] for row in rows if row["status"] == "lost"]:
            common.tell(
                f"{len(lost)} of {len(rows)} runs lost; the same command makes them again. The first: {lost[0]}"
            )
