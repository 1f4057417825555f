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

if TYPE_CHECKING:
    from percuss.jsonable import Entries
    from percuss.methods.registry import Key
    from percuss.results.rerun import Rerun


def verify(
    files: Annotated[list[Path] | None, typer.Argument(metavar="CASE|RESULT|STUDY", help="What to verify.")] = None,
    plugin: Annotated[list[Path] | None, option("--plugin FILE", "Add a plug-in; without a case, verify it.")] = None,
    row: Annotated[str, option("--row KEY", "Make one row of a study again; without it all that are done.")] = "",
    method: Annotated[list[str] | None, option("--method NAME", "Method to verify. Repeatable.")] = None,
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
            passed = _verify_methods(answer, plugin or [], method or [], verbose=verbose)
        answer.exit_code = 0 if passed else 1


def _verify_files(answer: common.Answer, files: list[Path], plugins: list[Path], row: str) -> bool:
    """Print the checks of cases, results and rows of studies, and return whether all pass."""
    from percuss.reporting.terminal import check_lines, rerun_lines
    from percuss.results.rerun import rerun
    from percuss.studies.study_table import rerun_rows

    cases: list[Entries] = []
    reruns: list[Rerun] = []
    for path in files:
        if row or path.suffix == ".sqlite":
            with common.progress_bar("rows") as progress:
                reruns += rerun_rows(path, row, plugins, progress)
        elif path.suffix == ".nc":
            reruns.append(rerun(path, plugins))
        else:
            cases.append(_verify_case(path, plugins))
    passed = all(case["passed"] for case in cases) and all(one.passed for one in reruns)
    checked = {"cases": cases, "results": [one.as_dict() for one in reruns]}
    pieces = chain(check_lines(cases) if cases else [], rerun_lines(reruns) if reruns else [])
    answer.show({"passed": passed, **{kind: entries for kind, entries in checked.items() if entries}}, pieces)
    return passed


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


def _verify_methods(answer: common.Answer, files: list[Path], names: list[str], *, verbose: bool) -> bool:
    """Run the conformance kit on the named methods, or else on those of the files; return whether all conform."""
    try:
        from hypothesis.configuration import set_hypothesis_home_dir

        from percuss.testing.kit import Outcome, checks, outcome_of
    except ModuleNotFoundError:
        raise PluginError("the kit draws its cases with hypothesis: pip install 'percuss[kit]'") from None
    # Hypothesis would otherwise keep what it computes in the user's current folder.
    set_hypothesis_home_dir(os.devnull)
    from percuss.methods.registry import Registry
    from percuss.reporting.component import components_named

    registry = Registry.load(files)
    keys = [key for name in names for key in components_named(registry, name, f"--method {name}")]
    # without a name, every component that is registered by a single file
    keys = keys or [key for key, source in registry.sources.items() if not source.distribution]
    if not keys:
        advice = "Give a single-file plug-in (--plugin FILE), a method (--method NAME) or a case."
        raise InputError([Problem("percuss verify", "", "nothing to verify", advice)])
    methods: list[Entries] = []
    for key in keys:
        planned, outcomes = list(checks(registry.components[key], registry=registry)), list[Outcome]()
        with common.progress_bar(f"checks of {key[1]}") as progress:
            for name, check in planned:
                outcomes.append(outcome_of(check))
                progress(len(outcomes), len(planned))
                if verbose and not answer.as_json:
                    print(_here(str(outcomes[-1])), flush=True)
                if name == "starts" and outcomes[-1].status == "failed":
                    break
        entries = [one._asdict() for one in outcomes]
        unmade, passed = len(planned) - len(outcomes), all(one.status != "failed" for one in outcomes)
        if not answer.as_json:
            print("\n".join(map(_here, _told(key, entries, unmade, verbose=verbose))), flush=True)
        methods.append({"name": key[1], "family": key[0], "passed": passed, "unmade": unmade, "checks": entries})
    all_passed = all(one["passed"] for one in methods)
    answer.show({"passed": all_passed, "methods": methods}, [])
    return all_passed


def _told(key: Key, outcomes: list[Entries], unmade: int, *, verbose: bool) -> Iterator[str]:
    """Yield the lines on a method: those on its failures with the case of each, or the smallest case, and a verdict."""
    failed = [one for one in outcomes if one["status"] == "failed"]
    smallest = min((one for one in failed if one["case"]), key=lambda one: len(one["case"]), default=None)
    for one in failed:
        yield f"{one['name']}: {one['message']}"
        if verbose:
            demanded = textwrap.fill(f"demanded: {one['demand']}", 96)
            yield textwrap.indent(f"{demanded}\n{one['case']}", "    ")
    if smallest and not verbose:
        yield f"\nThe smallest case, of {smallest['name']}:\n{textwrap.indent(smallest['case'].rstrip(), '    ')}"
    if unmade:
        yield f"\nIt cannot run, so {unmade} checks were not made."
    if failed and all(" with " in one["name"] for one in failed):
        first = failed[0]["name"]
        yield "\nIf this is the nature of the method, declare it in its class, with the reason:"
        yield f'    expected_failures = {{"{first}": "why"}}'
    counts = ", ".join(f"{count} {status}" for status, count in Counter(one["status"] for one in outcomes).items())
    yield f"{key[1]} ({key[0]}) {'DOES NOT CONFORM' if failed else 'conforms'}: {counts}"


def _here(text: str) -> str:
    """Return a text with the paths of files below the current folder relative to it."""
    return text.replace(f"{Path.cwd()}{os.sep}", "")
