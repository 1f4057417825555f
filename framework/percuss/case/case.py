"""Case: the checked contents of a YAML file or of a mapping, with the place of every value."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from percuss.case import overrides as overriding
from percuss.case.arguments import expect_files, expect_paths, wrong_argument
from percuss.case.cross_checks import CrossChecks, completed
from percuss.case.source import Source
from percuss.case.specs import Address, CaseSection, Spot
from percuss.case.type_words import found
from percuss.case.validation import Checked, Reader
from percuss.case.yaml_text import KeyPath
from percuss.errors import InputError, PluginError, Problem
from percuss.files import is_file
from percuss.jsonable import Data
from percuss.methods.registry import Registry


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Case(CaseSection):
    """A checked case: its sections, whose parts are by name in the order of the file, and its origin.

    Attributes
    ----------
    dimension
        Number of components of every vector in the case: 1, 2 or 3.
    data
        The plain mapping that the case was read from, with overrides applied.
    notes
        Sentences about changes on the way that the user should know of.
    registry
        The components that the case was read with.
    origin
        Text of the case and the places in it.
    files
        Single-file plug-ins given beside the case.
    data_files
        Texts of the data files that the case names, by the path written there.
    checked
        Its checked parts, which a case with overrides has too unless they change or name files.
    """

    dimension: int
    data: Data = field(repr=False)
    notes: tuple[str, ...]
    registry: Registry = field(repr=False)
    origin: Source = field(repr=False)
    files: tuple[Path, ...]
    data_files: Mapping[str, str] = field(repr=False)
    checked: Checked = field(repr=False, compare=False)

    def __repr__(self) -> str:
        time = {name: getattr(self.time, name) for name in ("end", "courant", "step", "steps")}
        lines = {
            "bodies": ", ".join(self.bodies),
            "contacts": ", ".join(f"{name} ({contact.law.name})" for name, contact in self.contacts.items()),
            "loads": ", ".join(self.loads),
            "integrator": self.method.integrator.name,
            "time": ", ".join(f"{name} {value}" for name, value in time.items() if value is not None),
        }
        shown = [f"  {name}: {words}" for name, words in lines.items() if words]
        return "\n".join([f"<percuss.Case {self.title!r}", *shown]) + ">"

    def __dir__(self) -> list[str]:
        """Return the public names."""
        return [name for name in super().__dir__() if not name.startswith("_")]

    def problem(self, path: KeyPath, message: str, advice: str = "", *, any_inside: bool = False) -> Problem:
        """Return the problem at a path such as ``("bodies", "short", "area")``, with its place in the file.

        With `any_inside` it follows from several values inside the path, and an override of one is its place.
        """
        return self.origin.problem(path, message, advice, any_inside=any_inside)

    def first_problem(self, path: KeyPath, found: Iterable[tuple[bool, str, str]]) -> Iterator[Problem]:
        """Yield the problem of the first row that holds: whether it does, what was expected, and what to do."""
        for wrong, words, advice in found:
            if wrong:
                yield self.problem(path, f"expected {words}", advice)
                break

    @property
    def inputs(self) -> list[tuple[str, Path]]:
        """Role and path of each file that the case was read from: its own, its plug-ins, its data."""
        own = [("case", Path(self.origin.name))] if self.origin.text else []
        plugins = [("plug-in", file.path) for file in self.registry.single_files]
        return [*own, *plugins, *(("data file", self.origin.folder / path) for path in self.data_files)]

    @property
    def of_bars(self) -> bool:
        """Whether all bodies are along lines."""
        return all(body.shape.cell == "line" for body in self.bodies.values())

    @property
    def bonds(self) -> list[str]:
        """Names of the contacts that are bonds by their law."""
        return [name for name, contact in self.contacts.items() if contact.law.bond]

    @property
    def recorded_ends(self) -> list[Address | Spot]:
        """Ends and points whose motion a run records: the ends in contact where the case names none."""
        in_contact = (side for contact in self.contacts.values() for side in contact.sides)
        return list(dict.fromkeys(in_contact) if self.record.probes is None else self.record.probes)

    @property
    def supports(self) -> list[str]:
        """Names of the regions that are held and of the loads that prescribe a velocity of bodies."""
        held = (f"{name}.{region}" for name, body in self.bodies.items() for region, _ in body.supports)
        driven = (name for name, load in self.loads.items() if load.acts_as == "velocity" and load.on)
        return list(dict.fromkeys([*held, *driven]))

    def files_among(self, values: Iterable[Any]) -> list[tuple[str, Path]]:
        """Return role and path of each file that the case would read if its options had these values."""
        paths = (self.origin.folder / value for value in values if isinstance(value, str))
        return [("data file", path) for path in paths if is_file(path)]

    def with_overrides(self, overrides: Data) -> Case:
        """Return the case with values replaced as by ``--set``, checked like any other case.

        Parameters
        ----------
        overrides
            Value for each dotted path; text is read as YAML.

        Raises
        ------
        InputError
            If a path does not exist or the result is not a case.
        """
        registry = None if any(path.split(".")[0] == "plugins" for path in overrides) else self.registry
        checked = self.checked if registry and not self.data_files else None
        return _load(self.origin, overrides, registry, self.files, self.notes, checked)

    def with_one_law(self) -> Case:
        """Return the case with the contact law of the section `method` for every contact."""
        source = self.origin
        for name, contact in self.contacts.items():
            if contact.own_law:
                entry = dict(source.get(("contacts", name)))
                del entry["method"]
                source = source.replaced(("contacts", name), entry)
        return _read(source, self.registry, self.files, self.notes)


def load(
    source: str | Path | Data | Source,
    overrides: Data | None = None,
    *,
    registry: Registry | None = None,
    plugins: Sequence[str | Path] = (),
) -> Case:
    """Return a checked case.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a mapping; paths in a mapping are relative to the current folder.
    overrides
        Value for each dotted path, as ``{"method.contact.beta_s": 1}``; text is read as YAML.
    registry
        Components to read the case with; by default those installed and the case's own ``plugins``.
    plugins
        Single-file plug-ins beside those that the case names.

    Raises
    ------
    InputError
        With all mistakes of the case, in the order of the file.
    PluginError
        If one of `plugins` cannot be used.
    """
    expect_paths("percuss.load", "overrides", overrides)
    expect_files("percuss.load", plugins)
    if isinstance(source, Source):
        origin = source
    else:
        origin = Source.of(source) if isinstance(source, Mapping) else Source.read(source)
    return _load(origin, overrides or {}, registry, tuple(Path(file) for file in plugins), ())


def _load(
    source: Source,
    overrides: Data,
    registry: Registry | None,
    plugins: tuple[Path, ...],
    notes: tuple[str, ...],
    checked: Checked | None = None,
) -> Case:
    if not isinstance(source.data, Mapping):
        overrides = {}  # nothing can be set in it, as its reader reports
    source, overrides = overriding.with_plugins(source, overrides)
    if registry is None:
        registry = registry_of(source, plugins)
    source, override_notes = overriding.apply(source, overrides, registry)
    return _read(source, registry, plugins, (*notes, *override_notes), checked)


def registry_of(source: Source, plugins: tuple[Path, ...]) -> Registry:
    """Return the components of the installed plug-ins, of `plugins` and of the files that the case names."""
    names, files = source.get(("plugins",), ()), list(plugins)
    registry = Registry.load(files)
    for i, name in enumerate(names if isinstance(names, tuple) else ()):
        if isinstance(name, str):
            files.append(source.folder / name)
            try:
                registry = Registry.load(files)
            except PluginError as error:
                raise InputError([source.problem(("plugins", i), str(error))]) from error
    return registry


def _read(
    source: Source,
    registry: Registry,
    plugins: tuple[Path, ...],
    notes: tuple[str, ...],
    checked: Checked | None = None,
) -> Case:
    reader = Reader(source, registry, checked)
    _check_version(reader)
    section = reader.read(CaseSection)
    checks = CrossChecks(reader)
    reader.finish()
    if section is None:
        raise AssertionError("a part of a case is wrong and nothing says why")
    return Case(
        **vars(completed(section, checks.dimension, source, registry)),
        dimension=checks.dimension,
        data=source.data,
        notes=notes,
        registry=registry,
        origin=source,
        files=plugins,
        data_files=dict(reader.context.texts_read),
        checked=reader.context.checked,
    )


def _check_version(reader: Reader) -> None:
    """Raise InputError unless the source is a case of the format that this percuss reads."""
    data = reader.source.data
    if data is None:
        reader.wrong((), "is empty", "Begin with `percuss: 1`.")
    elif not isinstance(data, Mapping):
        reader.wrong((), f"expected a case, found {found(data)}", "Begin with `percuss: 1`.")
    elif "percuss-study" in data and "percuss" not in data:
        reader.wrong(("percuss-study",), "is a study, not a case", "Run it with `percuss study`.", key=True)
    elif "percuss" not in data:
        reader.wrong(("percuss",), "missing (version of the format)", "Begin with `percuss: 1`.", key=True)
    elif data["percuss"] != 1 or isinstance(data["percuss"], bool | float):
        message = f"expected version 1 of the format, found {found(data['percuss'])}"
        reader.wrong(("percuss",), message, "This percuss reads version 1 only.")
    reader.finish()


def expect_case(function: str, value: Any, *, many: bool = False, **paths: Any) -> None:
    """Raise InputError unless `value` is a case, and each argument in `paths` passes `expect_paths`."""
    if not isinstance(value, Case):
        example = repr(value) if isinstance(value, str) else "'case.yaml'"
        raise wrong_argument(function, "expected a case", value, f"Load it first: percuss.load({example}).")
    for parameter, argument in paths.items():
        expect_paths(function, parameter, argument, many=many)
