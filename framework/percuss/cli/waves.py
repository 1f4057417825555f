"""The command ``percuss waves``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from percuss.cli import common
from percuss.cli.common import option


def waves(
    case: common.CaseFile,
    contact: Annotated[str, option("--contact NAME", "Contact to measure; by default the first.")] = "",
    set_: common.Sets = None,
    plugin: common.Plugins = None,
    plot: Annotated[Path | None, option("--plot FILE", "Draw transmission and reflection over frequency.")] = None,
    as_json: common.AsJson = False,
) -> None:
    """Measure how a closed contact transmits and reflects waves.

    The black box measures the amplitudes, over frequency.
    """
    with common.reporting(as_json) as answer:
        from percuss.cli import verbs
        from percuss.reporting.stability_figure import waves_figure
        from percuss.reporting.terminal import waves_lines

        loaded = common.load_to_write(case, set_, plugin, plot)
        common.print_notes(loaded)
        wave_data = verbs.waves(loaded, contact)
        answer.draw(plot, waves_figure, wave_data, loaded.title, common.methods_in_words(loaded))
        data = {"title": loaded.title, "reason": wave_data.reason or None, "rows": wave_data.rows()}
        answer.show(data, waves_lines(loaded.title, wave_data))
