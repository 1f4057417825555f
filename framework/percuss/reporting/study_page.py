"""The report of a study as one HTML file that loads nothing: question, results, methods, study file and provenance."""

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
from percuss.reporting.study_data import ColumnRoles, StudyLike

if TYPE_CHECKING:
    from percuss.methods.registry import Registry

AGAIN = "study.yaml"
MOST_REASONS = 100
MOST_VALUES = 12  # Of a varied path with more values only the range is shown.
STATUSES = ("done", "unstable", "refused", "failed", "interrupted", "lost")
DOI = re.compile(r"\bdoi:?\s*(10\.\d{4,9}/[^\s,;]+)", re.IGNORECASE)


def study_report(study: StudyLike, path: str | os.PathLike[str]) -> list[Path]:
    """Write the report of a study as one HTML file that needs no other file and no network.

    Parameters
    ----------
    study
        The study.
    path
        Path of the page, ending in .html.

    Returns
    -------
    list of Path
        The written files: the page, and a csv file of all rows where the study has more rows than a page can carry.
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
    """Return the report of a study as HTML; the same study gives the same text.

    Parameters
    ----------
    study
        The study.
    beside
        Name of the file that has all rows, for a page that does not; empty otherwise.
    """
    roles = study_data.columns(study)
    data = payload(study, roles)
    overview = _overview_tables(study, roles)
    parts = {
        "title": escape(one_line(study.title or "Untitled study")),
        "question": _question_html(study, data),
        "sampled": _sampling_notice(data, beside),
        "stacked": " stacked" if overview else "",
        "overview": overview,
        "varied": _varied_table(study, roles),
        "measured": _measures_table(study, roles),
        "lost": _losses_html(study.table),
        "methods": _methods_html(study),
        "again": _command_and_file(study),
        "provenance": _provenance_html(plain(study.provenance)),
        "data": _script_json(data),
        "licence": escape(_file("vendor", "tabulator", "LICENSE")),
        "tabulator_css": _without_source_map(_file("vendor", "tabulator", "tabulator_simple.min.css")),
        "css": _file("report.css"),
        "echarts": _without_source_map(_file("vendor", "echarts", "echarts.common.min.js")),
        "tabulator": _without_source_map(_file("vendor", "tabulator", "tabulator.min.js")),
        "js": _file("report.js") + _file("charts.js"),
    }
    # One pass replaces all marks, so that marks inside an inserted text stay as they are.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _file("report.html"))


# ----------------------------------------------------------------------------------------------------- data


def payload(study: StudyLike, roles: ColumnRoles) -> dict[str, Any]:
    """Return the data that the page's scripts draw, in the types of JSON; arrays of numbers are base64 texts."""
    carried = study_data.carried(study.table, roles)
    table = carried.table
    sampled = len(study.table) > study_data.MOST_ROWS
    role_of_column = {name: "about" for name in ("case", "integrator", "contact") if name in table}
    role_of_column |= dict.fromkeys(roles.varied, "varied")
    role_of_column |= {"status": "about"} | dict.fromkeys(roles.measures, "measure")
    role_of_column |= {name: "about" for name in ("fragile", "reason", "said_by", "key") if name in table}
    method_of_row = study_data.methods(study.table)
    return {
        "total": len(study.table),
        "rows": len(table),
        "seed": study_data.SEED if sampled else None,
        "methods": list(dict.fromkeys(method_of_row)),
        "colours": [*COLOURS, *MORE_COLOURS],
        "references": study_data.references(study.table),
        "costs": list(roles.costs),
        "ranked": study_data.ranking(roles),
        "lacking": {path: sorted(study_data.lacking(study.table, path)) for path in roles.varied},
        "added": np.flatnonzero(~carried.drawn).tolist(),
        "best": carried.best,
        "columns": [
            _packed_column(table, name, role, roles.measures.get(name, name)) for name, role in role_of_column.items()
        ],
        # A page with a sample of the rows cannot compute bands and maps of all rows itself.
        "bands": _packed_bands(study.table, roles) if sampled else {},
        "maps": _packed_maps(study.table, roles) if sampled else {},
        "profiles": _packed_profiles(study.table, roles) if _several_cases(study.table) else {},
        "histories": study_data.kept_histories(study, table),
    }


def _packed_column(table: Any, name: str, role: str, words: str) -> dict[str, Any]:
    values = study_data.numbers(table[name]) if role != "about" else None
    column = {"name": name, "label": words.replace("_", " ") if role == "about" else words, "role": role}
    if values is not None:
        # Double precision, so that the csv file saved from the page holds the same numbers as the study.
        return column | {"kind": "<f8", "data": study_data.packed(values, "<f8"), "log": study_data.is_log(values)}
    values_as_text = study_data.texts(table[name])
    levels = study_data.in_order(values_as_text)
    codes = {level: k for k, level in enumerate(levels)}
    return column | {
        "kind": "text",
        "levels": levels,
        "data": study_data.packed([codes[text] for text in values_as_text], "<u2"),
    }


def _packed_bands(table: Any, roles: ColumnRoles) -> dict[str, dict[str, str]]:
    out: dict[str, dict[str, str]] = {}
    for path in roles.varied:
        for method, measure, band in study_data.bands(table, list(roles.measures), path):
            out.setdefault(f"{measure}|{path}", {})[method] = study_data.packed(band)
    return out


def _packed_maps(table: Any, roles: ColumnRoles) -> dict[str, Any]:
    def packed_cells(method: dict[str, Any]) -> dict[str, str]:
        return {name: study_data.packed(values) for name, values in method.items()}

    return {
        f"{x}|{y}": {
            "across": study_data.packed(map_of_paths["across"]),
            "up": study_data.packed(map_of_paths["up"]),
            "methods": {method: packed_cells(values) for method, values in map_of_paths["methods"].items()},
        }
        for x, y, map_of_paths in study_data.maps(table, list(roles.measures), roles.varied)
    }


def _several_cases(table: Any) -> bool:
    return int(table["case"].nunique()) > 1


def _packed_profiles(table: Any, roles: ColumnRoles) -> dict[str, Any]:
    """Return the performance profile of each measure by which runs are ranked, in the types of JSON."""
    problem_set = study_data.problems(table, roles.varied)
    out = {}
    for name in study_data.ranking(roles):
        profile = study_data.profile(table, name, problem_set)
        ratios = {method: study_data.packed(values, "<f8") for method, values in profile.ratios.items()}
        out[name] = {
            "counted": profile.counted,
            "unknown": profile.unknown,
            "left": problem_set.left_out,
            "ratios": ratios,
        }
    return out


def _script_json(data: dict[str, Any]) -> str:
    """Return JSON for a script element, with all characters escaped by which a text could end the element."""
    text = json.dumps(plain(data), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    marks = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
    return re.sub("[<>&\u2028\u2029]", lambda match: marks[match[0]], text)


# ---------------------------------------------------------------------------------------------------- words


def _question_html(study: StudyLike, data: dict[str, Any]) -> str:
    question = study.spec.get("question")
    question_html = f'<p class="question">{escape(str(question))}</p>' if question else ""
    counts = study.table["status"].value_counts().to_dict()
    status_counts = [f"{counts[status]:,} {status}" for status in STATUSES if status in counts]
    status_counts += [
        f"{count:,} {'still to be run' if status == study_data.WAITING else escape(str(status))}"
        for status, count in counts.items()
        if status not in STATUSES
    ]
    cases = study.table["case"].nunique()
    words = [
        _count_of(data["total"], "run"),
        _count_of(len(data["methods"]), "pair", " of methods"),
        _count_of(cases, "case"),
    ]
    return f'{question_html}<p class="counts">{"  ·  ".join(words)}  ·  <strong>{", ".join(status_counts)}</strong></p>'


def _count_of(count: int, noun: str, tail: str = "") -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}{tail}"


def _sampling_notice(data: dict[str, Any], beside: str) -> str:
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


def _varied_table(study: StudyLike, roles: ColumnRoles) -> str:
    lines = []
    for path in roles.varied:
        values = study_data.in_order([text for text in study_data.texts(study.table[path]) if text != ""])
        values = [study_data.as_label(text) for text in values]
        if len(values) > MOST_VALUES:
            values_in_words = f"{study.table[path].nunique():,} values from {values[0]} to {values[-1]}"
        else:
            values_in_words = ", ".join(values) or "none"
        without = sorted(study_data.lacking(study.table, path))
        lacking = f"; not a value of {', '.join(without)}" if without and values else ""
        lines.append([f"<code>{escape(path)}</code>", escape(values_in_words + lacking)])
    for name in ("case", "integrator", "contact"):
        names = [text for text in dict.fromkeys(study_data.texts(study.table[name])) if text]
        shown = [*names[:MOST_VALUES], f"and {len(names) - MOST_VALUES} more"] if len(names) > MOST_VALUES else names
        lines.append([name, escape(", ".join(shown))])
    return _table_html(["what", "values"], lines)


# ----------------------------------------------------------------------------------------- pairs and cases


def _overview_tables(study: StudyLike, roles: ColumnRoles) -> str:
    """Return a coloured table of pairs and cases for each measure that ranks runs; an empty text for a single case."""
    names = study_data.ranking(roles)
    if not _several_cases(study.table) or not names:
        return ""
    tables = [
        f'<div class="scroll overview" data-measure="{escape(name)}"{" hidden" if k else ""}>'
        f"{_pairs_and_cases(study.table, name)}</div>"
        for k, name in enumerate(names)
    ]
    return "".join(tables)


def _pairs_and_cases(table: Any, name: str) -> str:
    """Return the table of the medians of one measure, one row per pair of methods and one column per case."""
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
    if not cell.measured:
        return f"<td>{small}</td>"
    shade = study_data.shade(cell, best, largest)
    text = number(cell.median, 3)
    # A median over a part of the runs, because others were lost, does not compete for the best.
    strong = f"<b>{text}</b>" if cell.median == best and cell.measured == cell.made else text
    return f'<td class="cell" style="background:{shade}">{strong}{small}</td>'


# ---------------------------------------------------------------------------------------- further sections


def _measures_table(study: StudyLike, roles: ColumnRoles) -> str:
    descriptions = study_data.words(study)
    lines = [
        [
            escape(label),
            f"<code>{escape(name)}</code>",
            escape(descriptions.get(name, "")),
        ]
        for name, label in roles.measures.items()
    ]
    return _table_html(["measure", "column", "what it is"], lines) if descriptions else ""


def _losses_html(table: Any) -> str:
    groups = study_data.lost(table)
    waiting = int((table["status"] == study_data.WAITING).sum())
    still = f"<p>{_count_of(waiting, 'run')} still to be made.</p>" if waiting else ""
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
    return still + note + _table_html(["status", "runs", "method", "reason"], lines) + more


def _methods_html(study: StudyLike) -> str:
    from percuss.methods.registry import Registry

    registry: Registry = getattr(study, "registry", None) or Registry.load()
    families = {"integrators": "integrator", "contacts": "contact"}
    articles = [
        _component_html(registry, family, name, variants)
        for family, column in families.items()
        for name, variants in _variants_by_name(study_data.texts(study.table[column])).items()
    ]
    return "".join(articles)


def _variants_by_name(labels: list[str]) -> dict[str, list[str]]:
    """Return for each method name the labels of it in the table that hold more than the name, such as options."""
    import yaml

    out: dict[str, list[str]] = {}
    for label in filter(None, dict.fromkeys(labels)):
        try:
            parsed = yaml.safe_load(label) if label.startswith("{") else label
        except yaml.YAMLError:
            parsed = label
        name = str(parsed.get("name", label)) if isinstance(parsed, dict) else label
        out.setdefault(name, []).extend([label] if name != label else [])
    return out


def _component_html(registry: Registry, family: str, name: str, variants: list[str]) -> str:
    head = f'<h3><code>{escape(name)}</code> <span class="soft">{family[:-1]}</span></h3>'
    if variants:
        head += f"<p>As {', '.join(f'<code>{escape(variant)}</code>' for variant in variants)}.</p>"
    if (family, name) not in registry.components:
        words = "Not registered where this page was made; the provenance below names the plug-ins of the study."
        return f'<article class="method">{head}<p class="soft">{words}</p></article>'
    component = registry.components[family, name]
    paragraphs = inspect.cleandoc(component.__doc__ or "").split("\n\n")
    formula = [paragraph for paragraph in paragraphs if paragraph.startswith("Formula:")]
    rest = [paragraph for paragraph in paragraphs if not paragraph.startswith("Formula:")]
    lead = "".join(
        f'<p class="formula">{_paragraph_html(paragraph.removeprefix("Formula:").strip())}</p>' for paragraph in formula
    )
    first = f"<p>{_paragraph_html(rest[0])}</p>" if rest else ""
    more = "".join(f"<p>{_paragraph_html(paragraph)}</p>" for paragraph in rest[1:])
    hidden = f"<details><summary>More about it</summary>{more}</details>" if more else ""
    sources = "".join(f"<li>{_reference_html(reference)}</li>" for reference in component.references)
    references = f'<ul class="references">{sources}</ul>' if sources else ""
    return f'<article class="method">{head}{first}{lead}{hidden}{references}</article>'


def _paragraph_html(text: str) -> str:
    """Return a paragraph of a docstring as HTML, with its marked names and code as elements."""
    safe = escape(one_line(text))
    return re.sub(r"`([^`]+)`", r"<em>\1</em>", re.sub(r"``([^`]+)``", r"<code>\1</code>", safe))


def _reference_html(reference: str) -> str:
    """Return a reference as HTML with its DOI as a link, which the page itself never loads."""
    match = DOI.search(reference)
    if match is None:
        return escape(one_line(reference))
    doi = match[1].rstrip(".)")
    link = f'<a rel="noreferrer" href="https://doi.org/{escape(doi)}">doi {escape(doi)}</a>'
    before, after = reference[: match.start()], reference[match.start(1) + len(doi) :]
    return f"{escape(one_line(before))} {link}{escape(after)}"


def _command_and_file(study: StudyLike) -> str:
    import yaml

    command = study.provenance.get("command")
    words = command if isinstance(command, str) else shlex.join(map(str, command or ("percuss", "study", AGAIN)))
    saved = f"<p>With the file below saved as <code>{AGAIN}</code> where its cases are found from:</p>"
    run = f'{"" if command else saved}<pre class="command">{escape(words)}</pre>'
    text = yaml.safe_dump(plain(study.spec), sort_keys=False, allow_unicode=True, width=100, default_flow_style=None)
    return f"{run}<p>The study file, as it was read:</p><pre>{escape(text)}</pre>"


def _provenance_html(provenance: dict[str, Any]) -> str:
    """Return the provenance as HTML without the command, which is shown elsewhere, and without a single session."""
    single_session = len(provenance.get("sessions") or []) < 2
    return _nested(
        {
            key: value
            for key, value in provenance.items()
            if key != "command" and not (key == "sessions" and single_session)
        }
    )


def _nested(value: Any) -> str:
    """Return nested data as HTML: mappings as definition lists, other lists as items or joined texts."""
    if isinstance(value, Mapping) and value:
        return f"<dl>{''.join(f'<dt>{escape(str(k))}</dt><dd>{_nested(v)}</dd>' for k, v in value.items())}</dl>"
    if isinstance(value, (Mapping, list)):
        if not any(isinstance(item, (dict, list)) for item in value):
            return escape(", ".join(map(str, value))) or "none"
        return f"<ul>{''.join(f'<li>{_nested(item)}</li>' for item in value)}</ul>"
    return escape("not known" if value is None else number(value, 12))


def _table_html(head: Iterable[str], lines: Iterable[Iterable[str]]) -> str:
    """Return an HTML table with a head of texts and cells that are HTML already."""
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in line)}</tr>" for line in lines)
    return f'<div class="scroll"><table class="plain"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def _file(*names: str) -> str:
    return (PACKAGE / "web").joinpath(*names).read_text(encoding="utf-8")


def _without_source_map(text: str) -> str:
    """Return a vendored file without the line that makes a browser's developer tools look for its source map."""
    return re.sub(r"(//|/\*)# sourceMappingURL=\S+( \*/)?", "", text)
