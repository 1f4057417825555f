"""Figures of a study for print and for notebooks, drawn from the descriptions of its page."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from percuss.case.arguments import expect_suffix
from percuss.errors import InputError, PercussError, Problem
from percuss.files import replacing
from percuss.jsonable import Entries
from percuss.reporting import study_charts, study_data
from percuss.reporting.figures import SUFFIXES, one_line
from percuss.reporting.study_charts import Charts, filled, side_marks

if TYPE_CHECKING:
    from percuss.studies.study_table import Study

KINDS = (".svg", ".pdf")
WIDTH, HEIGHT = 360, 260  # of a panel, in pixels


class Chart(dict[str, Any]):
    """A chart in Vega-Lite with its data, which a notebook shows."""

    def _repr_svg_(self) -> str:
        return str(renderer().vegalite_to_svg(self))


def study_figures(study: Study, folder: str | os.PathLike[str], statistic: str = "best") -> list[Path]:
    """Write the figures of a study as svg and pdf files.

    Parameters
    ----------
    study
        The study.
    folder
        Folder of the files; it is made if it does not exist.
    statistic
        What the lines over a varied value and the profile show of several runs of a pair: ``best`` or ``median``.

    Returns
    -------
    list of Path
        The files, two for each of the `figures`.
    """
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = error.strerror or "cannot be made"
        raise InputError([Problem(str(target), "", f"expected a folder that can be written to: {why}")]) from error
    out = []
    for name, chart in figures(study, statistic):
        out += [target / f"{name}{kind}" for kind in KINDS]
        write(chart, *out[-2:])
    return out


def figures(study: Study, statistic: str = "best") -> Iterator[tuple[str, Chart]]:
    """Yield the name and the chart of each figure of a study.

    These are ``best-and-median``; one ``work-precision`` for each cost; one ``against-...`` for each varied path with
    more than one value; for several cases also ``performance-profile``. Each case has a panel of its own.
    """
    study = study_charts.snapshot(study)
    roles = study_data.columns(study)
    charts = study_charts.study_charts(study.table, roles)
    fields, columns = charts.rows.keys(), charts.rows.values()
    data = {"rows": [dict(zip(fields, values, strict=True)) for values in zip(*columns, strict=True)]}
    if not charts.measures:
        return
    error = charts.measures[0]
    scale = charts.axes[error].scale | {"range": [0, 0.68 * WIDTH]}
    marks = side_marks("y", charts.axes[error]) | {"best_scale": scale}
    marks["statistic"] = statistic if error in charts.ranked else "median"

    def drawn(name: str, across: str) -> Chart:
        return _chart(study, charts, name, data, marks | side_marks("x", charts.axes[across]))

    yield "best-and-median", drawn("best", error)
    for n, cost in enumerate(charts.costs):
        yield f"work-precision-{_file_name(cost)}" if n else "work-precision", drawn("work", cost)
    for path in (name for name in charts.varied if name in roles.varied):
        yield f"against-{_file_name(path)}", drawn("vary", path)
    if len(charts.cases) > 1 and charts.ranked:
        problems = study_data.problems(study.table, roles.varied)
        profile = study_charts.profile_data(study.table, roles, error, problems, statistic)
        label = {"profile_label": profile["label"]}
        yield (
            "performance-profile",
            _chart(study, charts, "profile", {"profile": profile["lines"]}, label, profile["note"]),
        )


def work_and_precision(study: Study) -> Chart:
    """Return the chart of the error of all runs over their cost, or one that says that there is none."""
    words = {"type": "text", "text": "No run has a cost and an error.", "fontSize": 16}
    none = Chart(title=one_line(study.title), data={"values": [{}]}, mark=words, width=WIDTH, height=HEIGHT)
    return dict(figures(study)).get("work-precision", none)


def _chart(study: Study, charts: Charts, name: str, data: Entries, marks: Entries, note: str = "") -> Chart:
    """Return a chart for print, with its title and its caption."""
    look = study_charts.looks(charts)["light"]
    size = {"columns": 2, "width": WIDTH, "height": HEIGHT}
    if name == "profile":
        size["width"] = 2 * WIDTH
    chart = filled(study_charts.description()["charts"][name], look["marks"] | size | marks)
    captions = study_charts.description()["captions"]
    words = [line for text in (captions[name], note) for line in textwrap.wrap(text, 110)]
    title = {"text": one_line(study.title or "Untitled study"), "subtitle": words}
    return Chart(title=title, config=look["config"] | {"background": "white"}, datasets=data, **chart)


def _file_name(column: str) -> str:
    return re.sub(r"[^0-9A-Za-z_]+", "-", column)


def renderer() -> Any:
    """Return the library that draws charts.

    Raises
    ------
    PercussError
        If it is not installed.
    """
    try:
        import vl_convert
    except ImportError as error:
        message = "a figure of a study needs vl-convert-python, which is not installed: pip install 'percuss[plot]'"
        raise PercussError(message) from error
    return vl_convert


def check_drawable(path: str | os.PathLike[str]) -> None:
    """Refuse the path of a chart that cannot be drawn, for its suffix or for want of the library."""
    expect_suffix(path, "a picture", SUFFIXES, "Name the file with one of the three.")
    renderer()


def write(chart: Chart, *paths: Path) -> None:
    """Write a chart as png, svg or pdf files, by suffix, each completely or not at all."""
    drawn = renderer().vegalite_to_svg(chart)
    kinds = {".svg": str.encode, ".pdf": renderer().svg_to_pdf, ".png": partial(renderer().svg_to_png, scale=2)}
    for path in paths:
        with replacing(path, path.suffix) as beside:
            beside.write_bytes(kinds[path.suffix.lower()](drawn))
