"""Common parts of all figures: style, colours, texts and files; matplotlib is imported only when a figure is drawn."""

from __future__ import annotations

import io
import os
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.arguments import expect_suffix
from percuss.case.quantities import QUANTITIES, in_unit, with_unit
from percuss.errors import PercussError, printable
from percuss.files import PACKAGE, replacing
from percuss.jsonable import Data, Entries
from percuss.methods.interfaces import Floats
from percuss.results.ledger import open_accounts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from percuss.results.result import Result


TIME, FORCE = ("time", "time"), (QUANTITIES["contact_force"].label, "force")
STRESS = ("stress", "force/length^2")
INK, SOFT, FAINT, ALARM, CALM = "#1a1a1a", "#5f5f5f", "#c8c8c8", "#B33A00", "#0072B2"
GREEK = {"alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "sigma": "σ", "theta": "θ"}
SMALL = {"s": "ₛ", "m": "ₘ", "n": "ₙ", "p": "ₚ"}
OVERLAY = 6  # More lines than this cannot be distinguished in one panel.
MOST_PANELS = 6  # of contacts in one figure


def one_line(text: object) -> str:
    """Return a text with each line break or run of spaces replaced by one space."""
    return " ".join(str(text).split())


def wrapped(text: str, width: int, most: int) -> list[str]:
    """Return a text as at most `most` lines of at most `width` letters."""
    return textwrap.wrap(printable(one_line(text)), width, max_lines=most, placeholder=" …")


def number(value: object, digits: int = 4) -> str:
    """Return a value as text, a number with `digits` digits, None as ``unknown``."""
    if value is None:
        return "unknown"
    return f"{value:.{digits}g}" if isinstance(value, (int, float)) else one_line(value)


def subtitle_lines(result: Result) -> list[str]:
    """Return the lines below a title: the methods with the parameters used, and the steps with the status.

    Of an exact solution they are one line: its name, and the time up to which it holds.
    """
    units = [] if result.units else ["consistent units"]
    if not result.marched:
        return ["  ·  ".join([f"exact solution {result.solution_name}", f"up to time {number(result.end)}", *units])]
    resolved, summary = result.provenance.get("resolved", {}), result.summary
    laws: dict[str, list[str]] = {}
    for contact, parameters in (resolved.get("contacts") or {}).items():
        law = one_line(parameters.get("law", resolved.get("contact")))
        options = {name: value for name, value in parameters.items() if name != "law" and value is not None}
        values = ", ".join(f"{_symbol(name)} = {number(value)}" for name, value in options.items())
        laws.setdefault(f"{law} ({values})" if values else law, []).append(contact)
    laws_in_words = [law if len(laws) == 1 else f"{', '.join(contacts)}: {law}" for law, contacts in laws.items()]
    methods = [f"{resolved.get('integrator')} integrator", f"{resolved.get('mass')} mass", *laws_in_words]
    dt = f"Δt = {in_unit(summary['dt'], 4, 'time', result.units)}"
    steps = [f"Courant number {number(summary.get('courant'))}", dt, f"{summary['steps']} steps", result.status, *units]
    return ["  ·  ".join(methods if laws_in_words else [*methods, "no contact"]), "  ·  ".join(steps)]


def _symbol(name: str) -> str:
    """Return a parameter's name with Greek letters and subscripts where it is spelled so, as in ``epsilon_s``."""
    head, underscore, tail = name.partition("_")
    return GREEK[head] + SMALL.get(tail, underscore + tail) if head in GREEK else name


def warning_lines(result: Result) -> list[str]:
    """Return the warnings that must head a result that is not complete or not valid; none for a valid one."""
    if result.status == "done":
        return [f"NOT A VALID RESULT: {words}" for words in open_accounts(result.summary)]
    if not result.marched:
        head = f"INTERRUPTED at time {number(result.end)}: the solution is not complete"
        return [head, str(result.summary["exact_reason"])]
    summary, stop = result.summary, result.summary["stop"]
    planned = result.provenance.get("resolved", {}).get("steps", "?")
    where = f"step {summary['steps']} of {planned}, time {number(result.end)}"
    if result.status != "unstable":
        return [f"{result.status.upper()} at {where}: the run is not complete"]
    head = f"UNSTABLE, no valid result: stopped at {where}"
    return [head] if stop is None else [f"{head}; {stop['what']}", f"Likely cause: {stop['cause']}"]


@contextmanager
def new_figure(
    width: float, height: float, title: str | None = None, small: Sequence[str] = (), loud: Sequence[str] = ()
) -> Iterator[Figure]:
    """Yield a figure in the style of percuss, with title, small lines and loud warnings above the room of its panels.

    At the end the panels are laid out; later changes move them no more.
    """
    with drawing():
        from matplotlib.figure import Figure

        # Texts are measured as they are saved: at a lower resolution they are up to a tenth shorter or longer.
        figure = Figure(figsize=(width, height), dpi=DOTS_PER_INCH, facecolor="white")
        y = _head(figure, title, small, loud)
        figure.set_layout_engine("constrained", rect=(0.008, 0.1 / height, 0.984, y - 0.1 / height))
        yield figure
        for axes in figure.axes:  # the power of ten of an axis stands where it hides nothing above the panel
            axes.yaxis.get_offset_text().set(ha="right", x=-0.01)
            axes.yaxis.OFFSETTEXTPAD = 8
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        for axes in figure.axes:  # the solver of the layout leaves round-off that differs from one figure to the next
            axes.set_position(np.round(axes.get_position().bounds, 9))


def _head(figure: Figure, title: str | None, small: Sequence[str], loud: Sequence[str]) -> float:
    """Write what stands above the panels, and return how far up the figure these may reach."""
    lines = [(text, 17.0, INK) for text in wrapped("Untitled case" if title == "" else title or "", 88, 2)]
    lines += [(text, 10.0, SOFT) for line in small for text in wrapped(line, 160, 3)]
    lines += [(text, 10.5, ALARM) for line in loud for text in wrapped(line, 135, 2)]
    height, y = figure.get_figheight(), 0.18
    for text, size, colour in lines:
        band = {"color": "white", "bbox": {"facecolor": ALARM, "edgecolor": "none", "pad": 2.5}}
        style: Entries = {"color": colour} if colour != ALARM else band
        weight = "normal" if colour == SOFT else "bold"
        figure.text(0.2 / figure.get_figwidth(), 1 - y / height, text, size=size, weight=weight, va="top", **style)
        y += 1.5 * size / 72
    return 1 - (y + 0.08) / height


def draw_line(axes: Axes, time: Floats, values: Floats, **style: Any) -> Line2D:
    """Draw a history, thinned, and return its line."""
    (line,) = axes.plot(*thinned(time, values), **style)
    return line


def set_labels(axes: Axes, units: Data, **labels: tuple[str, str]) -> None:
    """Name the axes of a panel: `xlabel` and `ylabel` are labels with their units in words, which the case may name."""
    axes.set(**{which: with_unit(*label, units) for which, label in labels.items()})


def colour_limit(values: Floats) -> tuple[float, str]:
    """Return the size of stress that has the darkest colour; and "both" if single values are larger, else "neither"."""
    sizes = np.abs(values[np.isfinite(values)])
    largest = float(sizes.max(initial=0.0))
    limit = float(np.percentile(sizes, 99.5)) if sizes.size else 0.0
    limit = limit if limit > 1e-3 * largest else largest or 1.0
    return limit, "both" if largest > 1.001 * limit else "neither"


def write_reason(axes: Axes, text: str) -> None:
    """Write into an empty panel the reason why it shows nothing."""
    axes.set(xticks=[], yticks=[], xlabel="", ylabel="", facecolor="#f6f6f6")
    axes.spines[:].set_visible(False)
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=SOFT)


def legend(axes: Axes, entries: Entries, *, room: int = 82, up: float = 1.0) -> None:
    """Put a legend above a panel, where it hides no data, in as many columns as `room` letters allow."""
    add_legend(axes, entries, room, loc="lower left", bbox_to_anchor=(0, up), borderaxespad=0.2)


def add_legend(owner: Any, entries: Entries, room: int = 120, **options: Any) -> None:
    """Add a legend to a panel or a figure, in as many columns as `room` letters allow."""
    # The space keeps matplotlib from dropping a label that begins with an underscore.
    labels = [f" {one_line(label)}" for label in entries]
    columns = room // (max(map(len, labels), default=0) + 7)
    owner.legend(list(entries.values()), labels, ncols=max(1, min(len(labels), columns)), **options)


def log_axis(axes: Axes, which: str) -> None:
    """Make the axis `which`, x or y, logarithmic, with plain ticks: texts are never read as mathematics."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    if high > 6.0 * low:
        most = 100.0 if which == "x" else 3000.0  # labels stand side by side, or above each other
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < most * low else (1.0,)))
    else:
        axis.set_major_locator(MaxNLocator(3 if which == "x" else 5))
    axis.set_major_formatter("{x:.6g}")
    axis.set_minor_formatter(NullFormatter())


DOTS_PER_INCH = 180
SUFFIXES = (".png", ".svg", ".pdf")
# The colours of Okabe and Ito, ordered so that neighbours differ in grey too; each has its own line style.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7")
DASHES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (6, 1.5, 1.2, 1.5)), (0, (2.5, 1)), (0, (9, 2, 3, 2)), (0, (1, 1)))
MORE_COLOURS = ("#000000", "#8C8C8C")  # These are for a seventh and an eighth line.
MORE_DASHES: tuple[Any, ...] = ((0, (14, 2)), (0, (1, 3)))
MOST_POINTS = 10_000  # A line with more points is thinned to its extremes, as no figure can resolve them.
PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 2.0}
STYLE = PACKAGE / "reporting" / "figures.mplstyle"


def check_suffix(path: str | os.PathLike[str]) -> None:
    """Refuse the path of a figure that cannot be drawn, before a run is made for it.

    Raises
    ------
    InputError
        If `path` does not end in .png, .svg or .pdf.
    PercussError
        If matplotlib is not installed.
    """
    expect_suffix(path, "a picture", SUFFIXES, "Name the file with one of the three.")
    with drawing():
        pass


def picture(figure: Figure, kind: str) -> bytes:
    """Return a figure as the bytes of a png, svg or pdf file; the same figure gives the same bytes."""
    no_date = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    out = io.BytesIO()
    with drawing():
        figure.savefig(out, format=kind, dpi=DOTS_PER_INCH, metadata=no_date)
    return out.getvalue()


@contextmanager
def drawing() -> Iterator[None]:
    """Draw in the style of percuss, and leave the user's settings of matplotlib as they were.

    Raises
    ------
    PercussError
        If matplotlib is not installed.
    """
    try:
        from matplotlib import style
    except ImportError as error:
        message = "a picture needs matplotlib, which is not installed: pip install 'percuss[plot]'"
        raise PercussError(message) from error
    with style.context(["default", STYLE]):
        yield


def write(path: str | os.PathLike[str], figure: Figure) -> None:
    """Write a figure as a png, svg or pdf file, by suffix, completely or not at all."""
    check_suffix(path)
    suffix = Path(path).suffix
    with replacing(path, suffix) as beside:
        beside.write_bytes(picture(figure, suffix.lower()[1:]))


def axis_end(result: Result) -> float:
    """Return the end of the time axis: the planned end, or 1.3 times the time of the stop if that is less."""
    if not result.marched:
        return result.end
    planned = result.provenance.get("resolved", {}).get("steps", result.summary["steps"]) * result.summary["dt"]
    return float(max(min(planned, 1.3 * result.end), result.summary["dt"]))


def hatch_after_stop(axes: Axes, result: Result, until: float, *, upwards: bool = False) -> None:
    """Hatch the part of the time axis from the stop of a run that is not done up to `until`, the end of the axis."""
    if result.status == "done" or result.end >= until:
        return
    span, line = (axes.axhspan, axes.axhline) if upwards else (axes.axvspan, axes.axvline)
    span(result.end, until, facecolor="#f3f3f3", edgecolor=FAINT, hatch="///", linewidth=0)
    line(result.end, color=ALARM, linewidth=1.5)


def thinned(time: Floats, values: Floats, most: int = MOST_POINTS) -> tuple[Floats, Floats]:
    """Return a line, reduced to the minimum and maximum of each of its sections if it has more than `most` points."""
    if time.size <= most:
        return time, values
    starts = np.linspace(0, time.size, most // 2 + 1).astype(np.int64)
    kept = {0, time.size - 1}
    for a, b in pairwise(starts.tolist()):
        kept.update((a + int(values[a:b].argmin()), a + int(values[a:b].argmax())))
    index = np.array(sorted(kept))
    return time[index], values[index]
