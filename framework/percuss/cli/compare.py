"""The command ``percuss compare``."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import Annotated

from percuss.cli import common
from percuss.cli.common import option


def compare(
    case: common.CaseFile,
    integrator: Annotated[str, option("--integrator A,B", "Run these integrators.")] = "",
    contact: Annotated[str, option("--contact X,Y", "Run these contact laws.")] = "",
    vary: common.Vary = None,
    set_: common.Sets = None,
    plugin: common.Plugins = None,
    tied: Annotated[bool, option("--tied", "Also tie the interfaces while the exact contact is closed.")] = False,
    reference: common.Reference = "",
    plot: Annotated[Path | None, option("--plot FILE", "Draw the contact forces.")] = None,
    as_json: common.AsJson = False,
) -> None:
    """Run pairs of methods on one case, side by side."""
    with common.reporting(as_json) as answer:
        from percuss.reporting.comparison_figure import comparison_figure
        from percuss.reporting.terminal import comparison_lines, order_lines
        from percuss.reporting.verdict import comparison_verdict
        from percuss.studies import comparison
        from percuss.studies.layout import varied

        axes = varied(vary or [])
        loaded = common.load_to_write(case, set_, plugin, plot, varied=axes, reference=reference)
        contacts = common.names_in(contact)
        own = [name for name, contact in loaded.contacts.items() if contact.own_law] if contacts else []
        if own:
            common.tell(f"note: the named laws replace the own law of {', '.join(own)} in every run")
        with common.progress_bar("runs") as progress:
            rows = comparison.compare(loaded, common.names_in(integrator), contacts, axes, tied=tied, progress=progress)
        for note in rows.notes:
            common.tell(f"note: {note}")
        orders = comparison.orders(rows)
        answer.draw(plot, comparison_figure, [vars(row) | {"label": row.label} for row in rows])
        data = {"title": loaded.title, "rows": [row.as_dict() for row in rows], "orders": orders}
        answer.show(data, chain(comparison_lines(loaded.title, rows), order_lines(orders)))
        answer.conclude(comparison_verdict(loaded.title, rows))
        answer.exit_code = 0 if any(row.status == "done" for row in rows) else 1
