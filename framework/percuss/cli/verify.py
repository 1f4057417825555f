"""The command ``percuss verify``: cases against what they expect, results and rows again, methods with the kit."""

from __future__ import annotations

import os
import textwrap
from collections import Counter
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from percuss.cli import common
from percuss.cli.common import option
from percuss.errors import InputError, PercussError, PluginError, Problem
from percuss.files import is_file

if TYPE_CHECKING:
    from percuss.jsonable import Entries
    from percuss.methods.registry import Key, Registry
    from percuss.results.rerun import Rerun
    from percuss.testing.kit import Outcome

BEGINNING_OF_STUDIES = (b"SQLite format 3",)
BEGINNINGS_OF_RESULTS = (b"\x89HDF", b"CDF")  # NetCDF-4, and older NetCDF, which is refused as what it is


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
            methods = _run_kit(plugin or [], method or [], quiet=as_json, verbose=verbose)
            passed = all(one["passed"] for one in methods)
            lines = [f"cases of failed checks in {cases}: {_write_cases(cases, methods)}"] if cases else []
            answer.show({"passed": passed, "methods": methods}, lines)
        answer.exit_code = 0 if passed else 1


def _verify_files(answer: common.Answer, files: list[Path], plugins: list[Path], row: str) -> bool:
    """Print the checks of cases, results and rows of studies, and return whether all pass."""
    from percuss.reporting.terminal import check_lines, rerun_lines
    from percuss.results.rerun import rerun
    from percuss.studies.rows import rerun_rows

    cases: list[Entries] = []
    reruns: list[Rerun] = []
    if row and not all(_begins(path, BEGINNING_OF_STUDIES) for path in files):
        raise InputError([Problem("percuss verify", "", "expected the file of a study with --row", "Name it.")])
    for path in files:
        if _begins(path, BEGINNING_OF_STUDIES):
            with common.progress_bar("rows") as progress:
                reruns += rerun_rows(path, row, plugins, progress)
        elif path.suffix == ".nc" or _begins(path, BEGINNINGS_OF_RESULTS):
            reruns.append(rerun(path, plugins))
        else:
            cases.append(_verify_case(path, plugins))
    passed = all(case["passed"] for case in cases) and all(one.passed for one in reruns)
    checked = {"cases": cases, "results": [one.as_dict() for one in reruns]}
    pieces = chain(check_lines(cases) if cases else [], rerun_lines(reruns) if reruns else [])
    answer.show({"passed": passed, **{kind: entries for kind, entries in checked.items() if entries}}, pieces)
    return passed


def _begins(path: Path, beginnings: tuple[bytes, ...]) -> bool:
    """Return whether a file begins with one of some bytes."""
    if not is_file(path):  # reading it as a case gives the message
        return False
    try:
        with path.open("rb") as file:
            return file.read(15).startswith(beginnings)
    except OSError:
        return False


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


def _run_kit(files: list[Path], names: list[str], *, quiet: bool, verbose: bool) -> list[Entries]:
    """Run the conformance kit on the named methods, or else on those of the files; tell of each unless `quiet`."""
    from percuss.methods.registry import Registry
    from percuss.reporting.component import components_named

    try:
        from hypothesis.configuration import set_hypothesis_home_dir
    except ModuleNotFoundError:
        raise PluginError("the kit draws its cases with hypothesis: pip install 'percuss[kit]'") from None
    # Hypothesis would otherwise keep what it computes in the user's current folder.
    set_hypothesis_home_dir(os.devnull)
    registry = Registry.load(files)
    keys = [key for name in names for key in components_named(registry, name, f"--method {name}")]
    # without a name, every component that is registered by a single file
    keys = keys or [key for key, source in registry.sources.items() if not source.distribution]
    if not keys:
        advice = "Give a single-file plug-in (--plugin FILE), a method (--method NAME) or a case."
        raise InputError([Problem("percuss verify", "", "nothing to verify", advice)])
    methods = []
    for key in keys:
        outcomes, unmade = _outcomes(registry, key, verbose=verbose and not quiet)
        if not quiet:
            print("\n".join(_told(key, outcomes, unmade, verbose=verbose)), flush=True)
        passed = all(one.status != "failed" for one in outcomes)
        checks = [one._asdict() for one in outcomes]
        methods.append({"name": key[1], "family": key[0], "passed": passed, "unmade": unmade, "checks": checks})
    return methods


def _outcomes(registry: Registry, key: Key, *, verbose: bool) -> tuple[list[Outcome], int]:
    """Return the outcomes of the checks of a method, and how many were not made because it cannot run."""
    from percuss.testing.kit import checks, outcome_of

    planned = list(checks(registry.components[key], registry=registry))
    outcomes: list[Outcome] = []
    with common.progress_bar(f"checks of {key[1]}") as progress:
        for name, check in planned:
            outcomes.append(outcome_of(check))
            progress(len(outcomes), len(planned))
            if verbose:
                print(here(str(outcomes[-1])), flush=True)
            if name == "starts" and outcomes[-1].status == "failed":
                break
    return outcomes, len(planned) - len(outcomes)


def _told(key: Key, outcomes: list[Outcome], unmade: int, *, verbose: bool) -> Iterator[str]:
    """Yield the lines on a method: those on its failures with the case of each, or the smallest case, and a verdict."""
    failed = [one for one in outcomes if one.status == "failed"]
    smallest = min((one for one in failed if one.case), key=lambda one: len(one.case), default=None)
    for one in failed:
        yield here(f"{one.name}: {one.message}")
        if verbose:
            yield textwrap.indent(f"{textwrap.fill(f'demanded: {one.demand}', 96)}\n{one.case}", "    ")
    if smallest and not verbose:
        yield f"\nThe smallest case, of {smallest.name}:\n{textwrap.indent(smallest.case.rstrip(), '    ')}"
    if unmade:
        yield f"\nIt cannot run, so {unmade} checks were not made."
    if failed and all(" with " in one.name for one in failed):
        yield "\nIf this is the nature of the method, declare it in its class, with the reason:"
        yield f'    expected_failures = {{"{failed[0].name}": "why"}}'
    counts = ", ".join(f"{count} {status}" for status, count in Counter(one.status for one in outcomes).items())
    yield f"{key[1]} ({key[0]}) {'DOES NOT CONFORM' if failed else 'conforms'}: {counts}"


def _write_cases(folder: Path, methods: list[Entries]) -> int:
    """Write the case of each failed check to a file of its name in a folder, and return how many there are."""
    folder.mkdir(parents=True, exist_ok=True)
    named = [
        (f"{method['name']}-{check['name'].replace(' ', '-')}.yaml", check["case"])
        for method in methods
        for check in method["checks"]
        if check["case"]
    ]
    for name, case in named:
        (folder / name).write_text(case, encoding="utf-8")
    return len(named)


def here(text: str) -> str:
    """Return a text with the paths of files below the current folder relative to it."""
    return text.replace(f"{Path.cwd()}{os.sep}", "")
