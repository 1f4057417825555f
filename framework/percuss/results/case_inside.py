"""The case inside a result, read again without any file but its single-file plug-ins: a result brings no code."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from percuss.case.case import Case, load
from percuss.case.source import Source
from percuss.errors import InputError, PluginError, Problem, refuse_if_any
from percuss.methods.registry import Registry
from percuss.methods.single_file import SingleFile


def case_inside(provenance: Mapping[str, Any], *, plugins: Sequence[Path] = (), name: str = "the result") -> Case:
    """Return the case inside a result.

    The texts of its data files are taken from the result. Code is not: a single-file plug-in is one of `plugins`, or
    the file at the place where it was, if that is unchanged to the last byte.

    Parameters
    ----------
    provenance
        Provenance of the result.
    plugins
        Single-file plug-ins that stand in for those of the result, by the components that they register.
    name
        Name of the result for messages.

    Raises
    ------
    InputError
        If the result lacks what is needed, a plug-in is missing or has changed, or the case can no longer be read.
    PluginError
        If one of `plugins` cannot be used.
    """
    if "single_files" not in provenance:
        message = "does not hold what its case was run with, as an older percuss has written it"
        raise InputError([Problem(name, "", message, "Make the run again.")])
    registry = Registry.load([*plugins, *_files_at_their_place(provenance, plugins, name)])
    data = {key: value for key, value in provenance["case"].items() if key != "plugins"}
    source = dataclasses.replace(Source.of(data), name=name, data_files=provenance["data_files"])
    return load(source, registry=registry)


def _files_at_their_place(provenance: Mapping[str, Any], plugins: Sequence[Path], name: str) -> list[Path]:
    """Return the single-file plug-ins of a result that stand where they stood, for what `plugins` do not register."""
    registered = Registry.load(plugins).components
    problems: list[Problem] = []
    files: dict[Path, None] = {}
    for key, origin in provenance["plugins"].items():
        family, _, component = key.partition("/")
        if (family, component) in registered:
            continue
        if origin["distribution"]:
            message = f"needs {component} ({family}) of {origin['distribution']} {origin['version']}"
            problems.append(Problem(name, "", f"{message}, which is not registered here", "Install that plug-in."))
        elif reason := _why_not_the_same(origin["file"], provenance["single_files"].get(origin["file"], {})):
            advice = "A result never brings code that is run: name the file with --plugin, in whatever state it is."
            problems.append(Problem(name, "", f"needs {component} ({family}) of {origin['file']}: {reason}", advice))
        else:
            files[Path(origin["file"])] = None
    refuse_if_any(problems)
    return list(files)


def _why_not_the_same(file: str, kept: Mapping[str, Any]) -> str:
    """Return why the file at a path is not the single-file plug-in of a result; empty if it is."""
    try:
        present = SingleFile.read(Path(file))
    except PluginError:
        return "it is not there, or cannot be used as a plug-in"
    return "" if present.digest == kept.get("digest") else "it has changed since"
