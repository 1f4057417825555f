"""Figure of several runs of one case: their contact forces, overlaid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from percuss.jsonable import Data, Entries
from percuss.reporting import figures
from percuss.reporting.figures import COLOURS, DASHES, MOST_PANELS, OVERLAY, one_line
from percuss.reporting.run_figure import contacts_left_out, draw_references

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.results.result import Result


def comparison_figure(rows: Sequence[Data]) -> Figure:
    """Return a figure of the contact forces of several runs of one case, overlaid, with a panel for each contact.

    Parameters
    ----------
    rows
        Mappings with ``label``, ``result`` (a Result or None) and, where there is no result, ``reason``; the first six
        that have one are drawn.
    """
    known = [row for row in rows if row.get("result") is not None]
    runs = [(one_line(row["label"]), row["result"]) for row in known[:OVERLAY]]
    lost = [f"not shown: {row['label']}: {row.get('reason') or 'no result'}" for row in rows if row not in known]
    names = runs[0][1].coordinates["contact"] if runs else []
    down = min(max(len(names), 1), MOST_PANELS)
    shown = f"{len(runs)} of " if len(runs) < len(rows) else ""
    notes = [f"{figures.FORCE[0]} of {shown}{len(rows)} runs", *contacts_left_out(names)]
    notes += [line for words in lost for line in figures.wrapped(words, 150, 1)]
    height, title = max(4.6, 1.9 + 2.4 * down) + 0.2 * len(lost), runs[0][1].title if runs else ""
    with figures.new_figure(12.8, height, title, notes) as figure:
        panels = figure.subplots(down, 1, sharex=True, squeeze=False)[:, 0]
        if not names:
            reason = "These runs have no contact." if runs else "None of the runs has a result."
            figures.write_reason(panels[0], reason)
            return figure
        entries = [_overlay_runs(axes, runs, name) for axes, name in zip(panels, names, strict=False)]
        figures.legend(panels[0], {label: line for panel in entries for label, line in panel.items()}, room=170)
        figures.set_labels(panels[-1], runs[0][1].units, xlabel=figures.TIME)
        panels[0].set_xlim(0, max(max(result.end, float(result.summary["dt"])) for _, result in runs))
    return figure


def _overlay_runs(axes: Axes, runs: Sequence[tuple[str, Result]], name: str) -> Entries:
    """Draw the force of one contact in every run, and return the entries of the legend.

    Later runs have thinner lines, so that equal forces can be seen below each other. The axis is that of the stable
    runs: an unstable one would flatten them.
    """
    entries, stable = Entries(), []
    for k, (label, result) in enumerate(runs):
        force = result.arrays["contact_force"][:, result.coordinates["contact"].index(name)]
        words = label if result.status == "done" else f"{label}: {result.status} at {figures.number(result.end)}"
        words = words if words not in entries else f"{words} ({k + 1})"
        style: Entries = {"color": COLOURS[k], "linestyle": DASHES[k], "linewidth": 2.5 - 0.25 * k}
        entries[words] = figures.draw_line(axes, result.arrays["time"], force, **style)
        stable += [force] if result.status != "unstable" else []
    if 0 < len(stable) < len(runs):
        low, high = (reach(np.concatenate(stable)) for reach in (np.min, np.max))
        room = 0.25 * (high - low or 1.0)
        axes.set_ylim(low - room, high + room)
    figures.set_labels(axes, runs[0][1].units, ylabel=(f"force at {name}", "force"))
    judged = [result for _, result in runs if result.exact_histories or result.finer_histories]
    return entries | draw_references(axes, (judged or [runs[0][1]])[0], [name])
