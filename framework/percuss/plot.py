"""Pictures of results: forces, energies and stress in space and time; matplotlib is imported when drawing."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import InputError, PercussError, Problem
from percuss.report import (
    ALARM,
    FAINT,
    INK,
    OVERLAY,
    SOFT,
    alarm,
    details,
    header,
    legend,
    number,
    one_line,
    powers,
    say,
    settle,
    stopped_at,
)
from percuss.result import Result, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["check_suffix", "figure_of", "force_figure", "picture", "plot_comparison", "plot_result"]

SUFFIXES = (".png", ".svg", ".pdf")
# Okabe and Ito's colours in an order whose neighbours also differ in grey, each with a dash of its own
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7")
DASHES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (6, 1.5, 1.2, 1.5)), (0, (2.5, 1)), (0, (9, 2, 3, 2)), (0, (1, 1)))
MOST_POINTS = 10_000  # a longer line is thinned to its extremes: no picture is as fine as that
PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 2.0}
STYLE = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same picture on every machine
    "font.size": 10.5,
    "axes.edgecolor": SOFT,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.limits": (-3, 4),
    "grid.color": "#e6e6e6",
    "hatch.color": FAINT,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "legend.handlelength": 2.6,
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
        File ending in .png, .svg or .pdf; written beside and then renamed. Errors are those of `check_suffix`.
    """
    write(path, lambda: figure_of(result))


def plot_comparison(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike[str]) -> None:
    """Write the contact forces of several runs of one case over each other; over six, beside each other.

    Parameters
    ----------
    rows
        Mappings with ``label``, ``result`` (a Result, or None where there is none) and, for the latter, ``reason``.
    path
        As of `plot_result`.
    """
    from percuss.report import comparison_figure

    write(path, lambda: comparison_figure(rows))


def check_suffix(path: str | os.PathLike[str]) -> None:
    """Refuse a picture that cannot be drawn, before anything is run for it.

    Raises
    ------
    InputError
        If `path` ends in something else than .png, .svg or .pdf.
    PercussError
        If matplotlib is not installed.
    """
    suffix = Path(path).suffix
    if suffix.lower() not in SUFFIXES:
        message = f"expected a picture ending in .png, .svg or .pdf, found {suffix or 'no ending'}"
        raise InputError([Problem(str(path), "", message, "Name the file with one of the three.")])
    with drawing():
        pass


def figure_of(result: Result) -> Figure:
    """Return the picture of a run as a matplotlib Figure of no window: forces, energies, stress."""
    with drawing():
        from matplotlib.figure import Figure

        from percuss.spacetime import space_time

        figure = Figure(figsize=(12.8, 7.4), facecolor="white")
        header(figure, result.title, details(result), alarm(result))
        grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0 if result.field_arrays else 0.4))
        force = figure.add_subplot(grid[0, 0])
        energy = figure.add_subplot(grid[1, 0])
        forces(force, result)
        force.set_xlabel("")
        _energies(energy, result)
        for axes, word in ((force, True), (energy, False)):
            axes.set_xlim(0, shown_until(result))
            not_computed(axes, result, word=word)
        space_time(figure.add_subplot(grid[:, 1]), result)
        return settle(figure)


def force_figure(result: Result) -> Figure:
    """Return the contact forces of a run alone, as a notebook shows them."""
    with drawing():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7.6, 3.0), facecolor="white", layout="constrained")
        axes = figure.add_subplot()
        forces(axes, result)
        axes.set_xlim(0, shown_until(result))
        not_computed(axes, result)
        return settle(figure)


def picture(figure: Figure, kind: str) -> bytes:
    """Return a figure as the bytes of a png, svg or pdf file; the same figure gives the same bytes."""
    stamps: dict[str, dict[str, Any]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": "percuss"},
        "pdf": {"CreationDate": None, "Creator": "percuss", "Producer": None},
    }
    out = io.BytesIO()
    with drawing():
        figure.savefig(out, format=kind, dpi=180, metadata=stamps[kind])
    return out.getvalue()


# -- around the panels -------------------------------------------------------------------------------------


@contextmanager
def drawing() -> Iterator[None]:
    """Draw in this module's style, whatever the user's own is; leave matplotlib's settings as they were."""
    try:
        from matplotlib import style
    except ImportError as error:
        message = "a picture needs matplotlib, which is not installed: pip install 'percuss[plot]'"
        raise PercussError(message) from error
    with style.context(["default", STYLE]):
        yield


def write(path: str | os.PathLike[str], draw: Callable[[], Figure]) -> None:
    check_suffix(path)
    suffix = Path(path).suffix
    content = picture(draw(), suffix.lower()[1:])
    with replacing(path, suffix) as beside:
        beside.write_bytes(content)


def shown_until(result: Result) -> float:
    """Return the end of the time axis: as planned, unless the run stopped far before that."""
    stopped = stopped_at(result)
    if result.summary["dt"] is None:
        return stopped
    planned = result.provenance.get("resolved", {}).get("steps", result.summary["steps"]) * result.summary["dt"]
    return float(max(min(planned, 1.3 * stopped), result.summary["dt"]))


def not_computed(axes: Axes, result: Result, *, word: bool = True, upwards: bool = False) -> None:
    """Hatch the time after a run's stop."""
    stopped, until = stopped_at(result), shown_until(result)
    if result.status == "done" or stopped >= until:
        return
    span, line = (axes.axhspan, axes.axhline) if upwards else (axes.axvspan, axes.axvline)
    span(stopped, until, facecolor="#f3f3f3", edgecolor=FAINT, hatch="///", linewidth=0)
    line(stopped, color=ALARM, linewidth=1.5)
    if not word:
        return
    middle = 0.5 * (stopped + until)
    where = (0.5, middle) if upwards else (middle, 0.5)
    frame = axes.get_yaxis_transform() if upwards else axes.get_xaxis_transform()
    style: dict[str, Any] = {"rotation": 0 if upwards else 90, "ha": "center", "va": "center", "color": ALARM}
    axes.text(*where, f"{result.status}: not computed", transform=frame, bbox=PAPER, **style)


# -- the panels --------------------------------------------------------------------------------------------


def thinned(time: Any, values: Any) -> tuple[Any, Any]:
    """Return a line as it is, or the smallest and the largest value of each of many stretches, in order."""
    if time.size <= MOST_POINTS:
        return time, values
    starts = np.linspace(0, time.size, MOST_POINTS // 2 + 1).astype(np.int64)
    kept = {0, time.size - 1}
    for a, b in pairwise(starts.tolist()):
        kept.update((a + int(values[a:b].argmin()), a + int(values[a:b].argmax())))
    index = np.array(sorted(kept))
    return time[index], values[index]


def forces(axes: Axes, result: Result) -> None:
    """Draw every contact's force, what the case expects and what is exact."""
    names, time = result.coordinates["contact"], result.arrays["time"]
    axes.set(xlabel="time", ylabel="contact force")
    if not names:
        say(axes, "This case has no contact.")
        return
    handles = {}
    for k, (name, colour) in enumerate(zip(names, colours(len(names)), strict=True)):
        dash = DASHES[k] if len(names) <= OVERLAY else "-"
        force = result.arrays["contact_force"][:, k]
        (handles[name],) = axes.plot(*thinned(time, force), color=colour, linestyle=dash)
    if len(names) > OVERLAY:
        _contact_scale(axes, names)
        handles = {}
    powers(axes)
    handles |= truths(axes, result, names)
    if handles:
        legend(axes, handles)


def colours(count: int) -> list[Any]:
    """Return a colour for each of `count` lines: told apart by name, or where there are many by order."""
    if count <= OVERLAY:
        return list(COLOURS[:count])
    import matplotlib as mpl

    return list(mpl.colormaps["viridis"](np.linspace(0.0, 0.9, count)))  # its light end is lost on white


def _contact_scale(axes: Axes, names: Sequence[str]) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap

    count = len(names)
    scale = ScalarMappable(BoundaryNorm(np.arange(count + 1) - 0.5, count), ListedColormap(colours(count)))
    shown = range(0, count, -(-count // 12))
    bar = axes.figure.colorbar(scale, ax=axes, ticks=list(shown), pad=0.01, aspect=30, label="contact")
    bar.ax.minorticks_off()
    bar.ax.set_yticklabels([one_line(names[k])[:24] for k in shown], parse_math=False, size=9)


def truths(axes: Axes, result: Result, names: Sequence[str]) -> dict[str, Any]:
    """Draw the exact histories and the expected values of contacts; return their entries of a legend."""
    known: dict[str, Any] = {}
    exact = getattr(result, "exact_histories", None) or {}
    for name in names:
        if name in exact:
            time, force = (np.asarray(part, dtype=float) for part in exact[name])
            (known["exact"],) = axes.plot(*thinned(time, force), color=INK, linewidth=1.0, dashes=(4, 2), zorder=3)
    for item in result.provenance["case"].get("expect") or ():
        whose = item.get("contact") or (result.coordinates["contact"] or [""])[0]
        if item.get("quantity") != "contact_force" or whose not in names:
            continue
        for statistic, mark in {"mean": "|", "max": "v", "min": "^"}.items():
            if item.get(statistic) is None:
                continue
            value, within = float(item[statistic]), item.get("within", 0.0)
            share = isinstance(within, str) and within.endswith("%")
            off = abs(value) * float(within[:-1]) / 100.0 if share else float(within)
            span = list(item.get("during") or (0.0, stopped_at(result)))
            axes.fill_between(span, value - off, value + off, color=INK, alpha=0.22, linewidth=0, zorder=2.5)
            line = axes.plot(span, [value, value], color=INK, linewidth=0.9, marker=mark, zorder=3)
            known[f"expected {statistic}"] = line[0]
    return known


def _energies(axes: Axes, result: Result) -> None:
    """Draw the accounts of the energy and say how well they close."""
    parts = {k: result.arrays[k] for k in ("kinetic_energy", "elastic_energy", "external_work", "contact_work")}
    total = parts["kinetic_energy"] + parts["elastic_energy"]
    lines: dict[str, tuple[Any, str, Any, float]] = {
        "kinetic": (parts["kinetic_energy"], "#0072B2", "-", 1.5),
        "elastic": (parts["elastic_energy"], "#E69F00", "-", 1.5),
        "sum": (total, FAINT, "-", 4.0),
        "sum − external work": (total - parts["external_work"], INK, (0, (4, 2)), 1.2),
        "contact work": (parts["contact_work"], "#D55E00", (0, (6, 1.5, 1.2, 1.5)), 1.5),
        "external work": (parts["external_work"], "#009E73", (0, (1.2, 1.2)), 1.8),
    }
    handles = []
    for values, colour, dash, width in lines.values():
        line = axes.plot(*thinned(result.arrays["time_half"], values), color=colour, linestyle=dash, linewidth=width)
        handles += line
    handles[2].set_zorder(1.9)
    axes.margins(y=0.18)  # leaves the corner to the words
    axes.set(xlabel="time", ylabel="energy")
    powers(axes)
    error = result.summary["energy"]["ledger_error"]
    words = f"ledger closes to {number(error)} of the largest energy"
    axes.text(0.99, 0.975, words, transform=axes.transAxes, ha="right", va="top", size=9, color=SOFT, bbox=PAPER)
    legend(axes, dict(zip(lines, handles, strict=True)))
