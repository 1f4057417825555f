"""The command ``percuss stability``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from percuss.cli import common
from percuss.cli.common import option
from percuss.errors import InputError, Problem


def stability(
    case: common.CaseFile,
    vary: common.Vary = None,
    curves: Annotated[list[str] | None, option("--curves PATH=VALUES", "A curve, or a map, for each value.")] = None,
    by: Annotated[str, option("--by A,B", "Criteria: linear-laws or black-box; both are overlaid.")] = "",
    set_: common.Sets = None,
    plugin: common.Plugins = None,
    out: Annotated[Path | None, option("-o --out FILE", "Save the rows as csv.")] = None,
    plot: Annotated[Path | None, option("--plot FILE", "Draw the curves or maps.")] = None,
    as_json: common.AsJson = False,
) -> None:
    """Print the critical Courant number over varied parameters."""
    with common.reporting(as_json) as answer:
        from percuss.certificate import maps
        from percuss.reporting.stability_figure import stability_figure
        from percuss.reporting.terminal import stability_lines
        from percuss.studies.layout import varied

        axes, families = varied(vary or []), varied(curves or [], "--curves")
        if plot is not None and not 1 <= len(axes) <= 2:
            raise InputError([Problem("--plot", "", f"expected one or two --vary, found {len(axes)}", "")])
        loaded = common.load_to_write(case, set_, plugin, plot, out, {**axes, **families})
        common.print_notes(loaded)
        with common.progress_bar("combinations") as progress:
            rows = maps.stability(
                loaded, axes, families, common.names_in(by), before=common.tell_if_long, progress=progress
            )
        answer.write(out, maps.save, rows, out)
        answer.draw(plot, stability_figure, rows, axes, families, loaded.title, common.methods_in_words(loaded))
        answer.show({"title": loaded.title, "rows": rows}, stability_lines(loaded.title, rows))
        known = any(row["courant_critical"] or row.get("flutter") is not None for row in rows)
        answer.exit_code = 0 if known else 1
