"""A study file: which cases, which methods, what is varied and what is measured, checked and with its places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any

from percuss.case.case import Case, load
from percuss.case.reader import SINGULAR, Reader
from percuss.case.source import Source
from percuss.case.specs import Address
from percuss.case.type_words import found
from percuss.case.yaml_text import KeyPath, flow
from percuss.errors import InputError, Problem, suggestion
from percuss.methods.registry import Registry
from percuss.studies import parameters
from percuss.studies.columns import METRICS, Column, column, named
from percuss.studies.layout import (
    Condition,
    KeepSection,
    MeasureSection,
    MethodsSection,
    RangeSection,
    SampleSection,
    StudySection,
)
from percuss.studies.parameters import Sample

__all__ = ["StudySpec", "read_study"]

RESERVED = {"case", "integrator", "contact", "status", "reason", "said_by", "fragile", "seconds", "key", *METRICS}
COST = "node_steps"
WHO = ("case", "integrator", "contact")  # columns of every row, beside the varied paths


@dataclass(frozen=True)
class StudySpec:
    """A study, checked.

    Attributes
    ----------
    name
        What its output is called by default.
    cases
        By label, with `set` applied.
    integrators, contacts
        Label and what is written at ``method.integrator`` and ``method.contact``; a name keeps the case's options.
    vary
        Values of each path.
    paired
        Points whose values go together.
    sample
        Points to be drawn, or None.
    columns
        What is measured.
    where
        Conditions that every run meets.
    tied, nudge, histories, repeats
        As in the file.
    data
        The plain mapping behind it.
    """

    name: str
    cases: dict[str, Case]
    integrators: dict[str, Any]
    contacts: dict[str, Any]
    vary: dict[str, list[Any]]
    paired: list[dict[str, Any]]
    sample: Sample | None
    columns: tuple[Column, ...]
    where: tuple[Condition, ...]
    tied: bool
    nudge: bool
    histories: int
    repeats: int | None
    data: Mapping[str, Any]
    source: Source


def read_study(given: str | Path | Mapping[str, Any], plugins: list[Path] | None = None) -> StudySpec:
    """Return a checked study.

    Parameters
    ----------
    given
        Path of a YAML file, or the same as a mapping; paths in a mapping are relative to the current folder.
    plugins
        Single-file plug-ins beside those that the cases name.

    Raises
    ------
    InputError
        With every mistake found.
    """
    source = Source.of(given) if isinstance(given, Mapping) else Source.read(given)
    if isinstance(given, Mapping):
        source = Source("study", "", source.data, source.marks)
    name = "study" if isinstance(given, Mapping) else Path(given).stem
    return _StudyReader(source, plugins or []).study(name)


class _StudyReader:
    """Reads one study, by the means with which cases are read."""

    def __init__(self, source: Source, plugins: list[Path]) -> None:
        self.reader = Reader(source, Registry.load(plugins))
        self.source, self.plugins = source, plugins

    def study(self, name: str) -> StudySpec:
        reader, data = self.reader, self.source.data
        if not isinstance(data, Mapping):
            reader.wrong((), f"expected a study, found {found(data)}", "Begin with `percuss-study: 1`.")
            reader.finish()
        if data.get("percuss-study") != 1 or isinstance(data.get("percuss-study"), bool | float):
            message = f"expected version 1 of the format, found {found(data.get('percuss-study'))}"
            near = (
                "This is a case: run it with `percuss run`." if "percuss" in data else "Begin with `percuss-study: 1`."
            )
            reader.wrong(("percuss-study",), message, near)
            reader.finish()
        body = {("percuss_study" if key == "percuss-study" else key): value for key, value in data.items()}
        top = reader.section(StudySection, (), body, "the study")
        names = data.get("cases")
        if not isinstance(names, tuple) or not all(isinstance(one, str) for one in names):
            reader.finish()  # without cases nothing else can be judged
            raise AssertionError("the cases are wrong and nothing says why")
        cases = self.cases(names)
        methods = self.part(MethodsSection, "methods", "the methods")
        keep = self.part(KeepSection, "keep", "keep")
        registries = [case.registry for case in cases.values()] or [self.reader.registry]
        integrators = self.methods("integrators", methods.integrators if methods else (), registries)
        contacts = self.methods("contacts", methods.contacts if methods else (), registries)
        if contacts:
            cases = {label: case.with_one_law() for label, case in cases.items()}
        varied, paired, sample = self.varied(), self.paired(), self.sample()
        self.once(varied, paired, sample)
        paths = [*varied, *(path for point in paired for path in point), *(sample.axes if sample else ())]
        columns, where = self.columns(cases), self.where([*WHO, *dict.fromkeys(paths)])
        reader.finish()
        if top is None:
            raise AssertionError("a study is wrong and nothing says why")
        return StudySpec(
            name=name,
            cases=cases,
            integrators=integrators,
            contacts=contacts,
            vary=varied,
            paired=paired,
            sample=sample,
            columns=columns,
            where=where,
            tied=top.tied,
            nudge=top.nudge,
            histories=keep.histories if keep else 0,
            repeats=top.repeats,
            data=data,
            source=self.source,
        )

    # -------------------------------------------------------------------------------------------- parts

    def part(self, cls: type[Any], key: str, kind: str) -> Any:
        """Return a section that may be absent; None where it is wrong."""
        value = self.source.get((key,), {})
        given = self.reader.mapping((key,), value, "a mapping")
        return self.reader.section(cls, (key,), given, kind) if given is not None else None

    def cases(self, names: tuple[str, ...]) -> dict[str, Case]:
        """Return the cases by label: the file's name without its ending, or its path where two are alike."""
        stems = [Path(one).stem for one in names]
        if not names:
            self.reader.wrong(("cases",), "expected at least one case, found none", "Name a file.")
        cases: dict[str, Case] = {}
        for i, one in enumerate(names):
            label = stems[i] if stems.count(stems[i]) == 1 else one
            if label in cases:
                self.reader.wrong(("cases", i), f"the case '{one}' is named twice", "Keep one.")
                continue
            try:
                case = load(self.source.folder / one, plugins=self.plugins)
            except InputError as error:
                first = error.problems[0]
                if first.message == "no such file":
                    self.reader.wrong(("cases", i), f"no such file: {self.source.folder / one}", first.advice)
                else:
                    self.reader.problems += [((0, i + 1, 0), problem) for problem in error.problems]
                continue
            changed = self.with_set(case)
            if changed is not None:
                cases[label] = changed
        return cases

    def with_set(self, case: Case) -> Case | None:
        """Return the case with the values of `set`, and without what it expects: that is of other runs."""
        values = self.source.get(("set",), {})
        given = self.reader.mapping(("set",), values if values != () else {}, "a mapping of paths to values")
        if given is None:
            return None
        try:
            return case.with_overrides({**given, "expect": ()})
        except InputError as error:
            for problem in error.problems:
                self.wrong_at([("set", path) for path in given], problem)
            return None

    def wrong_at(self, paths: list[KeyPath], problem: Problem) -> None:
        """Keep a mistake of a value that the study sets, at its place in the study."""
        mine = [one for one in paths if problem.place.startswith(f"--set {one[-1]}=")]
        if not mine:
            self.reader.problems.append(((1, 0, 0), problem))
            return
        said = f"{problem.path}: {problem.message}" if problem.path not in ("", mine[0][-1]) else problem.message
        self.reader.wrong(mine[0], said, problem.advice, key=problem.message.startswith("unknown key"))

    def methods(self, family: str, given: Any, registries: list[Registry]) -> dict[str, Any]:
        """Return label and value of each method named; some case must know it."""
        path: KeyPath = ("methods", family)
        kind, known = SINGULAR[family], sorted({name for one in registries for name in one.names(family)})
        if not isinstance(given, tuple):
            self.reader.wrong(path, f"expected a list of names, found {found(given)}", f"Write as [{known[0]}].")
            return {}
        out: dict[str, Any] = {}
        names: list[Any] = [one.get("name") if isinstance(one, Mapping) else one for one in given]
        for i, one in enumerate(given):
            at = (*path, i, "name") if isinstance(one, Mapping) else (*path, i)
            if not isinstance(names[i], str):
                message = f"expected the name of a {kind}, found {found(one)}"
                self.reader.wrong((*path, i), message, suggestion("", known))
            elif names[i] not in known:
                self.reader.wrong(at, f"unknown {kind} '{names[i]}'", suggestion(names[i], known))
            else:
                label = names[i] if names.count(names[i]) == 1 else flow(one)
                if label in out:
                    self.reader.wrong((*path, i), f"{label} is named twice", "Keep one.")
                out[label] = one
        return out

    def varied(self) -> dict[str, list[Any]]:
        """Return the values of each varied path."""
        value = self.source.get(("vary",), {})
        given = self.reader.mapping(("vary",), value if value != () else {}, "a mapping of paths to values")
        out = {}
        for path, values in (given or {}).items():
            out[path] = self.values(("vary", path), values)
        return out

    def values(self, at: KeyPath, given: Any) -> list[Any]:
        """Return the values of a list, of a text of the grammar, or the one value given."""
        if isinstance(given, str):
            try:
                return parameters.values(given)
            except InputError as error:
                self.reader.wrong(at, error.problems[0].message, error.problems[0].advice)
                return []
        out = list(given) if isinstance(given, tuple) else [given]
        if not out or given is None or isinstance(given, Mapping):
            advice = f"Or {parameters.GRAMMAR}."
            self.reader.wrong(at, f"expected a list of values, found {found(given)}", advice)
        return out

    def paired(self) -> list[dict[str, Any]]:
        """Return the points whose values go together."""
        given = self.source.get(("paired",), ())
        if not isinstance(given, tuple):
            self.reader.wrong(("paired",), f"expected a list of mappings, found {found(given)}", "Begin with a dash.")
            return []
        out: list[dict[str, Any]] = []
        for i, one in enumerate(given):
            point = self.reader.mapping(("paired", i), one, "a mapping of paths to values")
            if point is not None and out and set(point) != set(out[0]):
                message = f"has {', '.join(point)}, and the first has {', '.join(out[0])}"
                self.reader.wrong(("paired", i), message, "Give every point the same paths.")
            elif point is not None:
                out.append(dict(point))
        return out

    def sample(self) -> Sample | None:
        """Return the points to be drawn."""
        if self.source.get(("sample",), MISSING) is MISSING:
            return None
        section = self.part(SampleSection, "sample", "the sample")
        if section is None:
            return None
        given = self.reader.mapping(("sample", "of"), section.of, "a mapping of paths to ranges")
        axes = {}
        for path, one in (given or {}).items():
            at = ("sample", "of", path)
            inside = self.reader.mapping(at, one, "a range as {from: 0, to: 1}")
            drawn = self.reader.section(RangeSection, at, inside, "the range") if inside is not None else None
            if drawn is not None:
                axes[path] = (drawn.from_, drawn.to, drawn.scale == "log")
        if given is not None and not given:
            self.reader.wrong(("sample", "of"), "expected at least one path, found none", "Add PATH: {from: 0, to: 1}.")
        return Sample(section.count, section.method, section.seed, axes)

    def where(self, known: list[str]) -> tuple[Condition, ...]:
        """Return the conditions."""
        given = self.source.get(("where",), ())
        if not isinstance(given, tuple):
            self.reader.wrong(("where",), f"expected a list of conditions, found {found(given)}", "Begin with a dash.")
            return ()
        out = []
        for i, one in enumerate(given):
            inside = self.reader.mapping(("where", i), one, "a condition as {path: refine, op: <, value: 4}")
            made = self.reader.section(Condition, ("where", i), inside, "the condition") if inside is not None else None
            if made is not None and made.path not in known:
                self.reader.wrong(("where", i, "path"), f"'{made.path}' is not varied", suggestion(made.path, known))
            elif made is not None:
                out.append(made)
        return tuple(out)

    def once(self, varied: Mapping[str, Any], paired: Sequence[Mapping[str, Any]], sample: Sample | None) -> None:
        """Tell of a path that is given in two ways: one would silently take the place of the other."""
        together = list(dict.fromkeys(path for point in paired for path in point))
        drawn = list(sample.axes) if sample else []
        for at, mine, others in (("paired", together, [*varied]), ("sample", drawn, [*varied, *together])):
            for path in mine:
                if path in others:
                    self.reader.wrong((at,), f"{path} is varied in another way too", "Give each path once.")

    def columns(self, cases: dict[str, Case]) -> tuple[Column, ...]:
        """Return what is measured."""
        given = self.source.get(("measure",), ())
        if not isinstance(given, tuple):
            message = f"expected a list of measures, found {found(given)}"
            self.reader.wrong(("measure",), message, f"Measures with a name: {', '.join(METRICS)}.")
            return ()
        out: dict[str, Column] = {}
        for i, one in enumerate(given):
            made = self.column(("measure", i), one, cases)
            if made is not None and not isinstance(one, str) and made.name in RESERVED:
                self.reader.wrong(("measure", i), f"the name '{made.name}' is that of another column", "Rename it.")
            elif made is not None and made.name in out:
                self.reader.wrong(("measure", i), f"the name '{made.name}' is taken by another measure", "Rename it.")
            elif made is not None:
                out[made.name] = made
        if not out:
            return tuple(named(name) for name in METRICS)
        # the one cost that does not depend on the machine belongs to every row
        return tuple({**out, COST: named(COST)}.values())

    def column(self, at: KeyPath, one: Any, cases: dict[str, Case]) -> Column | None:
        """Return one column, or None where it is wrong."""
        try:
            if isinstance(one, str):
                return named(one, [case.registry for case in cases.values()])
            inside = self.reader.mapping(
                at, one, "a name, or a measure as {name: plateau, quantity: contact_force, ...}"
            )
            made = self.reader.section(MeasureSection, at, inside, "the measure") if inside is not None else None
            if made is None:
                return None
            contacts = list(dict.fromkeys(name for case in cases.values() for name in case.contacts))
            bodies = [str(Address(name)) for case in cases.values() for name in case.bodies]
            return column(made, contacts, bodies)
        except ValueError as error:  # said by the column, which knows no places
            message, advice, *key = error.args
            self.reader.wrong((*at, *key), message, advice)
            return None
