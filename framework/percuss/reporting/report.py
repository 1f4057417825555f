"""The HTML representation of a run, or of an exact solution, in a notebook."""

from __future__ import annotations

import base64
import os
from functools import partial
from html import escape
from typing import TYPE_CHECKING

from percuss.errors import PercussError
from percuss.reporting.figures import (
    ALARM,
    FAINT,
    INK,
    SOFT,
    axis_end,
    check_suffix,
    one_line,
    picture,
    subtitle_lines,
    warning_lines,
    write,
)
from percuss.reporting.run_figure import figure_of, force_figure
from percuss.reporting.terminal import balances, contact_columns
from percuss.reporting.verdict import error_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from percuss.results.result import Result


# Every colour is set explicitly, so that a dark notebook shows the same light card.
CARD = (
    f"background:#ffffff;color:{INK};border:1px solid {FAINT};border-radius:6px;padding:12px 16px;"
    "max-width:780px;font-family:sans-serif;font-size:13px;line-height:1.45"
)
TABLE = f"border-collapse:collapse;background:#ffffff;color:{INK};font-size:13px;margin:6px 0"
CELL = "padding:2px 14px 2px 0;text-align:left;vertical-align:top;background:#ffffff;border:0"
BAND = f"background:{ALARM};color:#ffffff;font-weight:bold;border-radius:3px;padding:3px 8px;margin:6px 0"


def notebook_html(result: Result) -> str:
    """Return a result as HTML: its true error or solution, settings, balances, contacts and a picture of their forces.

    It looks the same in light and dark notebooks. Without matplotlib it has no picture.
    """
    if not result.marched:
        balance: dict[str, str] = {}
        facts = {"status": result.status, "solution": subtitle_lines(result)[0]}
    else:
        methods, steps = subtitle_lines(result)
        why_unknown = f": {result.summary['exact_reason']}" if result.summary["exact_reason"] else ""
        facts = {"true error": f"{error_words(result)}{why_unknown}", "status": result.status}
        facts |= {"methods": methods, "steps": steps}
        balance = balances(result)
    title = escape(one_line(result.title or "Untitled case"))
    head = f'<div style="font-size:16px;font-weight:bold">{title}</div>'
    bad = "".join(f'<div style="{BAND}">{escape(line)}</div>' for line in warning_lines(result))
    table = "".join(f"<tr>{_cell(name, head=True)}{_cell(words)}</tr>" for name, words in (facts | balance).items())
    contacts, picture_html = _contacts(result), _picture(result, axis_end(result))
    return f'<div style="{CARD}">{head}{bad}<table style="{TABLE}">{table}</table>{contacts}{picture_html}</div>'


def plotted(result: Result, path: str | os.PathLike[str] | None) -> Figure:
    """Return the figure of a result, which a notebook shows; write it to `path` if that is given."""
    if path is not None:
        check_suffix(path)
    figure = figure_of(result)
    vars(figure)["_repr_png_"] = partial(picture, figure, "png")
    if path is not None:
        write(path, figure)
    return figure


def _contacts(result: Result) -> str:
    """Return the HTML table of the contacts, or an empty text for a run without contacts."""
    if not result.summary["contacts"]:
        return ""
    columns = [column for column in contact_columns(result, none="never") if column.head != "law"]
    head = "".join(_cell(column.head, head=True) for column in columns)
    lines = zip(*(column.cells for column in columns), strict=True)
    body = "".join(f"<tr>{''.join(map(_cell, line))}</tr>" for line in lines)
    return f'<table style="{TABLE}"><tr>{head}</tr>{body}</table>'


def _picture(result: Result, until: float) -> str:
    """Return the picture of the contact forces as an img element, so that it cannot change the styles of the page."""
    try:
        content = picture(force_figure(result, until), "png")
    except PercussError as error:
        return f'<div style="color:{SOFT}">No picture: {escape(str(error))}</div>'
    code = base64.b64encode(content).decode("ascii")
    style = "display:block;width:100%;max-width:760px"
    return f'<img alt="contact forces over time" style="{style}" src="data:image/png;base64,{code}">'


def _cell(text: str, *, head: bool = False) -> str:
    tag, colour, weight = ("th", SOFT, "normal") if head else ("td", INK, "inherit")
    return f'<{tag} style="{CELL};color:{colour};font-weight:{weight}">{escape(text)}</{tag}>'
