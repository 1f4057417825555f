"""The command ``percuss check``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from percuss.cli.common import AsJson, CaseFile, Plugins, Sets, load_to_write, option, reporting


def check(
    case: CaseFile,
    set_: Sets = None,
    plugin: Plugins = None,
    plot: Annotated[Path | None, option("--plot FILE", "Draw solids: mesh, contacts, supports, loads.")] = None,
    as_json: AsJson = False,
) -> None:
    """Explain the run of a case in words, without running it."""
    with reporting(as_json) as answer:
        from percuss.cli import verbs
        from percuss.reporting.tables import Unbroken

        loaded = load_to_write(case, set_, plugin, plot)
        told = verbs.check(loaded)
        if plot is not None:
            from percuss.march.model_of_case import model_of
            from percuss.reporting.case_figure import case_figure

            answer.draw(plot, case_figure, model_of(loaded))
        answer.show(told.data, [Unbroken(told.text)])
