"""The command ``percuss compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percuss.cli.common import (
    AsJson,
    CaseFile,
    Outputs,
    Plugins,
    Sets,
    Vary,
    load_to_write,
    names_in,
    option,
    print_json,
    print_verdict,
    progress_bar,
    reporting,
    tell,
)


def compare(
    case: CaseFile,
    integrator: Annotated[str, option("--integrator A,B", "Run these integrators.")] = "",
    contact: Annotated[str, option("--contact X,Y", "Run these contact laws.")] = "",
    vary: Vary = None,
    set_: Sets = None,
    plugin: Plugins = None,
    tied: Annotated[bool, option("--tied", "Also tie the interfaces while the exact contact is closed.")] = False,
    plot: Annotated[
        Path | None,
        option("--plot FILE", "Draw the forces; with several `refine`, the errors over it."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run pairs of methods on one case, side by side."""
    with reporting(as_json):
        from percuss.reporting.verdict import comparison_verdict
        from percuss.studies import comparison
        from percuss.studies.parameters import varied

        axes = varied(vary or [])
        loaded = load_to_write(case, set_, plugin, plot, varied=axes)
        contacts = names_in(contact)
        own = comparison.own_laws(loaded) if contacts else []
        if own:
            tell(f"note: the named laws replace the own law of {', '.join(own)} in every run")
        with progress_bar("runs") as progress:
            rows = comparison.compare(loaded, names_in(integrator), contacts, axes, tied=tied, progress=progress)
        for note in comparison.notes_of_swaps(loaded, names_in(integrator), contacts, axes):
            tell(f"note: {note}")
        orders = comparison.orders(rows)
        outputs = Outputs()
        if plot is not None:
            from percuss.reporting.comparison_figure import comparison_figure
            from percuss.reporting.convergence_figure import convergence_figure

            runs = [{"label": r.label, "result": r.result, "reason": r.reason} for r in rows]
            outputs.draw(plot, convergence_figure(orders, loaded.title) if orders else comparison_figure(runs))
        if as_json:
            print_json({"title": loaded.title, "rows": [row.as_dict() for row in rows], "orders": orders})
        else:
            from percuss.reporting.terminal import tell_orders, tell_rows

            tell_rows(loaded.title, rows)
            if orders:
                tell_orders(orders)
        print_verdict(comparison_verdict(loaded.title, rows), as_json=as_json)
        outputs.finish()
        if not any(row.status == "done" for row in rows):
            raise typer.Exit(1)
