"""Figure of a recommendation: the error of all runs over their cost, with the Pareto front and the bound."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from percuss.case.quantities import METRICS
from percuss.reporting.figures import legend_below, log_axis, new_figure, percent_axis
from percuss.reporting.recommendation_words import bounds_in_words, methods_in_words
from percuss.reporting.study_charts import line_style
from percuss.reporting.study_figures import marked_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from percuss.studies.recommendation import Recommendation, Tried

MOST_PAIRS = 8  # that have a colour of their own, the best first


def recommendation_figure(found: Recommendation) -> Figure:
    """Return a figure of the error over the cost on logarithmic axes, with the Pareto front and the bound."""
    heading = bounds_in_words(found.bounds)
    if found.best is not None:
        heading = f"{heading}; cheapest: {methods_in_words(found.best)}"
    with new_figure(12.8, 7.2, found.study.title, [heading]) as figure:
        axes = figure.subplots()
        by_pair: dict[tuple[str, str], list[Tried]] = {}
        for one in sorted(_drawn(found, found.tried), key=lambda one: (one.excess, one.cost)):
            by_pair.setdefault(one.candidate.pair, []).append(one)
        for k, (pair, of_pair) in enumerate(by_pair.items()):
            x, y = [one.cost for one in of_pair], [_height(found, one) for one in of_pair]
            if k < MOST_PAIRS:
                style = marked_line(line_style(k)) | {"linestyle": "none"}
                axes.plot(x, y, markersize=5, label=" + ".join(pair), **style)
            else:
                label = "other pairs" if k == MOST_PAIRS else None
                axes.plot(x, y, ".", color="0.75", markersize=4, zorder=1, label=label)
        front = _drawn(found, found.front)
        axes.plot([one.cost for one in front], [_height(found, one) for one in front], color="0.3", lw=1.2,
                  drawstyle="steps-post", zorder=1.5, label="no run is both cheaper and better")  # fmt: skip
        bound = found.bounds.error if found.bounds.error is not None else found.bounds.energy
        if bound is not None:
            axes.axhline(bound, color="0.3", lw=1.0, dashes=(5, 3), label="bound")
        for best in _drawn(found, [found.best] if found.best is not None else []):
            axes.plot(best.cost, _height(found, best), "o", markersize=14, fillstyle="none", color="black",
                      label="the cheapest that meets the bounds")  # fmt: skip
        name = METRICS[found.bounds.measure].label if found.bounds.error is not None else "energy taken or added"
        estimate = " (estimated)" if found.estimated else ""
        axes.set(xlabel="cost: steps times nodes times stages", ylabel=f"{name}{estimate}")
        if heights := [_height(found, one) for one in _drawn(found, found.tried)]:
            log_axis(axes, "x")
            percent_axis(axes, min([*heights, bound or math.inf]), max([*heights, bound or 0.0]))
        handles, labels = axes.get_legend_handles_labels()
        legend_below(figure, dict(zip(labels, handles, strict=True)))
    return figure


def _height(found: Recommendation, one: Tried) -> float:
    """Return the number of a run that is drawn upwards; nan if it is not known."""
    value = one.error if found.bounds.error is not None else one.energy
    return math.nan if value is None else value


def _drawn(found: Recommendation, runs: Sequence[Tried]) -> list[Tried]:
    """Return the runs that have a place on logarithmic axes."""
    return [one for one in runs if 0 < _height(found, one) < math.inf and 0 < one.cost < math.inf]
