"""The command ``percuss check``."""

from __future__ import annotations

from percuss.cli.common import AsJson, CaseFile, Plugins, Sets, load_case, reporting


def check(case: CaseFile, set_: Sets = None, plugin: Plugins = None, as_json: AsJson = False) -> None:
    """Explain the run of a case in words, without running it."""
    with reporting(as_json) as answer:
        from percuss.cli import verbs
        from percuss.reporting.tables import Unbroken

        told = verbs.check(load_case(case, set_, plugin))
        answer.show(told.data, [Unbroken(told.text)])
