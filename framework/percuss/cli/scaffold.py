"""The first files of a method: a package that can be installed and tested, or a single file; each runs as it stands."""

from __future__ import annotations

import contextlib
import importlib.util
import keyword
import os
import re
import shutil
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import percuss
from percuss.case.yaml_text import flow
from percuss.errors import InputError, Problem, suggestion
from percuss.files import PACKAGE
from percuss.methods.interfaces import FAMILIES, NAME_PATTERN
from percuss.methods.registry import Registry

__all__ = ["KINDS", "Scaffold", "scaffold"]

KINDS = {{"masses": "mass"}.get(family, family[:-1]): family for family in FAMILIES}
TEMPLATES = PACKAGE / "templates"
DISTRIBUTION = re.compile(r"[A-Za-z]([A-Za-z0-9_-]*[A-Za-z0-9])?")


@dataclass(frozen=True)
class Scaffold:
    """What was written.

    Attributes
    ----------
    name, kind, family
        Of the method.
    component
        Name of its class.
    files
        What was written, in the order in which it is read.
    next
        Commands to go on with.
    """

    name: str
    kind: str
    family: str
    component: str
    files: tuple[Path, ...]
    next: tuple[str, ...]


def scaffold(name: str, kind: str, out: Path, *, single_file: bool = False) -> Scaffold:
    """Write the first files of a method.

    Parameters
    ----------
    name
        As it is to be written in a case; the package takes it too, with ``_`` for ``-``.
    kind
        One of `KINDS`.
    out
        Existing folder in which the folder `name` is made, or the files of a single-file plug-in.
    single_file
        Whether to write ``NAME.py`` and a case beside it, and no package.

    Raises
    ------
    InputError
        If a name cannot be had, or a file is there already; nothing is written then.
    """
    _check(name, kind, out, single_file=single_file)
    texts = _filled(name, kind, single_file=single_file)
    targets = [out / file for file in texts] if single_file else [out / name]
    taken = [target for target in targets if target.exists() or target.is_symlink()]
    if taken:
        raise InputError([Problem(str(one), "", "this is there already", "Nothing is overwritten.") for one in taken])
    with _beside(out, name) as folder:
        for file, text in texts.items():
            (folder / file).parent.mkdir(exist_ok=True)
            (folder / file).write_text(text, encoding="utf-8")
        _moved({(folder / target.name if single_file else folder): target for target in targets})
    root = out if single_file else out / name
    return Scaffold(
        name,
        kind,
        KINDS[kind],
        _class_name(name, _template(f"{kind}.py")),
        tuple(root / file for file in texts),
        _next(name, kind, root, single_file=single_file),
    )


def _check(name: str, kind: str, out: Path, *, single_file: bool) -> None:
    """Raise InputError with everything that is wrong with a name, a kind and a folder."""
    problems = []
    family = KINDS.get(kind)
    if family is None:
        problems.append(Problem(f"--kind {kind}", "", "there is no such kind", suggestion(kind, KINDS, "kind")))
    word = name.replace("-", "_")
    if not NAME_PATTERN.fullmatch(name) or not DISTRIBUTION.fullmatch(name):
        advice = "Start with a letter, then letters, digits, _ and -; end with a letter or a digit."
        problems.append(Problem(name, "", "this is no name for a method", advice))
    elif flow(name) != name or keyword.iskeyword(word):
        language = "Python" if keyword.iskeyword(word) else "YAML"
        problems.append(Problem(name, "", f"this is a word of {language}", "Take another name."))
    elif not single_file and (word in sys.stdlib_module_names or _importable(word, out / name)):
        problems.append(Problem(name, "", f"there is a module '{word}' already", "Take another name."))
    elif family is not None:
        registry = Registry.load()
        sources = registry.clashes.get((family, name)) or [registry.sources.get((family, name))]
        if sources[0] is not None:
            who = " and by ".join(map(str, sources))
            problems.append(
                Problem(name, "", f"{family} '{name}' is registered by {who} already", "Take another name.")
            )
    if not out.is_dir():
        problems.append(Problem(str(out), "", "expected a folder that exists", f"Make it first: mkdir -p {out}"))
    if problems:
        raise InputError(problems)


def _importable(word: str, but: Path) -> bool:
    """Return whether a module of that name can be imported, other than from the folder `but`."""
    found = importlib.util.find_spec(word)
    places = [*(found.submodule_search_locations or ()), found.origin or ""] if found else []
    return any(place and Path(place) != but.absolute() for place in places)


def _template(file: str) -> str:
    return (TEMPLATES / f"{file}.txt").read_text(encoding="utf-8")


def _class_name(name: str, code: str) -> str:
    """Return the name of the class: that of the method in capitals, unless the code has that word already."""
    told = "".join(part[:1].upper() + part[1:] for part in re.split("[-_]+", name))
    return f"{told}Method" if told in re.findall(r"\w+", code) or told in vars(percuss)["__all__"] else told


def _filled(name: str, kind: str, *, single_file: bool) -> dict[str, str]:
    """Return the texts to write, by path."""
    code = _template(f"{kind}.py")
    case = _template(f"{kind}.yaml")
    summary = re.search(r'^    summary = "(.*)"$', code, flags=re.MULTILINE)
    study = (TEMPLATES / f"{kind}.study.yaml.txt").exists()  # what no case can name, a study does
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
        "@CONTRACT@": str(percuss.CONTRACT),
        "@FAMILY@": KINDS[kind],
        "@NEXT@": "\n".join(_next(name, kind, None, single_file=False)),
        "@PERCUSS@": percuss.__version__,
        "@SUMMARY@": summary[1] if summary else "",
    }
    return {file: _replaced(text, words) for file, text in texts.items()}


def _replaced(text: str, words: Mapping[str, str]) -> str:
    return re.sub("|".join(map(re.escape, words)), lambda found: words[found[0]], text)


def _next(name: str, kind: str, root: Path | None, *, single_file: bool) -> tuple[str, ...]:
    """Return the commands with which one goes on, from the folder the user is in; from `root` where that is None."""
    study = (TEMPLATES / f"{kind}.study.yaml.txt").exists()
    if single_file:
        start = "" if root is None or root == Path() else f"{root}{os.sep}"
        use = f"percuss study {start}{name}.study.yaml" if study else f"percuss run {start}{name}.yaml"
        return (use, f"percuss verify --plugin {start}{name}.py")
    go = () if root is None else (f"cd {root}",)
    use = "percuss study study.yaml" if study else "percuss run case.yaml"
    return (*go, "pip install -e '.[test]'", use, "pytest")


def _moved(places: Mapping[Path, Path]) -> None:
    """Rename all or none."""
    done: list[Path] = []
    try:
        for source, target in places.items():
            source.rename(target)
            done.append(target)
    except OSError:
        for target in done:
            target.unlink()
        raise


@contextlib.contextmanager
def _beside(out: Path, name: str) -> Iterator[Path]:
    """Give a new folder in `out`; nothing is left of it, whatever happens."""
    folder = out / f".{name}.{os.getpid()}"
    try:
        folder.mkdir()
        yield folder
    except OSError as error:
        raise InputError([Problem(str(out), "", f"cannot be written to: {error.strerror}", "")]) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
