"""The report of a study as one HTML file that loads nothing: question, results, methods, study file and provenance."""

from __future__ import annotations

import itertools
import re
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, StrictUndefined

from percuss.files import PACKAGE
from percuss.jsonable import Entries, plain
from percuss.methods.registry import Registry
from percuss.reporting import page_forces, study_charts, study_data
from percuss.reporting.component import method_text
from percuss.reporting.figures import one_line
from percuss.reporting.study_charts import Charts, count_of
from percuss.reporting.study_data import ColumnRoles
from percuss.reporting.verdict import answer, failed_rows

if TYPE_CHECKING:
    import pandas as pd

    from percuss.studies.study_table import Study

MOST_CHOICES = 16  # A value with more choices is filtered in the table alone.
NAMED = re.compile(r"^\{name: ([^,}]+).*", re.DOTALL)  # a method with options
UNKNOWN = "not registered where this page was made; the provenance below names the plug-ins of the study"
NO_FORCES = 'This study kept no forces: "keep: {histories: 200}" in its file keeps 200 points of each.'
FORCES_KEPT = (
    "Shown is the best run of each pair in the first case, until a click on a run shows its force; at most "
    f"{study_charts.MOST_FORCES} are drawn. The page has the forces of the best runs of each pair and case."
)


def report_html(study: Study, statistic: str = "best", files: Sequence[str | Path] = ()) -> str:
    """Return the report of a study as HTML; the same study gives the same text.

    Parameters
    ----------
    study
        The study.
    statistic
        What the page shows at first of several runs of a pair of methods: ``best`` or ``median``.
    files
        Single-file plug-ins whose methods the page describes beside those that are installed.
    """
    study = study_charts.snapshot(study)
    roles = study_data.columns(study)
    charts = study_charts.study_charts(study.table, roles)
    registry = Registry.load(files)
    columns = {"integrators": study.table["integrator"], "contacts": study.table["contact"]}
    named = [(family, re.sub(NAMED, r"\1", label)) for family in columns for label in study_data.texts(columns[family])]
    values = {
        "title": one_line(study.title or "Untitled study"),
        "question": study.spec.get("question"),
        "counts": [
            count_of(len(study.table), "run"),
            count_of(len(charts.pairs), "pair", " of methods"),
            count_of(len(charts.cases), "case"),
        ],
        "statuses": study.table["status"].replace(study_data.WAITING, "still to be made").value_counts().to_dict(),
        "answer": _answer(study.table, roles, charts),
        "captions": study_charts.description()["captions"],
        "lost": list(failed_rows(study_data.records(study.table, roles))),
        "methods": [
            (method_text(registry, *key) if key in registry.components else f"{key[1]}: {UNKNOWN}").partition("\n\n")
            for key in dict.fromkeys(named)
        ],
        "again": _yaml(study.spec),
        "provenance": _yaml(study.provenance),
        "data": plain(payload(study, roles, charts) | {"statistic": statistic}),
        "file": _file,
    }
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    # As little space as JSON takes; the filter escapes all characters by which a text could end the script.
    environment.policies["json.dumps_kwargs"] = {"ensure_ascii": False, "allow_nan": False, "separators": (",", ":")}
    return environment.from_string(_file("report.html")).render(values)


# ----------------------------------------------------------------------------------------------------- data


def payload(study: Study, roles: ColumnRoles, charts: Charts) -> Entries:
    """Return what the page's script draws, in the types of JSON."""
    table = study.table
    kept = page_forces.kept_histories(study, table, charts.ranked)
    first: dict[str, int] = {}
    for row in kept:
        if table["case"].iloc[row] == charts.cases[0] and table["status"].iloc[row] == "done":
            first.setdefault(charts.rows["pair"][row], row)
    shown = [name for name in table if name in study_data.ABOUT or name in roles.varied or name in roles.measures]
    order = [*study_charts.METHODS, *roles.varied, "status", *roles.measures, *study_data.ABOUT]
    values = {
        name: set(charts.rows[charts.fields[name]]) - {None, ""} for name in dict.fromkeys(order) if name in shown
    }
    varied = {name: charts.fields[name] for name in roles.varied}
    chosen = [name for name in ("case", *varied) if 1 < len(values[name]) <= MOST_CHOICES]
    return {
        "rows": charts.rows,
        "axes": {name: asdict(axis) for name, axis in charts.axes.items()},
        "pairs": charts.pairs,
        "charts": study_charts.description()["charts"],
        "looks": study_charts.looks(charts),
        "measures": charts.measures,
        "costs": charts.costs,
        "across": charts.varied,
        "mapped": charts.mapped,
        "profiles": _profiles(study.table, roles, charts),
        "columns": [_column(study, name, roles, charts) for name, distinct in values.items() if distinct],
        "filters": [(name, charts.fields[name], sorted(values[name])) for name in chosen],
        "varied": varied,
        "command": shlex.join(["percuss", "run", str(study.path), "--row"]),
        "histories": kept,
        "first": list(first.values())[: study_charts.MOST_FORCES],
        "most_forces": study_charts.MOST_FORCES,
        "force_note": FORCES_KEPT if kept else NO_FORCES,
    }


def _column(study: Study, name: str, roles: ColumnRoles, charts: Charts) -> Entries:
    """Return a column of the table: the field that it shows, and the field of its numbers with every digit."""
    field = charts.fields[name]
    return {
        "name": name,
        "title": roles.measures.get(name, name.replace("_", " ") if name in study_data.ABOUT else name),
        "what": study.columns.get(name, ""),
        "field": field,
        "raw": f"{field}r" if f"{field}r" in charts.rows else field,
        "number": not any(isinstance(value, str) for value in charts.rows[field]),
        "names": name in study_charts.METHODS,
        "varied": name in roles.varied,
    }


def _profiles(table: pd.DataFrame, roles: ColumnRoles, charts: Charts) -> Entries:
    """Return the performance profiles by the best and by the median of each measure that ranks runs."""
    if table["case"].nunique() < 2:
        return {}
    problems = study_data.problems(table, roles.varied)
    made = itertools.product(charts.ranked, study_data.STATISTICS)
    return {f"{name}|{of}": study_charts.profile_data(table, roles, name, problems, of) for name, of in made}


def _answer(table: pd.DataFrame, roles: ColumnRoles, charts: Charts) -> list[str]:
    """Return the verdict on the runs and what their error depends on as HTML, with the pairs of methods in bold."""
    sentences = [*answer(study_data.records(table, roles), roles.measures), *study_data.dependence(table, roles)]
    names = sorted(map(escape, charts.pairs), key=len, reverse=True)
    bold = re.compile("|".join(map(re.escape, names)) or "$^")
    lines = (escape(line).replace(" %", "\u00a0%") for line in sentences)  # no line ends at this space
    return [bold.sub(lambda name: f"<b>{name[0]}</b>", line) for line in lines]


def _yaml(data: Entries) -> str:
    import yaml

    return yaml.safe_dump(plain(data), sort_keys=False, allow_unicode=True, width=100, default_flow_style=None)


def _file(name: str) -> str:
    return (PACKAGE / "web" / name).read_text(encoding="utf-8")
