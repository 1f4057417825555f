"""The command ``percuss verify``: cases against what they expect, results and rows again, methods with the kit."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from percuss.cli import common
from percuss.cli.common import option
from percuss.errors import InputError, PercussError, Problem
from percuss.files import is_file

if TYPE_CHECKING:
    from percuss.jsonable import Entries
    from percuss.results.rerun import Rerun

STUDY = b"SQLite format 3"
RESULTS = (b"\x89HDF", b"CDF")  # NetCDF-4, and older NetCDF, which is refused as what it is


def verify(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="CASE|RESULT|STUDY",
            help="Cases to compare with what they expect; results and files of studies to make again.",
        ),
    ] = None,
    plugin: Annotated[
        list[Path] | None,
        option("--plugin FILE", "Add a single-file plug-in; without a case, it is verified."),
    ] = None,
    row: Annotated[str, option("--row KEY", "Make one row of a study again; without it all that are done.")] = "",
    method: Annotated[list[str] | None, option("--method NAME", "Method to verify. Repeatable.")] = None,
    cases: Annotated[
        Path | None,
        typer.Option("--cases", metavar="FOLDER", file_okay=False, help="Write the case of each failed check."),
    ] = None,
    verbose: Annotated[bool, option("--verbose -v", "Give every check of a method, its demand and its case.")] = False,
    as_json: common.AsJson = False,
) -> None:
    """Verify cases, saved results, studies or methods.

    A case is compared with what it expects, a result or a row of a study with a second run, to the last bit, and a
    method is tried by the conformance kit.
    """
    with common.reporting(as_json) as answer:
        if files and method:
            raise InputError([Problem("percuss verify", "", "expected cases or --method, found both", "Give one.")])
        if files:
            passed = _verify_files(answer, files, plugin or [], row)
        else:
            from percuss.cli.kit import verify_methods

            passed = verify_methods(answer, plugin or [], method or [], cases, verbose=verbose)
        answer.exit_code = 0 if passed else 1


def _verify_files(answer: common.Answer, files: list[Path], plugins: list[Path], row: str) -> bool:
    """Print the checks of cases, results and rows of studies, and return whether all pass."""
    from percuss.reporting.terminal import check_lines, rerun_lines
    from percuss.results.rerun import rerun
    from percuss.studies.rows import rerun_rows

    cases: list[Entries] = []
    reruns: list[Rerun] = []
    for path in files:
        beginning = _beginning(path)
        if row or path.suffix == ".sqlite" or beginning.startswith(STUDY):
            with common.progress_bar("rows") as progress:
                reruns += rerun_rows(path, row, plugins, progress)
        elif path.suffix == ".nc" or beginning.startswith(RESULTS):
            reruns.append(rerun(path, plugins))
        else:
            cases.append(_verify_case(path, plugins))
    passed = all(case["passed"] for case in cases) and all(one.passed for one in reruns)
    checked = {"cases": cases, "results": [one.as_dict() for one in reruns]}
    pieces = chain(check_lines(cases) if cases else [], rerun_lines(reruns) if reruns else [])
    answer.show({"passed": passed, **{kind: entries for kind, entries in checked.items() if entries}}, pieces)
    return passed


def _beginning(path: Path) -> bytes:
    """Return the first bytes of a file; none of what cannot be read, which is told by reading it as a case."""
    try:
        if is_file(path):
            with path.open("rb") as file:
                return file.read(len(STUDY))
    except OSError:
        pass
    return b""


def _verify_case(path: Path, plugins: list[Path]) -> Entries:
    """Run a case, and return its checks with expected and measured values, its error and whether it passed."""
    from percuss.case.case import load
    from percuss.results.ledger import open_accounts
    from percuss.results.runner import run
    from percuss.results.verify import verify as verified

    case = load(path, plugins=plugins)
    try:
        result = run(case)
        if result.status == "interrupted":
            raise KeyboardInterrupt
        checks = [check.as_dict() for check in verified(case, result)]
        error = "; ".join(open_accounts(result.summary))
        error = error or ("" if checks else "the case expects nothing: add `expect`")
    except InputError:
        raise
    except PercussError as stopped:
        checks, error = [], str(stopped)
    passed = not error and all(check["passed"] for check in checks)
    return {"case": str(path), "title": case.title, "passed": passed, "error": error, "checks": checks}
