"""The first files of a method: a package that can be installed and tested, or a single file, ready to run."""

from __future__ import annotations

import importlib.util
import json
import keyword
import os
import re
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import percuss
from percuss import version
from percuss.case.json_schema import case_schema
from percuss.case.yaml_text import flow
from percuss.errors import InputError, Problem, refuse_if_any, suggestion
from percuss.files import PACKAGE, is_folder
from percuss.methods.interfaces import FAMILIES, NAME_PATTERN
from percuss.methods.registry import Registry

TEMPLATES = PACKAGE / "templates"
KINDS = {
    **{{"masses": "mass"}.get(family, family[:-1]): family for family in FAMILIES},
    "solid-element": "elements",
    "solid-material": "materials",
}
DISTRIBUTION = re.compile(r"[A-Za-z]([A-Za-z0-9_-]*[A-Za-z0-9])?")


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


def new(name: str, kind: str, folder: str | os.PathLike[str] = ".", *, single_file: bool = False) -> Scaffold:
    """Write the first files of a method, which run as they are, and return their paths.

    Parameters
    ----------
    name
        Name of the method as it is written in a case; the package has the same name, with ``_`` for ``-``.
    kind
        ``integrator``, ``contact``, ``pairing``, ``load``, ``shape``, ``element``, ``material``, ``mass``,
        ``solution`` or ``measure``; ``solid-element`` or ``solid-material`` for bodies in two dimensions.
    folder
        Existing folder in which the folder `name` is made, or the files of a single-file plug-in.
    single_file
        Whether to write ``NAME.py`` and a case beside it, and no package.

    Raises
    ------
    InputError
        If the name, the kind or the folder cannot be used, or a file exists already; nothing is written then.
    """
    out = Path(folder)
    _expect_valid(name, kind, out, single_file=single_file)
    texts = _file_texts(name, kind, single_file=single_file)
    code, schema = next(iter(texts)), f"{name}.schema.json"
    files = (*texts, schema)
    targets = [out / file for file in files] if single_file else [out / name]
    taken = [target for target in targets if target.exists() or target.is_symlink()]
    if taken:
        advice = "Nothing was overwritten: take another name or folder."
        raise InputError([Problem(str(target), "", "this exists already", advice) for target in taken])
    try:
        with tempfile.TemporaryDirectory(prefix=f".{name}.", dir=out) as temporary:
            draft = Path(temporary) / name
            for file, text in texts.items():
                (draft / file).parent.mkdir(parents=True, exist_ok=True)
                (draft / file).write_text(text, encoding="utf-8")
            known = case_schema(Registry.load([draft / code]))
            (draft / schema).write_text(json.dumps(known, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
            _rename_all({(draft / target.name if single_file else draft): target for target in targets})
    except OSError as error:
        raise InputError([Problem(str(out), "", f"cannot be written to: {error.strerror}", "")]) from error
    root = out if single_file else out / name
    return Scaffold(
        name,
        kind,
        KINDS[kind],
        _class_name(name, _template(f"{kind}.py")),
        tuple(root / file for file in files),
        _next_commands(name, kind, root, single_file=single_file),
    )


def _expect_valid(name: str, kind: str, out: Path, *, single_file: bool) -> None:
    """Raise InputError with all problems of a name, a kind and a folder, if there are any."""
    problems = []
    family = KINDS.get(kind)
    if family is None:
        problems.append(Problem(f"--kind {kind}", "", "unknown kind", suggestion(kind, KINDS, "kind")))
    word = name.replace("-", "_")
    if not NAME_PATTERN.fullmatch(name) or not DISTRIBUTION.fullmatch(name):
        advice = "Start with a letter, then letters, digits, _ and -; end with a letter or a digit."
        problems.append(Problem(name, "", "expected a name for a method", advice))
    elif flow(name) != name or keyword.iskeyword(word):
        language = "Python" if keyword.iskeyword(word) else "YAML"
        problems.append(Problem(name, "", f"this is a word of {language}", "Take another name."))
    elif not single_file and (word in sys.stdlib_module_names or _importable(word, out / name)):
        problems.append(Problem(name, "", f"there is a module '{word}' already", "Take another name."))
    elif family is not None:
        registry = Registry.load()
        sources = registry.clashes.get((family, name)) or [registry.sources.get((family, name))]
        if sources[0] is not None:
            owners = " and by ".join(map(str, sources))
            problems.append(
                Problem(name, "", f"{family} '{name}' is registered by {owners} already", "Take another name.")
            )
    if not is_folder(out):
        problems.append(Problem(str(out), "", "expected a folder that exists", f"Make it first: mkdir -p {out}"))
    refuse_if_any(problems)


def _importable(word: str, own_folder: Path) -> bool:
    """Return whether a module of that name can be imported, except from the folder `own_folder`."""
    spec = importlib.util.find_spec(word)
    places = [*(spec.submodule_search_locations or ()), spec.origin or ""] if spec else []
    return any(place and Path(place) != own_folder.absolute() for place in places)


def _template(file: str) -> str:
    return (TEMPLATES / f"{file}.txt").read_text(encoding="utf-8")


def _class_name(name: str, code: str) -> str:
    """Return the class name: the method's name in camel case, plus ``Method`` if the code or percuss uses that word."""
    class_name = "".join(part[:1].upper() + part[1:] for part in re.split("[-_]+", name))
    used = {*re.findall(r"\w+", code), *dir(percuss)} - {"MyMethod"}  # in whose place the name comes
    return f"{class_name}Method" if class_name in used else class_name


def _file_texts(name: str, kind: str, *, single_file: bool) -> dict[str, str]:
    """Return the texts of the files to write, by path relative to the folder of the method."""
    code = _template(f"{kind}.py")
    case = f"# yaml-language-server: $schema={name}.schema.json\n{_template(f'{kind}.yaml')}"
    summary = re.search(r'^    summary = "(.*)"$', code, flags=re.MULTILINE)
    study = (TEMPLATES / f"{kind}.study.yaml.txt").exists()  # A component that no case can name has a study.
    file, module = (name, name) if single_file else ("case", name.replace("-", "_"))
    if single_file:
        texts = {f"{name}.py": code, f"{name}.yaml": case.replace("title:", f"plugins: [{name}.py]\ntitle:", 1)}
    else:
        texts = {
            f"{module}.py": code,
            f"tests/test_{module}.py": _template("test.py"),
            "case.yaml": case,
            "pyproject.toml": _template("pyproject.toml"),
            "README.md": _template("README.md"),
        }
    if study:
        texts[f"{name}.study.yaml" if single_file else "study.yaml"] = _template(f"{kind}.study.yaml")
    words = {
        "my-method": name,
        "my_method": module,
        "MyMethod": _class_name(name, code),
        "@CASE@": f"{file}.yaml",
        "@CONTRACT@": str(version.CONTRACT),
        "@FAMILY@": KINDS[kind],
        "@NEXT@": "\n".join(_next_commands(name, kind, None, single_file=False)),
        "@PERCUSS@": version.__version__,
        "@SUMMARY@": summary[1] if summary else "",
    }
    pattern = re.compile("|".join(map(re.escape, words)))
    return {file: pattern.sub(lambda match: words[match[0]], text) for file, text in texts.items()}


def _next_commands(name: str, kind: str, root: Path | None, *, single_file: bool) -> tuple[str, ...]:
    """Return the commands to continue with, for the current folder, or for the method's folder if `root` is None."""
    study = (TEMPLATES / f"{kind}.study.yaml.txt").exists()
    if single_file:
        start = "" if root is None or root == Path() else f"{root}{os.sep}"
        use = f"percuss study {start}{name}.study.yaml" if study else f"percuss run {start}{name}.yaml"
        return (use, f"percuss verify --plugin {start}{name}.py")
    enter = () if root is None else (f"cd {root}",)
    use = "percuss study study.yaml" if study else "percuss run case.yaml"
    return (*enter, "pip install -e '.[test]'", use, "pytest")


def _rename_all(places: Mapping[Path, Path]) -> None:
    """Rename all files, or remove those already renamed and raise the error if one rename fails."""
    done: list[Path] = []
    try:
        for source, target in places.items():
            source.rename(target)
            done.append(target)
    except OSError:
        for target in done:
            target.unlink()
        raise
