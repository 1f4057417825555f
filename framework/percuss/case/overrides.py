"""Overrides: values of a case replaced by ``--set path=value`` or by the second argument of `percuss.run`."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Set
from dataclasses import replace
from typing import Any

from percuss.case.options import options_of
from percuss.case.source import Source, override_label
from percuss.case.specs import CaseSection
from percuss.case.type_words import branches, fact, item_type
from percuss.case.validation import Named, Section
from percuss.case.yaml_text import KeyPath, dotted, flow
from percuss.errors import InputError, Problem, refuse_if_any, suggestion, wrong_input
from percuss.jsonable import Data
from percuss.methods.registry import Registry


def apply(source: Source, overrides: Data, registry: Registry) -> tuple[Source, list[str]]:
    """Return the source with values replaced, and notes on the options of components that were exchanged.

    An option that the new component has too is kept if both components state the same unit for it, else dropped; either
    way a note says so. Components are exchanged before anything else, so that the order of the overrides does not
    matter.

    Raises
    ------
    InputError
        With all overrides that cannot be applied.
    """
    problems: list[Problem] = []
    notes: list[str] = []
    replaced = set(overrides)

    def keeps_components(path: str) -> bool:
        parts = tuple(path.split("."))
        return _component_at(parts) is None and not (parts[-1] == "name" and _component_at(parts[:-1]) is not None)

    for path in sorted(overrides, key=keeps_components):
        try:
            source, new_notes = _apply_override(source, path, overrides[path], registry, replaced)
        except InputError as error:
            problems += error.problems
        else:
            notes += new_notes
    refuse_if_any(problems)
    return source, notes


def with_plugins(source: Source, overrides: Data) -> tuple[Source, Data]:
    """Return the source with the single-file plug-ins that overrides name, which bring components; and the others."""
    others = dict(overrides)
    for path in [path for path in overrides if path.split(".")[0] == "plugins"]:
        source = source.override(path, others.pop(path))
    return source, others


def as_given_by(given: Mapping[str, str], error: InputError) -> InputError:
    """Return an error in which mistakes in overrides have the place from which these came.

    Parameters
    ----------
    given
        Beginning of the place of each value, by the path that it is set at, as ``--vary refine=``.
    error
        The error, which names ``--set``.
    """

    def placed(problem: Problem) -> Problem:
        path = next((path for path in given if problem.place.startswith(f"--set {path}=")), None)
        value = problem.place.removeprefix(f"--set {path}=")
        return problem if path is None else replace(problem, place=f"{given[path]}{value}")

    return InputError(map(placed, error.problems))


@functools.lru_cache(maxsize=1024)  # a study asks for the same few paths in each of its runs
def _component_at(path: KeyPath) -> Named | None:
    """Return the mark of the component at `path`, or None where no component stands."""
    annotation: Any = CaseSection
    for part in path:
        section: Any = next(branches(annotation))
        if Section in getattr(section, "__mro__", ()):
            option = options_of(section).get(str(part))
            annotation = option.annotation if option is not None else None
        else:
            annotation = item_type(annotation)
    return fact(annotation, Named)


def _apply_override(
    source: Source, path: str, value: object, registry: Registry, replaced: Set[str]
) -> tuple[Source, list[str]]:
    """Return the source with one value replaced, and notes on the options of a component that was exchanged."""
    parts: KeyPath = tuple(path.split("."))
    if not all(parts):
        raise wrong_input(override_label(path, value), "expected a path, as time.end")
    _refuse_missing_entry(source, path, value)
    at = next((parts[:n] for n in range(1, len(parts) + 1) if _component_at(parts[:n]) is not None), None)
    if at is None:
        return _with_load_as_mapping(source, parts, registry).override(path, value), []
    old = source.get(at)
    if isinstance(old, str) and len(parts) > len(at):
        source = source.replaced(at, {"name": old})
    changed = source.override(path, value)
    new = changed.get(at)
    if parts == at and isinstance(new, str) and isinstance(old, Mapping):
        # Replacing only the name leaves the remaining options at their places in the file.
        changed = source.override(f"{path}.name", value, shown_path=path)
    elif parts != (*at, "name"):
        return changed, []
    return _without_foreign_options(source, changed, at, registry, replaced)


def _without_foreign_options(
    before: Source, after: Source, at: KeyPath, registry: Registry, replaced: Set[str]
) -> tuple[Source, list[str]]:
    """Return the source without the options that mean nothing to the new component, and notes on all its options.

    An option that is kept gets no note where another override, one of the dotted paths `replaced`, sets it anyway.
    `before` and `after` are the source before and after the component at the path `at` was exchanged.
    """
    entry = _component_at(at)
    options = after.get(at)
    if entry is None or not isinstance(options, Mapping):
        return after, []
    name, old = options.get("name"), before.get((*at, "name"), entry.default)
    if name == old or name not in registry.names(entry.family):
        return after, []
    new_options = options_of(registry.get(entry.family, name))
    old_options = options_of(registry.get(entry.family, old)) if old in registry.names(entry.family) else {}
    missing = [key for key in options if key != "name" and key not in new_options]
    notes = [f"{name} has no option {', '.join(missing)}: dropped"] if missing else []
    dropped, kept = set(missing), []
    for key in [key for key in options if key != "name" and key not in dropped]:
        old_option, new_option = old_options.get(key), new_options[key]
        if old_option is not None and (old_option.unit or "1") != (new_option.unit or "1"):
            units = f"{new_option.unit or 1}, that of {old} the unit {old_option.unit or 1}"
            notes.append(f"{key} of {name} has the unit {units}: dropped")
            dropped.add(key)
        elif f"{dotted(at)}.{key}" not in replaced:
            differs = old_option is not None and old_option.doc != new_option.doc
            meaning = f", there '{old_option.doc}', here '{new_option.doc}'" if old_option and differs else ""
            kept.append(f"{name} keeps {key}: {flow(options[key])} of {old}{meaning}")
    remaining = {key: value for key, value in options.items() if key not in dropped}
    return after.replaced(at, remaining), [f"{dotted(at)}: {note}" for note in (*notes, *kept)]


def _refuse_missing_entry(source: Source, path: str, value: object) -> None:
    """Refuse to set a value inside a body, contact or load that does not exist; an override may add a whole one."""
    parts = path.split(".")
    entries = source.get((parts[0],), {})
    kind = {"bodies": "body", "contacts": "contact", "loads": "load"}.get(parts[0])
    if kind is None or len(parts) < 3 or not isinstance(entries, Mapping) or parts[1] in entries:
        return
    label = override_label(path, value)
    advice = suggestion(parts[1], entries, "name")
    raise wrong_input(label, f"there is no {kind} '{parts[1]}'", advice, path=f"{parts[0]}.{parts[1]}")


def _with_load_as_mapping(source: Source, parts: KeyPath, registry: Registry) -> Source:
    """Return the source with a load's bare value written as a mapping, if the override sets an option inside it."""
    if len(parts) < 4 or parts[0] != "loads" or parts[2] not in registry.names("loads"):
        return source
    shorthand = registry.get("loads", str(parts[2])).shorthand
    value = source.get(parts[:3])
    if not shorthand or value is None or isinstance(value, Mapping):
        return source
    return source.replaced(parts[:3], {shorthand: value})
