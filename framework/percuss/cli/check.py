"""The command ``percuss check``."""

from __future__ import annotations

from percuss.cli.common import AsJson, CaseFile, Plugins, Sets, load_case, print_json, reporting


def check(case: CaseFile, set_: Sets = None, plugin: Plugins = None, as_json: AsJson = False) -> None:
    """Explain the run of a case in words, without running it."""
    with reporting(as_json):
        from percuss.cli import verbs

        told = verbs.check(load_case(case, set_, plugin))
        if as_json:
            print_json(told.data)
        else:
            print(told)
