"""The command ``percuss check``."""

from __future__ import annotations

from percuss.cli.common import AsJson, CaseFile, Plugins, Sets, load_case, print_json, reporting
from percuss.errors import printable


def check(case: CaseFile, set_: Sets = None, plugin: Plugins = None, as_json: AsJson = False) -> None:
    """Explain the run of a case in words, without running it."""
    with reporting(as_json):
        from percuss.certificate.verdict import settled
        from percuss.reporting.explanation import explanation

        explained = explanation(*settled(load_case(case, set_, plugin)))
        if as_json:
            print_json(explained.data)
        else:
            print(printable(explained.text))
