"""The first files of a method: a single-file plug-in and a case that uses it, ready to run."""

from __future__ import annotations

import json
import keyword
import os
import re
from dataclasses import dataclass
from pathlib import Path

import percuss
from percuss import version
from percuss.case.json_schema import case_schema
from percuss.case.yaml_text import flow
from percuss.errors import Problem, refuse_if_any, suggestion
from percuss.files import PACKAGE, is_folder
from percuss.methods.interfaces import FAMILIES, NAME_PATTERN
from percuss.methods.registry import Registry

TEMPLATES = PACKAGE / "templates"
KINDS = {
    **{{"masses": "mass"}.get(family, family[:-1]): family for family in FAMILIES},
    "solid-element": "elements",
    "solid-material": "materials",
}


@dataclass(frozen=True)
class Scaffold:
    """The written files of a method.

    Attributes
    ----------
    name, kind, family
        Name, kind and family of the method.
    component
        Name of its class.
    files
        Written files, in the order in which they should be read.
    next
        Commands to continue with.
    """

    name: str
    kind: str
    family: str
    component: str
    files: tuple[Path, ...]
    next: tuple[str, ...]


def new(name: str, kind: str, folder: str | os.PathLike[str] = ".") -> Scaffold:
    """Write the first files of a method, which run as they are, and return their paths.

    Parameters
    ----------
    name
        Name of the method as it is written in a case.
    kind
        ``integrator``, ``contact``, ``friction``, ``pairing``, ``load``, ``shape``, ``element``, ``material``,
        ``mass``, ``solution`` or ``measure``; ``solid-element`` or ``solid-material`` for bodies in two dimensions.
    folder
        Existing folder in which the files are made: ``NAME.py``, a case beside it, and the schema of the case.

    Raises
    ------
    InputError
        If the name, the kind or the folder cannot be used, or a file exists already; nothing is written then.
    """
    out = Path(folder)
    _expect_valid(name, kind, out)
    code = _template(f"{kind}.py")
    component = _class_name(name, code)
    case = f"# yaml-language-server: $schema={name}.schema.json\n{_template(f'{kind}.yaml')}"
    texts = {f"{name}.py": code, f"{name}.yaml": case.replace("title:", f"plugins: [{name}.py]\ntitle:", 1)}
    has_study = kind == "measure"  # no case names a measure
    if has_study:
        texts[f"{name}.study.yaml"] = _template(f"{kind}.study.yaml")
    files = tuple(out / file for file in (*texts, f"{name}.schema.json"))
    advice = "Nothing was overwritten: take another name or folder."
    taken = [file for file in files if os.path.lexists(file)]
    refuse_if_any([Problem(str(file), "", "this exists already", advice) for file in taken])
    for file, text in zip(files, texts.values(), strict=False):
        named = text.replace("my-method", name).replace("MyMethod", component)
        file.write_text(named.replace("@CONTRACT@", str(version.CONTRACT)), encoding="utf-8")
    known = case_schema(Registry.load(files[:1]))
    files[-1].write_text(json.dumps(known, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    use = f"study {out / f'{name}.study.yaml'}" if has_study else f"run {files[1]}"
    commands = (f"percuss {use}", f"percuss verify --plugin {files[0]}")
    return Scaffold(name, kind, KINDS[kind], component, files, commands)


def _expect_valid(name: str, kind: str, out: Path) -> None:
    """Raise InputError with all problems of a name, a kind and a folder, if there are any."""
    problems = []
    family = KINDS.get(kind)
    if family is None:
        problems.append(Problem(f"--kind {kind}", "", "unknown kind", suggestion(kind, KINDS, "kind")))
    if not NAME_PATTERN.fullmatch(name) or not name.isascii() or flow(name) != name:
        advice = "Start with a letter, then letters, digits, _ and -; a word of YAML, as true, is no name."
        problems.append(Problem(name, "", "expected a name for a method", advice))
    elif family is not None and (source := Registry.load().sources.get((family, name))):
        why = f"{family} '{name}' is registered by {source} already"
        problems.append(Problem(name, "", why, "Take another name."))
    if not is_folder(out):
        problems.append(Problem(str(out), "", "expected a folder that exists", f"Make it first: mkdir -p {out}"))
    refuse_if_any(problems)


def _template(file: str) -> str:
    return (TEMPLATES / f"{file}.txt").read_text(encoding="utf-8")


def _class_name(name: str, code: str) -> str:
    """Return the method's name in camel case, plus ``Method`` if Python, the code or percuss uses that word."""
    class_name = "".join(part[:1].upper() + part[1:] for part in re.split("[-_]+", name))
    used = {*re.findall(r"\w+", code), *dir(percuss), *keyword.kwlist} - {"MyMethod"}  # in whose place the name comes
    return f"{class_name}Method" if class_name in used else class_name
