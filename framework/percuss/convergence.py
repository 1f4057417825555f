"""Observed orders of convergence, from runs of one case on finer and finer meshes."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.comparison import ERRORS, Row, metrics

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REFINED = "refine"
ROUND_OFF = 1e-12  # errors below are not those of a mesh
WORDS = {
    "force_error_l1": "force, L1",
    "force_error_l2": "force, L2",
    "impulse_error": "cumulative impulse",
    "displacement_error": "displacement, L2",
}


def orders(rows: list[Row]) -> list[dict[str, Any]]:
    """Return the observed order of each error for each method, fitted over the values of ``refine``.

    Parameters
    ----------
    rows
        Of a comparison that varies ``refine``.

    Returns
    -------
    list of dict
        ``integrator``, ``contact``, the other varied values, and for each error its order (None where fewer than two
        meshes have an error above round-off) and the errors themselves; empty where no method ran on two meshes.
    """
    out = []
    runs = _series(rows)
    for key, series in runs.items() if any(len(series) > 1 for series in runs.values()) else ():
        fitted: dict[str, Any] = {"integrator": key[0], "contact": key[1], **dict(key[2])}
        fitted["refine"] = [row.varied[REFINED] for row in series]
        for name in ERRORS:
            errors = [metrics(row).get(name) for row in series]
            fitted[name] = errors
            fitted[f"{name}_order"] = _order(fitted["refine"], errors)
        out.append(fitted)
    return out


def _series(rows: list[Row]) -> dict[Any, list[Row]]:
    """Return the runs of each method that differ by mesh alone, coarse to fine."""
    series: dict[Any, list[Row]] = {}
    for row in rows:
        if REFINED in row.varied and row.status == "done":
            others = tuple((path, value) for path, value in row.varied.items() if path != REFINED)
            series.setdefault((row.integrator, row.contact, others), []).append(row)
    return {key: sorted(group, key=lambda row: row.varied[REFINED]) for key, group in series.items()}


def _order(refine: list[float], errors: list[Any]) -> float | None:
    known = [(r, e) for r, e in zip(refine, errors, strict=True) if e is not None and e > ROUND_OFF]
    if len({r for r, _ in known}) < 2:
        return None
    slope = np.polyfit(np.log([r for r, _ in known]), np.log([e for _, e in known]), 1)[0]
    return float(-slope)


def convergence_figure(fitted: list[dict[str, Any]], title: str) -> Figure:
    """Return errors against the mesh on logarithmic axes, one panel an error, one line a method of `orders`."""
    from percuss.figures import COLOURS, DASHES, drawing

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
    from percuss.figures import write

    write(path, lambda: convergence_figure(fitted, title))
