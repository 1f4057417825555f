"""The report of a study as one HTML file that loads nothing: question, results, methods, study file and provenance."""

from __future__ import annotations

import itertools
import json
import os
import re
import shlex
from collections.abc import Iterable
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from percuss.case.quantities import ranking
from percuss.files import PACKAGE, expect_no_input, replacing
from percuss.jsonable import Entries, plain
from percuss.reporting import page_forces, study_charts, study_data
from percuss.reporting.component import docs
from percuss.reporting.figures import number, one_line
from percuss.reporting.study_answer import answer
from percuss.reporting.study_charts import Charts, count_of
from percuss.reporting.study_data import ColumnRoles
from percuss.reporting.verdict import failed_rows

if TYPE_CHECKING:
    import pandas as pd

    from percuss.methods.registry import Registry
    from percuss.studies.study_table import Study

AGAIN = "study.yaml"
MOST_CHOICES = 16  # A value with more choices is filtered in the table alone.
NAMED = re.compile(r"^\{name: ([^,}]+).*", re.DOTALL)  # a method with options
DOI = re.compile(r"\s*\bdoi:?\s*(10\.\d{4,9}/[^\s,;]*[^\s,;.)])", re.IGNORECASE)


def study_report(study: Study, path: str | os.PathLike[str], statistic: str = "best") -> list[Path]:
    """Write the report of a study as one HTML file that needs no other file and no network.

    Parameters
    ----------
    study
        The study.
    path
        Path of the page, ending in .html.
    statistic
        What the page shows at first of several runs of a pair of methods: ``best`` or ``median``.

    Returns
    -------
    list of Path
        The page.
    """
    target = Path(path)
    expect_no_input(target, [("study", study.path)])
    with replacing(target, ".html") as file:
        file.write_text(report_html(study, statistic), encoding="utf-8")
    return [target]


def report_html(study: Study, statistic: str = "best") -> str:
    """Return the report of a study as HTML; the same study gives the same text.

    Parameters
    ----------
    study
        The study.
    statistic
        What the page shows at first of several runs of a pair of methods: ``best`` or ``median``.
    """
    study = study_charts.snapshot(study)
    roles = study_data.columns(study)
    charts = study_charts.study_charts(study.table, roles)
    parts = {
        "title": escape(one_line(study.title or "Untitled study")),
        "question": _question_html(study, charts),
        "answer": _answer_html(answer(study.table, roles), charts),
        **{name: escape(text) for name, text in study_charts.description()["captions"].items()},
        "orders": escape(_orders_in_words(study.table, roles)),
        "measured": _measures_table(study, roles),
        "lost": _losses_html(study.table, roles),
        "methods": _methods_html(study),
        "again": _study_html(study),
        "provenance": _provenance_html(plain(study.provenance)),
        "data": _script_json(payload(study, roles, charts) | {"statistic": statistic}),
        "licences": escape(_file("vendor", "LICENSES")),
        "css": _file("report.css"),
        "tabulator_css": _file("vendor", "tabulator", "tabulator_simple.min.css"),
        "vega": _file("vendor", "vega", "vega.min.js"),
        "vega_lite": _file("vendor", "vega", "vega-lite.min.js"),
        "vega_embed": _file("vendor", "vega", "vega-embed.min.js"),
        "tabulator": _file("vendor", "tabulator", "tabulator.min.js"),
        "js": _file("report.js"),
    }
    # One pass replaces all marks, so that marks inside an inserted text stay as they are.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _file("report.html"))


# ----------------------------------------------------------------------------------------------------- data


def payload(study: Study, roles: ColumnRoles, charts: Charts) -> Entries:
    """Return what the page's script draws, in the types of JSON."""
    table = study.table
    kept = page_forces.kept_histories(study, table, charts.ranked)
    left = int(table["key"].isin(study.with_histories).sum()) - len(kept)
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
        "columns": [_column(name, roles, charts) for name, distinct in values.items() if distinct],
        "filters": [(name, charts.fields[name], sorted(values[name])) for name in chosen],
        "varied": varied,
        "command": shlex.join(["percuss", "run", str(study.path), "--row"]),
        "histories": kept,
        "first": list(first.values())[: study_charts.MOST_FORCES],
        "most_forces": study_charts.MOST_FORCES,
        "force_note": _force_words(len(kept), left),
    }


def _column(name: str, roles: ColumnRoles, charts: Charts) -> Entries:
    """Return a column of the table: the field that it shows, and the field of its numbers with every digit."""
    field = charts.fields[name]
    return {
        "name": name,
        "title": roles.measures.get(name, name.replace("_", " ") if name in study_data.ABOUT else name),
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


def _orders_in_words(table: pd.DataFrame, roles: ColumnRoles) -> str:
    ranked = ranking(roles.measures)
    if "refine" not in roles.varied or table["case"].nunique() != 1 or not ranked:
        return ""
    orders = study_data.orders(table, ranked[0])
    words = "; ".join(f"{pair} {number(order, 2)}" for pair, order in orders.items())
    return f"Observed orders of the smallest {roles.measures[ranked[0]]} over refine: {words}." if orders else ""


def _force_words(kept: int, left: int) -> str:
    if not kept:
        return 'This study kept no forces: "keep: {histories: 200}" in its file keeps 200 points of each.'
    more = f" The study keeps those of {count_of(left, 'more run')}, the worst of each pair and case." if left else ""
    first = "Shown is the best run of each pair in the first case, until a click on a run shows its force."
    most = f"At most {study_charts.MOST_FORCES} are drawn."
    return f"The page has the forces of {count_of(kept, 'run')}.{more} {first} {most}"


def _script_json(data: Entries) -> str:
    """Return JSON for a script element, with all characters escaped by which a text could end the element."""
    text = json.dumps(plain(data), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    marks = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
    return re.sub("[<>&\u2028\u2029]", lambda match: marks[match[0]], text)


# ---------------------------------------------------------------------------------------------------- words


def _answer_html(sentences: list[str], charts: Charts) -> str:
    """Return the answer as HTML, with the pairs of methods in bold."""
    names = sorted(map(escape, charts.pairs), key=len, reverse=True)
    bold = re.compile("|".join(map(re.escape, names)) or "$^")
    lines = (escape(line).replace(" %", "\u00a0%") for line in sentences)  # no line ends at this space
    return "".join(f"<li>{bold.sub(lambda name: f'<b>{name[0]}</b>', line)}</li>" for line in lines)


def _question_html(study: Study, charts: Charts) -> str:
    question = study.spec.get("question")
    question_html = f'<p class="question">{escape(str(question))}</p>' if question else ""
    counts = study.table["status"].replace(study_data.WAITING, "still to be made").value_counts()
    status_counts = [f"{count:,} {escape(str(status))}" for status, count in counts.items()]
    words = [
        count_of(len(study.table), "run"),
        count_of(len(charts.pairs), "pair", " of methods"),
        count_of(len(charts.cases), "case"),
    ]
    return f"{question_html}<p>{'  ·  '.join(words)}  ·  <strong>{', '.join(status_counts)}</strong></p>"


# ---------------------------------------------------------------------------------------- further sections


def _measures_table(study: Study, roles: ColumnRoles) -> str:
    lines = [
        [escape(label), f"<code>{escape(name)}</code>", escape(study.columns.get(name, ""))]
        for name, label in roles.measures.items()
    ]
    return _table_html(["measure", "column", "what it is"], lines)


def _losses_html(table: pd.DataFrame, roles: ColumnRoles) -> str:
    lines = list(failed_rows(study_data.records(table, roles)))
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>" if lines else "<p>No run failed.</p>"


def _methods_html(study: Study) -> str:
    from percuss.methods.registry import Registry

    registry = Registry.load()
    return "".join(
        _component_html(registry, family, name)
        for family, column in (("integrators", "integrator"), ("contacts", "contact"))
        for name in dict.fromkeys(re.sub(NAMED, r"\1", label) for label in study_data.texts(study.table[column]))
    )


def _component_html(registry: Registry, family: str, name: str) -> str:
    head = f'<h3><code>{escape(name)}</code> <span class="soft">{family[:-1]}</span></h3>'
    if (family, name) not in registry.components:
        words = "Not registered where this page was made; the provenance below names the plug-ins of the study."
        return f'<article class="method">{head}<p class="soft">{words}</p></article>'
    component = registry.components[family, name]
    first, formula, rest = docs(component)
    lead = f'<p class="formula">{_paragraph_html(formula)}</p>' if formula else ""
    more = "".join(f"<p>{_paragraph_html(paragraph)}</p>" for paragraph in filter(None, rest.split("\n\n")))
    hidden = f"<details><summary>More about it</summary>{more}</details>" if more else ""
    sources = "".join(f"<li>{_reference_html(reference)}</li>" for reference in component.references)
    references = f'<ul class="references">{sources}</ul>' if sources else ""
    return f'<article class="method">{head}<p>{_paragraph_html(first)}</p>{lead}{hidden}{references}</article>'


def _paragraph_html(text: str) -> str:
    """Return a paragraph of a docstring as HTML, with its marked names as elements."""
    return re.sub(r"`([^`]+)`", r"<em>\1</em>", escape(one_line(text)))


def _reference_html(reference: str) -> str:
    """Return a reference as HTML with its DOI as a link, which the page itself never loads."""
    before, *found = DOI.split(one_line(reference), maxsplit=1)
    if not found:
        return escape(before)
    doi, after = map(escape, found)
    return f'{escape(before)} <a rel="noreferrer" href="https://doi.org/{doi}">doi {doi}</a>{after}'


def _study_html(study: Study) -> str:
    """Return how the study is made again, and the study as it was read."""
    where = f"With this file saved as <code>{AGAIN}</code> where its cases are found from:"
    return f'<p>{where}</p><pre class="command">percuss study {AGAIN}</pre><pre>{escape(_yaml(study.spec))}</pre>'


def _provenance_html(provenance: Entries) -> str:
    """Return the provenance as HTML, without a single session."""
    left_out = {"sessions"} if len(provenance.get("sessions") or []) < 2 else set()
    return f"<pre>{escape(_yaml({key: value for key, value in provenance.items() if key not in left_out}))}</pre>"


def _yaml(data: Entries) -> str:
    import yaml

    return yaml.safe_dump(plain(data), sort_keys=False, allow_unicode=True, width=100, default_flow_style=None)


def _table_html(head: Iterable[str], lines: Iterable[Iterable[str]]) -> str:
    """Return an HTML table with a head of texts and cells that are HTML already."""
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in line)}</tr>" for line in lines)
    return f'<div class="scroll"><table class="plain"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def _file(*names: str) -> str:
    return (PACKAGE / "web").joinpath(*names).read_text(encoding="utf-8")
