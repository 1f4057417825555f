"""Errors against the mesh, drawn for each pair of methods."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from percuss.studies.comparison import ERRORS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


WORDS = {
    "force_error_l1": "force, L1",
    "force_error_l2": "force, L2",
    "impulse_error": "cumulative impulse",
    "displacement_error": "displacement, L2",
}


def convergence_figure(fitted: list[dict[str, Any]], title: str) -> Figure:
    """Return errors against the mesh on logarithmic axes, one panel an error, one line a method of `orders`."""
    from percuss.reporting.figures import COLOURS, DASHES, drawing

    colours = (*COLOURS, "#000000", "#8c8c8c")
    with drawing():
        from matplotlib.figure import Figure
        from matplotlib.ticker import NullFormatter

        figure = Figure(figsize=(12.8, 7.8), facecolor="white", layout="constrained")
        figure.suptitle(title, x=0.02, ha="left", weight="bold", size=15, parse_math=False)
        panels = figure.subplots(2, 2, sharex=True)
        for axes, name in zip(panels.flat, ERRORS, strict=True):
            for k, one in enumerate(fitted):
                points = [(r, e) for r, e in zip(one["refine"], one[name], strict=True) if e is not None and e > 0]
                style = {"color": colours[k % len(colours)], "linestyle": DASHES[k % len(DASHES)], "marker": "o"}
                x, y = zip(*points, strict=True) if points else ((), ())
                axes.plot(x, y, markersize=4, label=_label(one), **style)
            axes.set(xscale="log", yscale="log", ylabel="relative error")
            axes.set_xticks(sorted({r for one in fitted for r in one["refine"]}), minor=False)
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_title(WORDS[name], loc="left", size=11)
        for axes in panels[-1]:
            axes.set_xlabel("refine: elements over those of the case")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        heading = f"observed orders: {'  |  '.join(WORDS.values())}"
        figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=9, title=heading, title_fontsize=9)
        return figure


def _label(one: dict[str, Any]) -> str:
    """Return a method, what else is varied, and its observed orders in the order of the panels."""
    others = [f"{path.split('.')[-1]}={value}" for path, value in one.items() if "." in path]
    found = [one[f"{name}_order"] for name in ERRORS]
    told = "  |  ".join("-" if order is None else f"{order:.2f}" for order in found)
    return f"{' '.join([one['integrator'], '+', one['contact'], *others])}:  {told}"


def plot_convergence(fitted: list[dict[str, Any]], title: str, path: str | os.PathLike[str]) -> None:
    """Write `convergence_figure` as png, svg or pdf by suffix; written beside and then renamed."""
    from percuss.reporting.figures import write

    write(path, lambda: convergence_figure(fitted, title))
