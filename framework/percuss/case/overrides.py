"""Values of a case replaced by ``--set path=value``, or by the second argument of `percuss.run`."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

from percuss.case.layout import CaseSection, Each, Named, Part
from percuss.case.options import options_of
from percuss.case.source import Source
from percuss.case.type_words import fact
from percuss.case.yaml_text import KeyPath, dotted, flow
from percuss.errors import InputError, Problem, suggestion
from percuss.methods.registry import Registry

__all__ = ["apply"]


def apply(source: Source, overrides: Mapping[str, Any], registry: Registry) -> tuple[Source, list[str]]:
    """Return the source with values replaced, and notes of what became of the options of components that were swapped.

    An option that the new component has too is kept if both state the same unit for it, else dropped; either way a note
    says so. Components are swapped before anything else, so that the order of the overrides does not matter.

    Raises
    ------
    InputError
        With every override that cannot be applied.
    """
    problems: list[Problem] = []
    notes: list[str] = []
    replaced = set(overrides)

    def late(path: str) -> bool:
        parts = tuple(path.split("."))
        return _named(parts) is None and not (parts[-1] == "name" and _named(parts[:-1]) is not None)

    for path in sorted(overrides, key=late):
        try:
            source, told = _one(source, path, overrides[path], registry, replaced)
        except InputError as error:
            problems += error.problems
        else:
            notes += told
    if problems:
        raise InputError(problems)
    return source, notes


def _named(path: KeyPath) -> Named | None:
    """Return what is said of the component at `path`, or None where there is no component."""
    section: type | None = CaseSection
    entry: Named | None = None
    parts = list(path)
    while parts:
        option = options_of(section).get(str(parts.pop(0))) if section is not None else None
        if option is None:
            return None
        entry = fact(option.annotation, Named)
        part, each = fact(option.annotation, Part), fact(option.annotation, Each)
        section = part.section if part is not None else each.section if each is not None else None
        if each is not None and parts:
            parts.pop(0)  # the name of the body, contact or load
    return entry


def _one(source: Source, path: str, value: Any, registry: Registry, replaced: Set[str]) -> tuple[Source, list[str]]:
    parts: KeyPath = tuple(path.split("."))
    if not all(parts):
        label = f"--set {path}={value if isinstance(value, str) else flow(value)}"
        raise InputError([Problem(label, "", "expected a path, as time.end")])
    _entry_exists(source, path, value)
    at = next((parts[:n] for n in range(1, len(parts) + 1) if _named(parts[:n]) is not None), None)
    if at is None:
        return _load(source, parts, registry).override(path, value), []
    old = source.get(at)
    if isinstance(old, str) and len(parts) > len(at):
        source = source.replaced(at, {"name": old})
    changed = source.override(path, value)
    new = changed.get(at)
    if parts == at and isinstance(new, str) and isinstance(old, Mapping):
        # by way of its name, so that the options kept are still placed where they stand
        changed = source.override(f"{path}.name", value, said=path)
    elif parts != (*at, "name"):
        return changed, []
    return _swapped(source, changed, at, registry, replaced)


def _swapped(
    before: Source, after: Source, at: KeyPath, registry: Registry, replaced: Set[str]
) -> tuple[Source, list[str]]:
    """Return the source without the options that mean nothing to the new component, and notes of all that it had.

    Options that another override sets anyway are not spoken of.
    """
    named = _named(at)
    options = after.get(at)
    if named is None or not isinstance(options, Mapping):
        return after, []
    name, old = options.get("name"), before.get((*at, "name"), named.default)
    if name == old or name not in registry.names(named.family):
        return after, []
    allowed = options_of(registry.get(named.family, name))
    known = options_of(registry.get(named.family, old)) if old in registry.names(named.family) else {}
    missing, dropped, kept = [], [], []
    for key in [str(key) for key in options if key != "name"]:
        mine, theirs = allowed.get(key), known.get(key)
        if mine is None:
            missing.append(key)
        elif theirs is not None and (theirs.unit or "1") != (mine.unit or "1"):
            was, now = theirs.unit or "1", mine.unit or "1"
            dropped.append((key, f"{key} of {name} has the unit {now}, that of {old} the unit {was}: dropped"))
        elif f"{dotted(at)}.{key}" not in replaced:
            meant = (
                f", there '{theirs.doc}', here '{mine.doc}'" if theirs is not None and theirs.doc != mine.doc else ""
            )
            kept.append(f"{name} keeps {key}: {flow(options[key])} of {old}{meant}")
    words = [f"{name} has no option {', '.join(missing)}: dropped"] if missing else []
    notes = [f"{dotted(at)}: {word}" for word in (*words, *(word for _, word in dropped), *kept)]
    gone = {*missing, *(key for key, _ in dropped)}
    left = {key: value for key, value in options.items() if key not in gone}
    return after.replaced(at, left) if gone else after, notes


def _entry_exists(source: Source, path: str, value: Any) -> None:
    """Refuse to set something inside a body, contact or load that is not there; a whole one may be new."""
    parts = path.split(".")
    option = options_of(CaseSection).get(parts[0])
    each = fact(option.annotation, Each) if option is not None else None
    known = source.get((parts[0],), {})
    if each is None or len(parts) < 3 or not isinstance(known, Mapping) or parts[1] in known:
        return
    label = f"--set {path}={value if isinstance(value, str) else flow(value)}"
    advice = suggestion(parts[1], known, "name")
    raise InputError([Problem(label, f"{parts[0]}.{parts[1]}", f"there is no {each.what} '{parts[1]}'", advice)])


def _load(source: Source, parts: KeyPath, registry: Registry) -> Source:
    """Return the source with a load's bare value written as a mapping, if an override goes inside it."""
    if len(parts) < 4 or parts[0] != "loads" or parts[2] not in registry.names("loads"):
        return source
    shorthand = registry.get("loads", str(parts[2])).shorthand
    value = source.get(parts[:3])
    if not shorthand or value is None or isinstance(value, Mapping):
        return source
    return source.replaced(parts[:3], {shorthand: value})
