"""Pictures of results: forces, energies and stress in space and time; matplotlib is imported when drawing."""

from __future__ import annotations

import io
import os
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.errors import InputError, PercussError, Problem
from percuss.result import Result, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.contracts import Floats

__all__ = ["comparison_figure", "figure_of", "force_figure", "picture", "plot_comparison", "plot_result"]

SUFFIXES = (".png", ".svg", ".pdf")
INK, SOFT, FAINT, ALARM = "#1a1a1a", "#5f5f5f", "#c8c8c8", "#B33A00"
# Okabe and Ito's colours in an order whose neighbours also differ in grey, each with a dash of its own
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7")
DASHES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (6, 1.5, 1.2, 1.5)), (0, (2.5, 1)), (0, (9, 2, 3, 2)), (0, (1.2, 1)))
MOST_POINTS = 10_000  # a line longer than this is thinned to its extremes: nobody sees the difference
OVERLAY = 6  # so many lines can still be told apart in one panel
STYLE = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same picture on every machine
    "font.size": 10.5,
    "axes.edgecolor": SOFT,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.labelcolor": INK,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "hatch.color": FAINT,
    "hatch.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "legend.handlelength": 2.6,
    "lines.linewidth": 1.5,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "svg.fonttype": "path",
    "svg.hashsalt": "percuss",
    "pdf.fonttype": 42,
}


# -- the public door ---------------------------------------------------------------------------------------


def plot_result(result: Result, path: str | os.PathLike[str]) -> None:
    """Write the picture of a run: contact forces, energy accounts, stress in space and time.

    Parameters
    ----------
    result
        What to draw. Where it has an attribute ``exact_histories`` that is not None, a mapping of a contact's name
        to (times, forces), those are laid over.
    path
        File ending in .png, .svg or .pdf; written beside and then renamed.

    Raises
    ------
    InputError
        If the suffix is another one, or the folder cannot be written.
    PercussError
        If matplotlib is not installed.
    """
    _write(path, lambda: figure_of(result))


def plot_comparison(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike[str]) -> None:
    """Write the contact forces of several runs of one case over each other; over six, beside each other.

    Parameters
    ----------
    rows
        Mappings with ``label``, ``result`` (a Result, or None where there is none) and, for the latter, ``reason``.
    path
        File ending in .png, .svg or .pdf.

    Raises
    ------
    InputError
        If the suffix is another one, or the folder cannot be written.
    PercussError
        If matplotlib is not installed.
    """
    _write(path, lambda: comparison_figure(rows))


def figure_of(result: Result) -> Figure:
    """Return the picture of a run as a matplotlib Figure, belonging to no window: forces, energies, stress."""
    with _drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12.8, 7.4), facecolor="white")
        _header(figure, [result.title or "Untitled case"], _details(result), _alarm(result))
        grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1.0))
        force = figure.add_subplot(grid[0, 0])
        energy = figure.add_subplot(grid[1, 0], sharex=force)
        _forces(force, result)
        force.set_xlabel("")
        _energies(energy, result)
        for axes in (force, energy):
            _not_computed(axes, result)
        _space_time(figure.add_subplot(grid[:, 1]), result)
        return figure


def force_figure(result: Result) -> Figure:
    """Return the contact forces of a run alone, as a notebook shows them."""
    with _drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7.6, 3.0), facecolor="white", layout="constrained")
        axes = figure.add_subplot()
        _forces(axes, result)
        _not_computed(axes, result)
        return figure


def comparison_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Return the picture of several runs of one case; see `plot_comparison`."""
    with _drawing():
        from percuss.plot_comparison import draw  # placeholder

        return draw(rows)


def picture(figure: Figure, kind: str = "png") -> bytes:
    """Return a figure as the bytes of a png, svg or pdf file; the same figure gives the same bytes."""
    stamps: dict[str, dict[str, Any]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": "percuss"},
        "pdf": {"CreationDate": None, "Creator": "percuss"},
    }
    out = io.BytesIO()
    with _drawing():
        figure.savefig(out, format=kind, dpi=200, metadata=stamps[kind])
    return out.getvalue()
