"""The command ``percuss check``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from percuss.cli.common import AsJson, CaseFile, Plugins, Sets, load_to_write, option, reporting, tell_if_long


def check(
    case: CaseFile,
    set_: Sets = None,
    plugin: Plugins = None,
    plot: Annotated[Path | None, option("--plot FILE", "Draw solids: mesh, contacts, supports, loads.")] = None,
    as_json: AsJson = False,
) -> None:
    """Explain the run of a case in words, without running it."""
    with reporting(as_json) as answer:
        from percuss.certificate.criteria import too_large
        from percuss.certificate.verdict import settled
        from percuss.reporting.explanation import explanation
        from percuss.reporting.tables import Unbroken

        loaded = load_to_write(case, set_, plugin, plot)
        run = settled(loaded)
        if not too_large(run.model):  # of which the critical step is not searched
            tell_if_long(run.model)
        told = explanation(*run)
        if plot is not None:
            from percuss.reporting.case_figure import case_figure

            answer.draw(plot, case_figure, run.model)
        answer.show(told.data, [Unbroken(told.text)])
