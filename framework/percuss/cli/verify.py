"""The command that holds cases against what they expect, and methods against what the contract demands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from percuss.cli.common import AsJson, print_json, reporting
from percuss.errors import InputError, PercussError, PluginError, Problem

if TYPE_CHECKING:
    from percuss.methods.registry import Registry
    from percuss.testing import Report


def verify(
    cases: Annotated[
        list[Path] | None, typer.Argument(metavar="[CASE]...", help="YAML files of cases, run against their `expect`.")
    ] = None,
    plugin: Annotated[
        list[Path] | None,
        typer.Option("--plugin", metavar="FILE", help="A single-file plug-in; without a case, what is verified."),
    ] = None,
    method: Annotated[
        list[str] | None, typer.Option("--method", metavar="NAME", help="A registered method to verify; repeatable.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Verify cases by what they expect of themselves, or methods by the conformance kit."""
    with reporting(as_json):
        if cases and not method:
            told = [_case(path, plugin) for path in cases]
            good, data = all(t["passed"] for t in told), {"cases": told}
        elif cases:
            raise InputError([Problem("percuss verify", "", "expected cases or --method, found both", "Give one.")])
        else:
            reports = _reports(plugin or [], method or [], quiet=as_json)
            good = all(report.passed for report in reports)
            data = {"methods": [report.as_dict() for report in reports]}
        if as_json:
            print_json({"passed": good, **data})
        elif cases:
            from percuss.reporting.terminal import tell_checks

            tell_checks(data["cases"])
        if not good:
            raise typer.Exit(1)


def _case(path: Path, plugins: list[Path] | None) -> dict[str, Any]:
    """Run a case and return what it expected and what came out."""
    from percuss.case.case import load
    from percuss.results.ledger import open_accounts
    from percuss.results.runner import run
    from percuss.results.verify import verify as verified

    case = load(path, plugins=plugins or [])
    try:
        result = run(case)
        checks = [c.as_dict() for c in verified(case, result)]
        error = "; ".join(open_accounts(result.summary))
        error = error or ("" if checks else "the case expects nothing: add `expect`")
    except PercussError as stopped:
        checks, error = [], str(stopped)
    passed = not error and all(c["passed"] for c in checks)
    return {"case": str(path), "title": case.title, "passed": passed, "error": error, "checks": checks}


def _reports(files: list[Path], names: list[str], *, quiet: bool) -> list[Report]:
    """Run the kit on what the files register and on the methods named, telling each check as it is done."""
    import platformdirs

    from percuss.methods.registry import Registry
    from percuss.reporting.component import components_named
    from percuss.testing.kit import Outcome, Report, checks_of, perform
    from percuss.testing.subject import Subject

    try:
        from hypothesis.configuration import set_hypothesis_home_dir
    except ModuleNotFoundError:
        raise PluginError("the kit draws its cases with hypothesis: pip install 'percuss[kit]'") from None
    # not into the user's folder
    set_hypothesis_home_dir(platformdirs.user_cache_path("percuss", appauthor=False) / "hypothesis")
    registry = Registry.load(files)
    keys = [key for name in names for key in components_named(registry, name)] or _of_files(registry)
    if not keys:
        advice = "Give a single-file plug-in (--plugin FILE), a method (--method NAME) or a case."
        raise InputError([Problem("percuss verify", "", "nothing to verify", advice)])
    say: Callable[[str], None] = (lambda _: None) if quiet else print
    reports = []
    for key in keys:
        subject = Subject.of(registry.components[key], registry)
        say(f"{subject.name} ({subject.family}), {registry.sources[key]}")
        outcomes: list[Outcome] = []
        for one, partner in checks_of(subject):
            outcomes.append(perform(one, subject, partner))
            say(str(outcomes[-1]))
        reports.append(Report(subject.component, tuple(outcomes)))
        say(f"{reports[-1].verdict}\n")
    return reports


def _of_files(registry: Registry) -> list[tuple[str, str]]:
    """Return the (family, name) of what single files register."""
    return [key for key, source in registry.sources.items() if not source.distribution]
