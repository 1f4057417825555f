"""What is said of a run: in words around its pictures, in a notebook, and beside other runs of the same case."""

from __future__ import annotations

import base64
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import PercussError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from percuss.result import Result

__all__ = ["alarm", "comparison_figure", "details", "notebook_html"]

INK, SOFT, FAINT, ALARM = "#1a1a1a", "#5f5f5f", "#c8c8c8", "#B33A00"
GREEK = {"alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "sigma": "σ", "theta": "θ"}
RAISED = str.maketrans("0123456789-\u2212", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁻")
SMALL = {"s": "ₛ", "m": "ₘ", "n": "ₙ", "p": "ₚ"}
OVERLAY = 6  # so many lines can still be told apart in one panel
# every colour is said: a dark notebook shows the same light card
CARD = (
    f"background:#ffffff;color:{INK};border:1px solid {FAINT};border-radius:6px;padding:12px 16px;"
    "max-width:780px;font-family:sans-serif;font-size:13px;line-height:1.45"
)
TABLE = f"border-collapse:collapse;background:#ffffff;color:{INK};font-size:13px;margin:6px 0"
CELL = "padding:2px 14px 2px 0;text-align:left;vertical-align:top;background:#ffffff;border:0"
BAND = f"background:{ALARM};color:#ffffff;font-weight:bold;border-radius:3px;padding:3px 8px;margin:6px 0"


# -- words -------------------------------------------------------------------------------------------------


def one_line(text: object) -> str:
    """Return a text without line breaks and runs of spaces."""
    return " ".join(str(text).split())


def wrapped(text: str, width: int, most: int) -> list[str]:
    """Return a text as at most `most` lines of `width` letters."""
    return textwrap.wrap(one_line(text), width, max_lines=most, placeholder=" …")


def number(value: Any, digits: int = 4) -> str:
    """Return a value as it is read, or ``unknown``."""
    if value is None:
        return "unknown"
    return f"{value:.{digits}g}" if isinstance(value, (int, float)) else one_line(value)


def details(result: Result) -> list[str]:
    """Return the lines below a title: methods as they came out, then the steps."""
    resolved, summary = result.provenance.get("resolved", {}), result.summary
    laws: dict[str, list[str]] = {}
    for contact, parameters in (resolved.get("contacts") or {}).items():
        law = one_line(parameters.get("law", resolved.get("contact")))
        given = {k: v for k, v in parameters.items() if k != "law" and v is not None}
        values = ", ".join(f"{_symbol(k)} = {number(v)}" for k, v in given.items())
        laws.setdefault(f"{law} ({values})" if values else law, []).append(contact)
    said = [law if len(laws) == 1 else f"{', '.join(which)}: {law}" for law, which in laws.items()]
    methods = [f"{resolved.get('integrator')} integrator", f"{resolved.get('mass')} mass", *said]
    steps = [result.status, "consistent units"]
    if summary["dt"] is not None:  # an exact solution has no steps
        dt = f"Δt = {number(summary['dt'])}"
        steps = [f"Courant number {number(summary.get('courant'))}", dt, f"{summary['steps']} steps", *steps]
    return ["  ·  ".join(methods if said else [*methods, "no contact"]), "  ·  ".join(steps)]


def _symbol(name: str) -> str:
    """Return the sign of a parameter named after one, as ``epsilon_s``."""
    head, bar, tail = name.partition("_")
    return GREEK[head] + SMALL.get(tail, bar + tail) if head in GREEK else name


def stopped_at(result: Result) -> float:
    """Return the time up to which a run came."""
    steps, dt = result.summary["steps"], result.summary["dt"]
    return float(result.summary["end"] if dt is None else steps * dt)


def alarm(result: Result) -> list[str]:
    """Return what must be said first of a run that did not end well: nothing, or one or two sentences."""
    if result.status == "done":
        return []
    summary, stop = result.summary, result.summary.get("stop") or {}
    planned = result.provenance.get("resolved", {}).get("steps", "?")
    where = f"step {summary['steps']} of {planned}, time {number(stopped_at(result))}"
    if result.status != "unstable":
        return [f"{result.status.upper()} at {where}: the run is not complete"]
    head = f"UNSTABLE, no valid result: stopped at {where}"
    words = [f"{head}; {stop['what']}" if stop.get("what") else head]
    return [*words, f"Likely cause: {stop['cause']}"] if stop.get("cause") else words


def header(figure: Figure, title: str, small: Sequence[str], loud: Sequence[str], foot: Sequence[str] = ()) -> None:
    """Write title, methods and alarm above a figure's panels and the foot below; these get what is left."""
    from matplotlib.patches import Rectangle

    height, left = figure.get_figheight(), 0.2 / figure.get_figwidth()
    y = 1 - 0.18 / height

    def write(lines: Iterable[str], size: float, colour: str, weight: str = "normal") -> None:
        nonlocal y
        for line in lines:
            figure.text(left, y, line, size=size, color=colour, weight=weight, va="top", parse_math=False)
            y -= 1.5 * size / 72 / height

    write(wrapped(title or "Untitled case", 88, 2), 17, INK, "bold")
    write((part for line in small for part in wrapped(line, 160, 3)), 10, SOFT)
    if loud:
        above, y = y, y - 0.07 / height
        write(wrapped(loud[0], 125, 2), 12, "white", "bold")
        write((part for line in loud[1:] for part in wrapped(line, 155, 2)), 10, "white")
        band = Rectangle((0, y), 1, above - y, transform=figure.transFigure, facecolor=ALARM, zorder=0)
        figure.add_artist(band)
    top = y - 0.08 / height
    feet = [part for line in foot for part in wrapped(line, 165, 1)]
    y = bottom = (0.1 + 0.2 * len(feet)) / height
    write(feet, 9.5, ALARM)
    rect = (0.008, bottom, 0.984, top - bottom)
    figure.set_layout_engine("constrained", rect=rect, hspace=0.03, wspace=0.03)


def settle(figure: Figure) -> Figure:
    """Lay a figure out for good; rounded, for the solver behind the layout differs in the last bits from run to run."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        active, original = (tuple(np.round(axes.get_position(o).bounds, 6)) for o in (False, True))
        axes.set_position(original, which="original")
        axes.set_position(active, which="active")
    return figure


def say(axes: Axes, text: str) -> None:
    """Leave a panel empty but for the reason."""
    axes.set(xticks=[], yticks=[], xlabel="", ylabel="", facecolor="#f6f6f6")
    axes.spines[:].set_visible(False)
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=SOFT, parse_math=False)


def legend(axes: Axes, entries: Mapping[str, Any], *, room: int = 76, up: float = 1.0) -> None:
    """Put a legend above a panel, where it hides no data, in as many columns as `room` letters allow.

    The labels are the user's text, never mathematics.
    """
    labels = [f" {one_line(label)}" for label in entries]  # matplotlib drops a label that begins with _
    for rows in range(1, len(labels) + 1):
        columns = [labels[k : k + rows] for k in range(0, len(labels), rows)]
        if sum(max(map(len, column)) + 9 for column in columns) <= room:
            break
    made = axes.legend(
        list(entries.values()),
        labels,
        loc="lower left",
        bbox_to_anchor=(0, up),
        ncols=len(columns),
        borderaxespad=0.2,
    )
    for text in made.get_texts():
        text.set_parse_math(False)


def powers(*panels: Axes) -> None:
    """Write powers of ten as plain letters, laid out ten times as fast as mathematics, clear of what is above."""
    from matplotlib.ticker import ScalarFormatter

    class Powers(ScalarFormatter):
        def get_offset(self) -> str:
            return re.sub(r"1e([-\u2212]?\d+)", lambda found: "×10" + found[1].translate(RAISED), super().get_offset())

    for axes in panels:
        axes.xaxis.set_major_formatter(Powers(useMathText=False))
        axes.yaxis.set_major_formatter(Powers(useMathText=False))
        axes.yaxis.get_offset_text().set(ha="right", x=-0.01)
        axes.yaxis.OFFSETTEXTPAD = 8  # above a tick at the very top


# -- a notebook --------------------------------------------------------------------------------------------


def notebook_html(result: Result) -> str:
    """Return a run as HTML: what was run, what came out, and its contact forces as a picture.

    Parameters
    ----------
    result
        What to show.

    Returns
    -------
    str
        HTML that looks the same in light and dark notebooks; without matplotlib, without the picture.
    """
    title = escape(one_line(result.title or "Untitled case"))
    head = f'<div style="font-size:16px;font-weight:bold">{title}</div>'
    bad = "".join(f'<div style="{BAND}">{escape(line)}</div>' for line in alarm(result))
    return f'<div style="{CARD}">{head}{bad}{_facts(result)}{_contacts(result)}{_picture(result)}</div>'


def _facts(result: Result) -> str:
    """Return the table of what was run and how well its accounts close."""
    summary, energy = result.summary, result.summary["energy"]
    share = f"from {number(energy['initial'], 6)} to {number(energy['final'], 6)}"
    methods, steps = details(result)
    rows = {
        "status": result.status,
        "methods": methods,
        "steps": steps,
        "energy": f"{share}; ledger closes to {number(energy['ledger_error'])}",
        "momentum": f"closes to {number(summary['momentum']['error'])}",
    }
    body = "".join(f"<tr>{_cell(name, head=True)}{_cell(value)}</tr>" for name, value in rows.items())
    return f'<table style="{TABLE}">{body}</table>'


def _contacts(result: Result) -> str:
    """Return the table of the contacts."""
    contacts = result.summary["contacts"]
    if not contacts:
        return ""
    columns = {"impulse": "impulse", "peak_force": "peak force", "first_closed": "first closed"}
    columns["closed_time"] = "closed for"
    head = "".join(_cell(name, head=True) for name in ("contact", *columns.values()))
    lines = [
        [name, *("never" if values.get(key) is None else number(values[key], 6) for key in columns)]
        for name, values in contacts.items()
    ]
    body = "".join(f"<tr>{''.join(map(_cell, line))}</tr>" for line in lines)
    return f'<table style="{TABLE}"><tr>{head}</tr>{body}</table>'


def _picture(result: Result) -> str:
    """Return the force picture inside an img: what is in there cannot touch the styles of the page."""
    from percuss import plot

    try:
        content = plot.picture(plot.force_figure(result), "png")
    except PercussError as error:
        return f'<div style="color:{SOFT}">No picture: {escape(str(error))}</div>'
    code = base64.b64encode(content).decode("ascii")
    style = "display:block;width:100%;max-width:760px"
    return f'<img alt="contact forces over time" style="{style}" src="data:image/png;base64,{code}">'


def _cell(text: str, *, head: bool = False) -> str:
    tag, colour, weight = ("th", SOFT, "normal") if head else ("td", INK, "inherit")
    return f'<{tag} style="{CELL};color:{colour};font-weight:{weight}">{escape(text)}</{tag}>'


# -- several runs ------------------------------------------------------------------------------------------


def comparison_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Return the contact forces of several runs of one case as a matplotlib Figure.

    Parameters
    ----------
    rows
        As of `percuss.plot.plot_comparison`.
    """
    from percuss import plot

    runs = [(one_line(row["label"]), row["result"]) for row in rows if row.get("result") is not None]
    lost = [
        f"not shown: {one_line(row['label'])}: {one_line(row.get('reason') or 'no result')}"
        for row in rows
        if row.get("result") is None
    ]
    names = runs[0][1].coordinates["contact"] if runs else []
    apart = len(runs) > OVERLAY
    down = -(-len(runs) // 3) if apart else min(max(len(names), 1), OVERLAY)
    note = f"contact force in {len(runs)} of {len(rows)} runs"
    if len(names) > OVERLAY and not apart:
        note += f"; the first {OVERLAY} of {len(names)} contacts"
    with plot.drawing():
        from matplotlib.figure import Figure

        height = max(4.6, 1.9 + 2.4 * down) + 0.2 * len(lost)
        figure = Figure(figsize=(12.8, height), facecolor="white")
        header(figure, runs[0][1].title if runs else "", [note], [], lost)
        panels = figure.subplots(down, 3 if apart else 1, sharex=True, sharey=apart, squeeze=False).flat
        if not runs:
            say(panels[0], "None of the runs has a result.")
        elif apart:
            _multiples(list(panels), runs)
        else:
            entries: dict[str, Any] = {}
            for axes, name in zip(panels, names or [""], strict=False):
                entries |= _overlay(axes, runs, name, alone=len(names) < 2)
            if entries:
                legend(panels[0], entries, room=150)
                panels[-1].set(xlabel="time", xlim=(0, _end(runs)))
        settle(figure)
    return figure


def _labelled(label: str, result: Result) -> str:
    return label if result.status == "done" else f"{label}: {result.status} at {number(stopped_at(result))}"


def _overlay(axes: Axes, runs: Sequence[tuple[str, Result]], name: str, *, alone: bool) -> dict[str, Any]:
    """Draw one contact's force in every run, later runs thinner so that equal ones can be seen."""
    from percuss.plot import COLOURS, DASHES, thinned, truths

    entries: dict[str, Any] = {}
    for k, (label, result) in enumerate(runs):
        if name not in result.coordinates["contact"]:
            continue
        force = result.arrays["contact_force"][:, result.coordinates["contact"].index(name)]
        line = axes.plot(*thinned(result.arrays["time"], force), color=COLOURS[k], linestyle=DASHES[k])
        line[0].set_linewidth(2.5 - 0.25 * k)
        words = _labelled(label, result)
        entries[words if words not in entries else f"{words} ({k + 1})"] = line[0]
        _mark_stop(axes, result)
    if not entries:
        say(axes, "These runs have no contact.")
        return entries
    _bound(axes, [result for _, result in runs])
    axes.set_ylabel("contact force" if alone else f"force at {name}", parse_math=False)
    powers(axes)
    return entries | truths(axes, _witness(runs), [name])


def _end(runs: Sequence[tuple[str, Result]]) -> float:
    return max(max(stopped_at(result), float(result.summary["dt"])) for _, result in runs)


def _witness(runs: Sequence[tuple[str, Result]]) -> Result:
    """Return the run that knows the exact histories, else the first."""
    knowing = [result for _, result in runs if getattr(result, "exact_histories", None)]
    return (knowing or [runs[0][1]])[0]


def _bound(axes: Axes, results: Sequence[Result]) -> None:
    """Keep a run that ran away from flattening the others."""
    sound = [r.arrays["contact_force"] for r in results if r.status != "unstable" and r.coordinates["contact"]]
    if sound and len(sound) < len(results):
        top, bottom = max(float(f.max()) for f in sound), min(float(f.min()) for f in sound)
        room = 0.25 * ((top - bottom) or 1.0)
        axes.set_ylim(bottom - room, top + room)


def _mark_stop(axes: Axes, result: Result) -> None:
    if result.status != "done":
        axes.axvline(stopped_at(result), color=ALARM, linewidth=1.0, linestyle=(0, (1, 2)))


def _multiples(panels: Sequence[Axes], runs: Sequence[tuple[str, Result]]) -> None:
    """Draw a small panel for each run, the others behind it in grey."""
    from percuss.plot import colours, thinned, truths

    known: dict[str, Any] = {}
    for k, (axes, (label, result)) in enumerate(zip(panels, runs, strict=False)):
        for _, other in runs:
            for force in other.arrays["contact_force"].T:
                axes.plot(*thinned(other.arrays["time"], force), color="#d9d9d9", linewidth=0.8, zorder=1)
        names = result.coordinates["contact"]
        for force, colour in zip(result.arrays["contact_force"].T, colours(len(names)), strict=True):
            axes.plot(*thinned(result.arrays["time"], force), color=colour, linewidth=1.3)
        known |= truths(axes, _witness(runs), names)
        _mark_stop(axes, result)
        words = "\n".join(wrapped(_labelled(label, result), 44, 2))
        shade = INK if result.status == "done" else ALARM
        axes.set_title(words, loc="left", size=10, color=shade, parse_math=False)
        powers(axes)
        if k % 3 == 0:
            axes.set_ylabel("contact force")
        if k + 3 >= len(runs):
            axes.set_xlabel("time")
            axes.tick_params(labelbottom=True)
    for axes in panels[len(runs) :]:
        axes.set_axis_off()
    panels[0].set_xlim(0, _end(runs))
    _bound(panels[0], [result for _, result in runs])
    if known:
        legend(panels[0], known, room=46, up=1.03 + 0.1 * (1 + panels[0].get_title("left").count("\n")))
