"""The parts of the pages that percuss itself makes: ``python tests/support/pages.py`` writes them anew.

They are the tables of what the code declares, and the output of every command in a ``console`` block. With the paths of
pages as arguments the program writes the output on these alone.
"""

from __future__ import annotations

import math
import os
import platform
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import typer
import yaml

import places
import solid_figures
from command_line import percuss_command
from held_against import HELD, facts
from percuss.case.json_schema import case_schema
from percuss.cli.common import COMPILING
from percuss.cli.main import app
from percuss.methods.registry import Registry
from percuss.studies.layout import study_schema

FAMILIES = (
    *("integrators", "contacts", "frictions", "masses", "pairings", "materials", "elements", "shapes", "loads"),
    *("solutions", "measures"),
)
MOST_SHOWN = 10  # values that a table lists; of more it says what they are


def texts() -> dict[str, str]:
    """Return every page of the project, by its path from the top."""
    found = sorted(path for path in places.project_files() if path.suffix == ".md")
    return {path.relative_to(places.ROOT).as_posix(): path.read_text(encoding="utf-8") for path in found}


def everything() -> str:
    """Return all pages as one text."""
    return "\n".join(texts().values())


def blocks(page: str, kind: str) -> list[str]:
    """Return the blocks of one kind in a page."""
    found = re.findall(r"^```(\w+)\n(.*?)^```$", page, flags=re.MULTILINE | re.DOTALL)
    return [text for one, text in found if one == kind]


def page_with(text: str) -> Path:
    """Return the one page that holds a text: a mark, or a heading."""
    found = [name for name, page in texts().items() if text in page]
    assert len(found) == 1, f"{text!r} is in {found or 'no page'}"
    return places.ROOT / found[0]


def section(heading: str) -> str:
    """Return what stands below the one heading of this text."""
    page = page_with(f"\n{heading}\n").read_text(encoding="utf-8")
    return page.partition(f"\n{heading}\n")[2].partition("\n## ")[0]


def saved_files() -> list[tuple[str, str]]:
    """Return name and text of every file that the pages ask their reader to save."""
    pattern = r"[Ss]ave (?:this|it) as `([\w-]+\.(?:py|yaml))`:\n\n```(?:python|yaml)\n(.*?)^```$"
    return [found for page in texts().values() for found in re.findall(pattern, page, re.MULTILINE | re.DOTALL)]


def fill(folder: Path) -> None:
    """Fill a folder with the cases and the files of the pages, as a reader has them."""
    shutil.copytree(places.CASES, folder / "cases")
    for name, text in saved_files():
        (folder / name).write_text(text, encoding="utf-8")


def marks(name: str) -> tuple[str, str]:
    """Return the lines that begin and end a part of a page that is written by a program."""
    return f"<!-- {name} -->\n", f"<!-- end of {name} -->"


def shown(name: str) -> str:
    """Return what stands between the marks of a part, on the page that has it."""
    begin, end = marks(name)
    _, mark, rest = page_with(begin).read_text(encoding="utf-8").partition(begin)
    part, closing, _ = rest.partition(end)
    assert mark, name
    assert closing, name
    return part


def write(name: str, new: str) -> None:
    """Write a part anew on the page that has it."""
    begin, end = marks(name)
    page = page_with(begin)
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    page.write_text(f"{before}{begin}{new}{end}{rest.partition(end)[2]}", encoding="utf-8")
    sys.stdout.write(f"{name}: {page.relative_to(places.ROOT)}\n")


def table(head: tuple[str, ...], lines: Iterable[tuple[str, ...]]) -> str:
    """Return a table in Markdown."""
    rows = [head, tuple("---" for _ in head), *lines]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |\n" for row in rows)


def made_here() -> str:
    """Return when and where a table of measured times was made."""
    where = f"{platform.machine()} with {os.cpu_count()} cores, Python {platform.python_version()}"
    return f"Made on {date.today().isoformat()} on {where}."


# ------------------------------------------------------------------------------------------------- keys


NOUNS = {"number": "number", "integer": "whole number", "string": "text", "object": "mapping"}
NOUNS["boolean"] = "true or false"
BOUNDS = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}


def words(schema: dict[str, Any]) -> str:
    """Return what a value is, from its schema."""
    if "$ref" in schema:
        return "mapping"
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        few = len(schema["enum"]) <= MOST_SHOWN
        return " or ".join(f"`{value}`" for value in schema["enum"]) if few else "text"
    if branches := schema.get("anyOf", schema.get("oneOf")):
        found = (words(branch) for branch in branches if branch.get("type") != "null")
        return " or ".join(dict.fromkeys(filter(None, found)))
    if schema.get("type") == "array":
        items = schema.get("items") or next(iter(schema.get("prefixItems", ())), {})
        inner = words(items) if isinstance(items, dict) else ""
        count = f"{schema['minItems']} " if schema.get("minItems", 0) > 1 else ""
        return f"list of {count}{inner}s" if inner in {"number", "text"} else "list"
    bounds = (f"{sign} {schema[key]:g}" for key, sign in BOUNDS.items() if key in schema)
    return " ".join([NOUNS.get(schema.get("type", ""), ""), *bounds]).strip()


def resolved(schema: dict[str, Any], whole: dict[str, Any]) -> dict[str, Any]:
    """Return a schema with the one that it refers to in its place."""
    while "$ref" in schema:
        target: Any = whole
        for part in schema["$ref"].removeprefix("#/").split("/"):
            target = target[part]
        schema = {**target, **{key: value for key, value in schema.items() if key != "$ref"}}
    return schema


def alternatives(schema: dict[str, Any], whole: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a schema and each that may stand for it, those within others too."""
    schema = resolved(schema, whole)
    yield schema
    for branch in (schema.get("then", {}), *schema.get("anyOf", ())):
        if branch:
            yield from alternatives(branch, whole)


def keys(
    schema: dict[str, Any], whole: dict[str, Any], path: str = "", skip: frozenset[str] = frozenset()
) -> Iterator[tuple[str, ...]]:
    """Yield path, value, default and meaning of every key of a schema, less the components of a case."""
    required = set(schema.get("required", ()))
    for key, raw in schema.get("properties", {}).items():
        if key in skip:
            continue
        entry = resolved(raw, whole)
        default = entry.get("default")
        shown = "required" if key in required else "" if default in (None, "", [], (), {}) else f"`{default}`"
        component = "if" in entry  # its options hang on its name
        value = "a component" if component else words(entry)
        yield f"`{path}{key}`", value, shown, entry.get("description", "")
        if component:
            continue
        for one in alternatives(entry, whole):
            named, items = one.get("additionalProperties"), one.get("items")
            inner, step = (named, ".NAME.") if isinstance(named, dict) else (items, "[].")
            yield from keys(one, whole, f"{path}{key}.", skip)
            for each in alternatives(inner, whole) if isinstance(inner, dict) else ():
                yield from keys(each, whole, f"{path}{key}{step}", skip)


KEYS = {  # the tables of keys: those of a case, and those of a study, by the words with which the keys begin
    "keys of bodies": ("case", ("bodies",)),
    "keys of contacts and loads": ("case", ("contacts", "loads")),
    "keys of time, method and record": ("case", ("time", "method", "record")),
    "keys of expectations": ("case", ("expect",)),
    "keys of runs": ("study", ("methods", "vary", "paired", "sample", "where")),
    "keys of measures": ("study", ("measure",)),
}
REST = {"keys of a case": "case", "keys of a study": "study"}  # the keys that no table above has


def keys_of(name: str) -> Callable[[Registry], str]:
    """Return what makes a table of keys; options of components stand in another table."""
    kind, heads = KEYS[name] if name in KEYS else (REST[name], None)
    others = {head for other, words in KEYS.values() if other == kind for head in words}

    def make(registry: Registry) -> str:
        skip = frozenset(name for family in ("shapes", "loads") for name in registry.names(family))
        schema = case_schema(registry) if kind == "case" else study_schema(registry)
        chosen = (
            line
            for line in keys(schema, schema, skip=skip if kind == "case" else frozenset())
            for head in [line[0].strip("`").partition(".")[0].removesuffix("[]")]
            if (head in heads if heads else head not in others)
        )
        return table(("key", "value", "default", "meaning"), chosen)

    return make


# ---------------------------------------------------------------------------------------------- the rest


def components(family: str, registry: Registry) -> str:
    """Return the table of every component of a family."""
    from percuss.case.options import options_of

    lines = (
        (f"`{name}`", cls.summary, ", ".join(f"`{key}`" for key in options_of(cls)))
        for name in registry.names(family)
        for cls in [registry.get(family, name)]
    )
    return table(("name", "what it does", "options"), lines)


def held_against(family: str, registry: Registry) -> str:
    """Return the table of what each method of a family declares and of what it is held against."""
    head = ("name", *(("order", "limit") if family == "integrators" else ()), "keeps", "held against")
    return table(head, facts(family, registry))


def commands(_: Registry) -> str:
    """Return the table of the commands."""
    group = typer.main.get_command(app)
    lines = (
        (f"`percuss {name}`", (command.help or "").strip().split("\n\n")[0].replace("\n", " "))
        for name, command in group.commands.items()
    )
    return table(("command", "what it does"), lines)


def shipped_cases(_: Registry) -> str:
    """Return the table of the shipped cases."""
    lines = []
    for path in sorted(places.CASES.glob("*.yaml")):
        case = yaml.safe_load(path.read_text(encoding="utf-8"))
        held = sorted({str(entry["source"]).split(" on ")[0] for entry in case.get("expect", ())})
        lines.append((f"[{path.stem}]({path.name})", case["title"], " ".join(case["source"].split()), ", ".join(held)))
    return table(("case", "what happens", "source", "held against"), iter(lines))


# ---------------------------------------------------------------------------------------------- output

# A block of one command and its output. A comment above it says how many of the lines are shown, if not all.
SESSION = re.compile(
    r"^(?:<!-- first (\d+), last (\d+) lines -->\n)?```console\n\$ ([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL
)
COLUMNS = 100  # of the terminal whose output the pages show
NOTICE = re.compile(rf"{COMPILING}|\d+ of \d+ \w+ after ")  # what only a slow machine says
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def output(command: str, folder: Path) -> str:
    """Return what a terminal shows of a command, without the notices that it compiles and how far it is."""
    name, *words = shlex.split(command)
    assert name == "percuss", command
    lines = percuss_command(*words, cwd=folder, columns=COLUMNS, together=True).stdout.splitlines()
    return "".join(f"{line.rstrip()}\n" for line in lines if not NOTICE.match(line))


def shortened(text: str, first: str, last: str) -> str:
    """Return the first and the last lines of a text, as many as a page shows."""
    lines = text.splitlines(keepends=True)
    if not first or len(lines) <= int(first) + int(last) + 1:
        return text
    return "".join([*lines[: int(first)], "...\n", *lines[len(lines) - int(last) :]])


def masked(text: str) -> str:
    """Return a text without what another machine changes: times, widths of tables, and what percuss tried in them."""
    text = re.sub(r"^percuss tried .*\n", "", text, flags=re.MULTILINE)
    text = re.sub(r"(off by [\d.]+ % \(exact solution known\)).*", r"\1", text)
    text = re.sub(r"[\d.e-]+ (s|ms|min|kB|MB)\b", r"# \1", text)
    lines, timed = [], False
    for line in text.splitlines():
        if not line.startswith("|"):
            timed = False
        timed = timed or bool(re.search(r"\| +(s|seconds) +\|$", line))
        lines.append(re.sub(r"\|[^|]*\|$", "|#|", line) if timed else line)
    return re.sub(r"-{2,}", "--", re.sub(r" +", " ", "\n".join(line.strip() for line in lines)))


def alike(one: str, other: str) -> bool:
    """Return whether two outputs say the same: the same words, and numbers that agree to 1 per mille."""
    one, other = masked(one), masked(other)
    numbers = ([float(number) for number in NUMBER.findall(text)] for text in (one, other))
    return NUMBER.sub("#", one) == NUMBER.sub("#", other) and all(
        math.isclose(a, b, rel_tol=1e-3, abs_tol=1e-12) for a, b in zip(*numbers, strict=True)
    )


def sessions(page: str, folder: Path) -> Iterator[tuple[str, str, str]]:
    """Run the commands of a page one after the other; yield each with the output shown and the one made."""
    for first, last, command, there in SESSION.findall(page):
        yield command, there, shortened(output(command, folder), first, last)


def write_output(name: str, page: str) -> None:
    """Write the output of the commands of a page anew where it says something else."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        fill(folder)
        for command, there, made in sessions(page, folder):
            if not alike(there, made):
                block = f"$ {command}\n"
                page = page.replace(f"{block}{there}```", f"{block}{made}```")
                sys.stdout.write(f"{name}: {command}\n")
    (places.ROOT / name).write_text(page, encoding="utf-8")


TABLES = {
    **{name: keys_of(name) for name in (*REST, *KEYS)},
    "commands": commands,
    "shipped cases": shipped_cases,
    "patch tests": lambda _: table(*solid_figures.patch_tests()),
    "responses of surfaces": lambda _: table(*solid_figures.responses()),
    "critical steps of cells": lambda _: table(*solid_figures.steps()),
    "energies over switching": lambda _: table(*solid_figures.energies()),
    "elements of solids": lambda _: table(*solid_figures.elements()),
    "growth rates of sliding": lambda _: table(*solid_figures.rates()),
    **{f"{family} with options": partial(components, family) for family in FAMILIES},
    **{f"{family} held against": partial(held_against, family) for family in HELD},
}


def main() -> None:
    """Write every table into its page, and the output of every command."""
    registry = Registry.load()
    for name, make in TABLES.items():
        write(name, make(registry))
    for name, page in texts().items():
        if "```console" in page and name in (sys.argv[1:] or [name]):
            write_output(name, page)


if __name__ == "__main__":
    main()
