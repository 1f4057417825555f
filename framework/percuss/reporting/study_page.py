"""One HTML file about a study: it holds all it needs, loads nothing, and says what was asked, and how to ask again."""

from __future__ import annotations

import inspect
import json
import os
import re
import shlex
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.files import PACKAGE, replacing
from percuss.jsonable import plain
from percuss.reporting import study_data
from percuss.reporting.figures import COLOURS, MORE_COLOURS, number, one_line
from percuss.reporting.study_data import Columns, StudyLike

if TYPE_CHECKING:
    from percuss.methods.registry import Registry

AGAIN = "study.yaml"
MOST_REASONS = 100
MOST_VALUES = 12  # of a varied value that are told one by one
STATUSES = ("done", "unstable", "refused", "failed", "interrupted", "lost")
DOI = re.compile(r"\bdoi:?\s*(10\.\d{4,9}/[^\s,;]+)", re.IGNORECASE)


def study_report(study: StudyLike, path: str | os.PathLike[str]) -> list[Path]:
    """Write a study as one HTML file that needs nothing beside it and asks no network.

    Parameters
    ----------
    study
        What to tell.
    path
        Where to, ending in .html.

    Returns
    -------
    list of Path
        What was written: the page, and for a study with more rows than a page can carry all of them as csv.
    """
    target = Path(path)
    beside = target.with_suffix(".csv") if len(study.table) > study_data.MOST_ROWS else None
    if beside is not None:
        with replacing(beside, ".csv") as file:
            study.table.to_csv(file, index=False)
    with replacing(target, ".html") as file:
        file.write_text(report_html(study, beside.name if beside else ""), encoding="utf-8")
    return [target] if beside is None else [target, beside]


def report_html(study: StudyLike, beside: str = "") -> str:
    """Return a study as HTML; the same study gives the same text.

    Parameters
    ----------
    study
        What to tell.
    beside
        Name of the file that has every row, where the page has not.
    """
    known = study_data.columns(study)
    data = payload(study, known)
    overview = _overview(study, known)
    parts = {
        "title": escape(one_line(study.title or "Untitled study")),
        "question": _question(study, data),
        "sampled": _sampled(data, beside),
        "stacked": " stacked" if overview else "",
        "overview": overview,
        "varied": _varied(study, known),
        "measured": _measured(study, known),
        "lost": _lost(study.table),
        "methods": _methods(study),
        "again": _again(study),
        "provenance": _provenance(plain(study.provenance)),
        "data": _script_json(data),
        "licence": escape(_file("vendor", "tabulator", "LICENSE")),
        "tabulator_css": _unmapped(_file("vendor", "tabulator", "tabulator_simple.min.css")),
        "css": _file("report.css"),
        "echarts": _unmapped(_file("vendor", "echarts", "echarts.common.min.js")),
        "tabulator": _unmapped(_file("vendor", "tabulator", "tabulator.min.js")),
        "js": _file("report.js") + _file("charts.js"),
    }
    # one pass: what is put in is never looked at again
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _file("report.html"))


# ----------------------------------------------------------------------------------------------------- data


def payload(study: StudyLike, known: Columns) -> dict[str, Any]:
    """Return what the page's scripts draw, in the terms of JSON; numbers as base64."""
    carried = study_data.carried(study.table, known)
    table = carried.table
    sampled = len(study.table) > study_data.MOST_ROWS
    roles = {name: "about" for name in ("case", "integrator", "contact") if name in table}
    roles |= dict.fromkeys(known.varied, "varied")
    roles |= {"status": "about"} | dict.fromkeys(known.measures, "measure")
    roles |= {name: "about" for name in ("fragile", "reason", "said_by", "key") if name in table}
    every = study_data.methods(study.table)
    return {
        "total": len(study.table),
        "rows": len(table),
        "seed": study_data.SEED if sampled else None,
        "methods": list(dict.fromkeys(every)),
        "colours": [*COLOURS, *MORE_COLOURS],
        "references": study_data.references(study.table),
        "costs": list(known.costs),
        "ranked": study_data.ranking(known),
        "lacking": {path: sorted(study_data.lacking(study.table, path)) for path in known.varied},
        "added": np.flatnonzero(~carried.drawn).tolist(),
        "best": carried.best,
        "columns": [_column(table, name, role, known.measures.get(name, name)) for name, role in roles.items()],
        "bands": _bands(study.table, known) if sampled else {},  # of all rows, where the page has not all
        "maps": _maps(study.table, known) if sampled else {},
        "profiles": _profiles(study.table, known) if _several_cases(study.table) else {},
        "histories": study_data.kept_histories(study, table),
    }


def _column(table: Any, name: str, role: str, words: str) -> dict[str, Any]:
    values = study_data.numbers(table[name]) if role != "about" else None
    column = {"name": name, "label": words.replace("_", " ") if role == "about" else words, "role": role}
    if values is not None:
        # in double precision: the page's csv holds the numbers that the study has
        return column | {"kind": "<f8", "data": study_data.packed(values, "<f8"), "log": study_data.is_log(values)}
    told = study_data.texts(table[name])
    levels = study_data.in_order(told)
    codes = {level: k for k, level in enumerate(levels)}
    return column | {"kind": "text", "levels": levels, "data": study_data.packed([codes[one] for one in told], "<u2")}


def _bands(table: Any, known: Columns) -> dict[str, dict[str, str]]:
    out: dict[str, dict[str, str]] = {}
    for path in known.varied:
        for method, measure, band in study_data.bands(table, list(known.measures), path):
            out.setdefault(f"{measure}|{path}", {})[method] = study_data.packed(band)
    return out


def _maps(table: Any, known: Columns) -> dict[str, Any]:
    def told(method: dict[str, Any]) -> dict[str, str]:
        return {name: study_data.packed(values) for name, values in method.items()}

    return {
        f"{x}|{y}": {
            "across": study_data.packed(one["across"]),
            "up": study_data.packed(one["up"]),
            "methods": {method: told(values) for method, values in one["methods"].items()},
        }
        for x, y, one in study_data.maps(table, list(known.measures), known.varied)
    }


def _several_cases(table: Any) -> bool:
    return int(table["case"].nunique()) > 1


def _profiles(table: Any, known: Columns) -> dict[str, Any]:
    """Return the performance profile of each measure by which runs can be ranked."""
    asked = study_data.problems(table, known.varied)
    out = {}
    for name in study_data.ranking(known):
        found = study_data.profile(table, name, asked)
        ratios = {method: study_data.packed(values, "<f8") for method, values in found.ratios.items()}
        out[name] = {"counted": found.counted, "unknown": found.unknown, "left": asked.left_out, "ratios": ratios}
    return out


def _script_json(data: dict[str, Any]) -> str:
    """Return JSON that no text in it can end or leave the script element."""
    text = json.dumps(plain(data), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    marks = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
    return re.sub("[<>&\u2028\u2029]", lambda found: marks[found[0]], text)


# ---------------------------------------------------------------------------------------------------- words


def _question(study: StudyLike, data: dict[str, Any]) -> str:
    question = study.spec.get("question")
    asked = f'<p class="question">{escape(str(question))}</p>' if question else ""
    counts = study.table["status"].value_counts().to_dict()
    told = [f"{counts[status]:,} {status}" for status in STATUSES if status in counts]
    told += [
        f"{count:,} {'still to be run' if status == study_data.WAITING else escape(str(status))}"
        for status, count in counts.items()
        if status not in STATUSES
    ]
    cases = study.table["case"].nunique()
    words = [_many(data["total"], "run"), _many(len(data["methods"]), "pair", " of methods"), _many(cases, "case")]
    return f'{asked}<p class="counts">{"  ·  ".join(words)}  ·  <strong>{", ".join(told)}</strong></p>'


def _many(count: int, what: str, tail: str = "") -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}{tail}"


def _sampled(data: dict[str, Any], beside: str) -> str:
    if data["seed"] is None:
        return ""
    where = f" Every row is in <code>{escape(beside)}</code>, beside this page." if beside else ""
    return (
        f'<p class="notice">This page carries {data["rows"]:,} of the {data["total"]:,} rows: a random sample of '
        f"{data['rows'] - len(data['added']):,} (seed {data['seed']}), and all {data['best']:,} best runs, of which "
        f"the sample lacked {len(data['added']):,}. The best are those that no other run of their case and pair of "
        "methods beats: the least of each error, and the least error at each cost. Medians, bands, maps, the table of "
        "pairs and cases, the profile, the counts above and the reasons below are those of all rows; with a filter "
        "set, medians, bands and maps are those of the sample, without the best that were added. Each chart says of "
        f"which it is."
        f"{where}</p>"
    )


def _varied(study: StudyLike, known: Columns) -> str:
    lines = []
    for path in known.varied:
        values = study_data.in_order([text for text in study_data.texts(study.table[path]) if text != ""])
        values = [study_data.as_label(text) for text in values]
        if len(values) > MOST_VALUES:
            told = f"{study.table[path].nunique():,} values from {values[0]} to {values[-1]}"
        else:
            told = ", ".join(values) or "none"
        without = sorted(study_data.lacking(study.table, path))
        lacking = f"; not a value of {', '.join(without)}" if without and values else ""
        lines.append([f"<code>{escape(path)}</code>", escape(told + lacking)])
    for name in ("case", "integrator", "contact"):
        names = [text for text in dict.fromkeys(study_data.texts(study.table[name])) if text]
        shown = [*names[:MOST_VALUES], f"and {len(names) - MOST_VALUES} more"] if len(names) > MOST_VALUES else names
        lines.append([name, escape(", ".join(shown))])
    return _table(["what", "values"], lines)


# ----------------------------------------------------------------------------------------- pairs and cases


def _overview(study: StudyLike, known: Columns) -> str:
    """Return a coloured table of pairs and cases for each measure that ranks runs; nothing for a single case."""
    names = study_data.ranking(known)
    if not _several_cases(study.table) or not names:
        return ""
    tables = [
        f'<div class="scroll overview" data-measure="{escape(name)}"{" hidden" if k else ""}>'
        f"{_pairs_and_cases(study.table, name)}</div>"
        for k, name in enumerate(names)
    ]
    return "".join(tables)


def _pairs_and_cases(table: Any, name: str) -> str:
    """Return the medians of one measure, a row a pair of methods and a column a case."""
    cells = study_data.overview(table, name)
    cases = list(dict.fromkeys(case for row in cells.values() for case in row))
    best = study_data.least_medians(cells, set(study_data.references(table)))
    largest = study_data.largest_factor(cells, best)
    lines = "".join(
        f"<tr><th>{escape(method)}</th>{''.join(_cell(row.get(case), best.get(case), largest) for case in cases)}</tr>"
        for method, row in cells.items()
    )
    top = "".join(f"<th>{escape(case)}</th>" for case in cases)
    scale = f"Colour: from the least median of the case, in bold, to {number(largest, 3)} times that or more."
    return f'<table class="plain cells"><tr><th></th>{top}</tr>{lines}</table><p class="note">{scale}</p>'


def _cell(cell: study_data.Cell | None, best: float | None, largest: float) -> str:
    if cell is None:
        return '<td class="soft">no run</td>'
    words = study_data.counted(cell)
    small = f'<span class="few">{escape(words)}</span>' if words else ""
    if not cell.known:
        return f"<td>{small}</td>"
    shade = study_data.shade(cell, best, largest)
    text = number(cell.median, 3)
    # a median over what is left of lost runs is no winner
    strong = f"<b>{text}</b>" if cell.median == best and cell.known == cell.made else text
    return f'<td class="cell" style="background:{shade}">{strong}{small}</td>'


# ---------------------------------------------------------------------------------------- further sections


def _measured(study: StudyLike, known: Columns) -> str:
    own = study_data.words(study)
    lines = [
        [
            escape(label),
            f"<code>{escape(name)}</code>",
            escape(own.get(name, "")),
        ]
        for name, label in known.measures.items()
    ]
    return _table(["measure", "column", "what it is"], lines) if own else ""


def _lost(table: Any) -> str:
    groups = study_data.lost(table)
    waiting = int((table["status"] == study_data.WAITING).sum())
    still = f"<p>{_many(waiting, 'run')} still to be made.</p>" if waiting else ""
    if not groups:
        return still or "<p>Every run came to its end.</p>"
    lines = [
        [
            f'<span class="status">{escape(group["status"])}</span>',
            f"{group['count']:,}",
            escape(group["method"]),
            escape(group["reason"] or "no reason given")
            + (f' <span class="soft">(said by {escape(group["said_by"])})</span>' if group["said_by"] else ""),
        ]
        for group in groups[:MOST_REASONS]
    ]
    left = sum(group["count"] for group in groups[MOST_REASONS:])
    more = f"<p>{left:,} more runs have rarer reasons; the table has them.</p>" if left else ""
    note = '<p class="soft">Runs whose reasons differ by numbers alone are one line, with the words of the first.</p>'
    return still + note + _table(["status", "runs", "method", "reason"], lines) + more


def _methods(study: StudyLike) -> str:
    from percuss.methods.registry import Registry

    registry: Registry = getattr(study, "registry", None) or Registry.load()
    families = {"integrators": "integrator", "contacts": "contact"}
    told = [
        _component(registry, family, name, variants)
        for family, column in families.items()
        for name, variants in _named(study_data.texts(study.table[column])).items()
    ]
    return "".join(told)


def _named(labels: list[str]) -> dict[str, list[str]]:
    """Return each method's name and how it is written in the table, where that is more than its name."""
    import yaml

    out: dict[str, list[str]] = {}
    for label in filter(None, dict.fromkeys(labels)):
        try:
            read = yaml.safe_load(label) if label.startswith("{") else label
        except yaml.YAMLError:
            read = label
        name = str(read.get("name", label)) if isinstance(read, dict) else label
        out.setdefault(name, []).extend([label] if name != label else [])
    return out


def _component(registry: Registry, family: str, name: str, variants: list[str]) -> str:
    head = f'<h3><code>{escape(name)}</code> <span class="soft">{family[:-1]}</span></h3>'
    if variants:
        head += f"<p>As {', '.join(f'<code>{escape(one)}</code>' for one in variants)}.</p>"
    if (family, name) not in registry.components:
        words = "Not registered where this page was made; the provenance below names the plug-ins of the study."
        return f'<article class="method">{head}<p class="soft">{words}</p></article>'
    component = registry.components[family, name]
    paragraphs = inspect.cleandoc(component.__doc__ or "").split("\n\n")
    formula = [p for p in paragraphs if p.startswith("Formula:")]
    rest = [p for p in paragraphs if not p.startswith("Formula:")]
    lead = "".join(f'<p class="formula">{_marked(p.removeprefix("Formula:").strip())}</p>' for p in formula)
    first = f"<p>{_marked(rest[0])}</p>" if rest else ""
    more = "".join(f"<p>{_marked(p)}</p>" for p in rest[1:])
    hidden = f"<details><summary>More about it</summary>{more}</details>" if more else ""
    sources = "".join(f"<li>{_linked(reference)}</li>" for reference in component.references)
    references = f'<ul class="references">{sources}</ul>' if sources else ""
    return f'<article class="method">{head}{first}{lead}{hidden}{references}</article>'


def _marked(text: str) -> str:
    """Return a paragraph of a docstring as HTML."""
    safe = escape(one_line(text))
    return re.sub(r"`([^`]+)`", r"<em>\1</em>", re.sub(r"``([^`]+)``", r"<code>\1</code>", safe))


def _linked(reference: str) -> str:
    """Return a reference with its DOI as a link: followed when clicked, never loaded."""
    found = DOI.search(reference)
    if found is None:
        return escape(one_line(reference))
    doi = found[1].rstrip(".)")
    link = f'<a rel="noreferrer" href="https://doi.org/{escape(doi)}">doi {escape(doi)}</a>'
    before, after = reference[: found.start()], reference[found.start(1) + len(doi) :]
    return f"{escape(one_line(before))} {link}{escape(after)}"


def _again(study: StudyLike) -> str:
    import yaml

    command = study.provenance.get("command")
    words = command if isinstance(command, str) else shlex.join(map(str, command or ("percuss", "study", AGAIN)))
    saved = f"<p>With the file below saved as <code>{AGAIN}</code> where its cases are found from:</p>"
    run = f'{"" if command else saved}<pre class="command">{escape(words)}</pre>'
    text = yaml.safe_dump(plain(study.spec), sort_keys=False, allow_unicode=True, width=100, default_flow_style=None)
    return f"{run}<p>The study file, as it was read:</p><pre>{escape(text)}</pre>"


def _provenance(known: dict[str, Any]) -> str:
    """Return all but what stands elsewhere: the command, and the sessions where there was only the one told."""
    once = len(known.get("sessions") or []) < 2
    return _nested({k: v for k, v in known.items() if k != "command" and not (k == "sessions" and once)})


def _nested(value: Any) -> str:
    """Return nested data as nested lists of definitions."""
    if isinstance(value, Mapping) and value:
        return f"<dl>{''.join(f'<dt>{escape(str(k))}</dt><dd>{_nested(v)}</dd>' for k, v in value.items())}</dl>"
    if isinstance(value, (Mapping, list)):
        if not any(isinstance(item, (dict, list)) for item in value):
            return escape(", ".join(map(str, value))) or "none"
        return f"<ul>{''.join(f'<li>{_nested(item)}</li>' for item in value)}</ul>"
    return escape("not known" if value is None else number(value, 12))


def _table(head: Iterable[str], lines: Iterable[Iterable[str]]) -> str:
    """Return a table of cells that are HTML already."""
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in line)}</tr>" for line in lines)
    return f'<div class="scroll"><table class="plain"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def _file(*names: str) -> str:
    return (PACKAGE / "web").joinpath(*names).read_text(encoding="utf-8")


def _unmapped(text: str) -> str:
    """Return a vendored file without the line that sends a browser's tools looking for its source map."""
    return re.sub(r"(//|/\*)# sourceMappingURL=\S+( \*/)?", "", text)
