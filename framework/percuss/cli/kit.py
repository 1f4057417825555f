"""The conformance kit on the command line: ``percuss verify --plugin FILE`` and ``percuss verify --method NAME``."""

from __future__ import annotations

import os
import textwrap
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from percuss.cli import common
from percuss.errors import InputError, PluginError, Problem
from percuss.jsonable import Entries
from percuss.methods.registry import Key, Registry
from percuss.reporting.component import components_named


def verify_methods(
    answer: common.Answer, files: list[Path], names: list[str], folder: Path | None, *, verbose: bool
) -> bool:
    """Run the conformance kit on the named methods, or else on those of the files; return whether all conform."""
    try:
        from hypothesis.configuration import set_hypothesis_home_dir

        from percuss.testing.kit import Outcome, checks, outcome_of
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
    lines = [f"cases of failed checks in {folder}: {_write_cases(folder, methods)}"] if folder else []
    all_passed = all(one["passed"] for one in methods)
    answer.show({"passed": all_passed, "methods": methods}, lines)
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


def _here(text: str) -> str:
    """Return a text with the paths of files below the current folder relative to it."""
    return text.replace(f"{Path.cwd()}{os.sep}", "")
