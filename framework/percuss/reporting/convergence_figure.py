"""Figure of the errors over mesh refinement for each pair of methods."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from percuss.case.quantities import QUANTITIES, TRUE_ERRORS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def convergence_figure(fitted: list[dict[str, Any]], title: str) -> Figure:
    """Return a figure of errors over mesh refinement on logarithmic axes, with a panel per error and a line per fit."""
    from percuss.reporting.figures import drawing
    from percuss.reporting.study_charts import line_style
    from percuss.reporting.study_figures import marked_line

    with drawing():
        from matplotlib.figure import Figure
        from matplotlib.ticker import NullFormatter

        figure = Figure(figsize=(12.8, 7.8), facecolor="white", layout="constrained")
        figure.suptitle(title, x=0.02, ha="left", weight="bold", size=15, parse_math=False)
        panels = figure.subplots(2, 2, sharex=True)
        for axes, name in zip(panels.flat, TRUE_ERRORS, strict=True):
            for k, fit in enumerate(fitted):
                points = [
                    (refine, error)
                    for refine, error in zip(fit["refine"], fit[name], strict=True)
                    if error is not None and error > 0
                ]
                x, y = zip(*points, strict=True) if points else ((), ())
                axes.plot(x, y, markersize=4, label=_label(fit), **marked_line(line_style(k)))
            axes.set(xscale="log", yscale="log", ylabel="relative error")
            axes.set_xticks(sorted({refine for fit in fitted for refine in fit["refine"]}), minor=False)
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_title(QUANTITIES[name].label, loc="left", size=11)
        for axes in panels[-1]:
            axes.set_xlabel("refine: elements over those of the case")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        labels_of_errors = "  |  ".join(QUANTITIES[name].label for name in TRUE_ERRORS)
        heading = f"observed orders: {labels_of_errors}"
        figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=9, title=heading, title_fontsize=9)
        return figure


def _label(fit: dict[str, Any]) -> str:
    """Return the label of a line: pair of methods, other varied values, and observed orders by panel."""
    others = [f"{path.split('.')[-1]}={value}" for path, value in fit.items() if "." in path]
    orders = [fit[f"{name}_order"] for name in TRUE_ERRORS]
    order_texts = "  |  ".join("-" if order is None else f"{order:.2f}" for order in orders)
    return f"{' '.join([fit['integrator'], '+', fit['contact'], *others])}:  {order_texts}"


def plot_convergence(fitted: list[dict[str, Any]], title: str, path: str | os.PathLike[str]) -> None:
    """Write `convergence_figure` as a png, svg or pdf file, by suffix, completely or not at all."""
    from percuss.reporting.figures import write

    write(path, lambda: convergence_figure(fitted, title))
