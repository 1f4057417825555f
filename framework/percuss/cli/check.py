"""The command ``percuss check``."""

from __future__ import annotations

from percuss.cli.common import AsJson, CaseFile, Plugins, Sets, load_case, print_json, reporting


def check(case: CaseFile, set_: Sets = None, plugin: Plugins = None, as_json: AsJson = False) -> None:
    """Say in words and formulas what a case will do, without running it."""
    with reporting(as_json):
        from percuss.certificate.verdict import settled
        from percuss.reporting.explanation import explanation

        told = explanation(settled(load_case(case, set_, plugin)))
        if as_json:
            print_json(told.data)
        else:
            print(told.text)
