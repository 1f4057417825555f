"""Specification of a study, read from its file and checked: cases, methods, varied values and measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from percuss.case.case import Case, load
from percuss.case.cross_checks import misfits
from percuss.case.hints import name_advice
from percuss.case.quantities import JUDGED_BY, METRICS, TRUE_ERRORS, by_two, ranking
from percuss.case.source import Source
from percuss.case.specs import MeasureSection
from percuss.case.type_words import found
from percuss.case.validation import Mistake, Reader
from percuss.case.yaml_text import KeyPath, flow
from percuss.errors import InputError, Problem, refuse_if_any, suggestion
from percuss.jsonable import Data, Entries, as_lists
from percuss.methods.blame import SINGULAR
from percuss.methods.registry import Registry
from percuss.studies.columns import Column, RowSettings, column, column_by_name
from percuss.studies.layout import GRAMMAR, StudySection, combinations, values_in
from percuss.studies.tasks import FAMILIES, NAMES, Task, method_name, two_references

RESERVED = {"case", "integrator", "contact", "status", "reason", "said_by", "fragile", "seconds", "key", *METRICS}
COST = "node_steps"
Places = Mapping[str, KeyPath]  # where the study writes out a value, by the path that it is set at


@dataclass(frozen=True)
class StudySpec:
    """A checked study.

    Attributes
    ----------
    cases
        Cases by label, with `set` applied.
    integrators, contacts
        Value for ``method.integrator`` or ``method.contact`` by label; a name alone keeps the options of the case.
    vary
        Values of each path.
    points
        The points of the study, as values of varied paths.
    rows
        Measured columns, and the other settings on which rows depend.
    section, source
        The file as it was read, and its text.
    """

    cases: dict[str, Case]
    integrators: Entries
    contacts: Entries
    vary: dict[str, list[object]]
    points: list[Entries]
    rows: RowSettings
    section: StudySection
    source: Source

    @property
    def data(self) -> Entries:
        """The study as plain data."""
        return as_lists(self.source.data)  # type: ignore[no-any-return]

    @property
    def inputs(self) -> list[tuple[str, Path]]:
        """Role and path of each file that the study reads: its own, those of its cases, and those among its values."""
        own = [("study", Path(self.source.name))] if self.source.text else []
        values = [value for axis in self.vary.values() for value in axis]
        values += [value for point in self.section.paired for value in point.values()]
        of_cases = (file for case in self.cases.values() for file in (*case.inputs, *case.files_among(values)))
        return [*own, *of_cases]


def read_study(given: str | Path | Data, plugins: list[Path] | None = None, changes: Data | None = None) -> StudySpec:
    """Return a checked study.

    Parameters
    ----------
    given
        Path of a YAML file, or its contents as a mapping; paths in a mapping are relative to the current folder.
    plugins
        Single-file plug-ins beside those that the cases name.
    changes
        Values that are set in every case, besides those of the study, by dotted path.

    Raises
    ------
    InputError
        With all mistakes in the study.
    """
    source = replace(Source.of(given), name="study") if isinstance(given, Mapping) else Source.read(given)
    if changes and isinstance(source.data, Mapping) and isinstance(source.get(("set",), {}), Mapping):
        source = source.replaced(("set",), {**source.get(("set",), {}), **changes})
    return _StudyReader(source, plugins or []).study()


def settings_of(data: Data, cases: Mapping[str, Case]) -> RowSettings:
    """Return the settings of the rows of a study that was read before, from its plain data.

    Parameters
    ----------
    data
        The study as plain data.
    cases
        Its cases by label, or some of them.
    """
    return _StudyReader(Source.of(data), []).settings(cases)


def mistake_in_study(problem: Problem, places: Places) -> Mistake | None:
    """Return the problem of a value that a study sets as the mistake at its place there.

    Parameters
    ----------
    problem
        The problem, which names the override that set the value.
    places
        Place of each value in the study, by the path that it is set at; with those of others the answer is None.
    """
    path = next((path for path in places if problem.place.startswith(f"--set {path}=")), None)
    if path is None:
        return None
    inside = problem.path.removeprefix(path)
    below: KeyPath = ()
    if not inside or inside.startswith("."):
        below = tuple(int(part) if part.isdecimal() else part for part in inside.split(".")[1:])
    message = problem.message if below or problem.path in {"", path} else f"{problem.path}: {problem.message}"
    at, unknown = (*places[path], *below), problem.message.startswith("unknown key")
    if unknown and path in at and not below:  # it concerns the path, not one of its values
        at = at[: at.index(path) + 1]
    return Mistake(at, message, problem.advice, key=unknown)


class _StudyReader:
    """Reader of a study: of the form of its file first, then of what it says about its cases."""

    def __init__(self, source: Source, plugins: list[Path]) -> None:
        self.reader = Reader(source, Registry.load(plugins))
        self.source, self.plugins = source, plugins
        self.section = self._section()

    def _section(self) -> StudySection:
        reader, data = self.reader, self.source.data
        if not isinstance(data, Mapping):
            reader.wrong((), f"expected a study, found {found(data)}", "Begin with `percuss-study: 1`.")
        elif "percuss" in data and "percuss-study" not in data:
            reader.wrong(("percuss",), "is a case, not a study", "Run it with `percuss run`.", key=True)
        elif data.get("percuss-study") != 1 or isinstance(data.get("percuss-study"), bool | float):
            message = f"expected version 1 of the format, found {found(data.get('percuss-study'))}"
            reader.wrong(("percuss-study",), message, "Begin with `percuss-study: 1`.")
        reader.finish()
        section = reader.read(StudySection)
        reader.finish()
        if section is None:
            raise AssertionError("a study is wrong and nothing says why")
        return section

    def study(self) -> StudySpec:
        """Return the study, with its cases, methods, points and columns."""
        section, cases = self.section, self.cases()
        registries = [case.registry for case in cases.values()] or [self.reader.registry]
        integrators, contacts = self.methods("integrators", registries), self.methods("contacts", registries)
        if contacts:
            cases = {label: case.with_one_law() for label, case in cases.items()}
        varied = {path: self.values(("vary", path), given) for path, given in section.vary.items()}
        self.check_paths()
        points: list[Entries] = []
        try:
            points = combinations(varied, section.paired, section.sample)
        except InputError as error:
            self.wrong_as_in(error, ("vary",), key=True)
        each = [{path: value} for path, values in varied.items() for value in values]
        cases = {label: two_references(case, contacts, [*each, *section.paired]) for label, case in cases.items()}
        rows = self.settings(cases)
        self.reader.finish()
        return StudySpec(cases, integrators, contacts, varied, points, rows, section, self.source)

    def settings(self, cases: Mapping[str, Case]) -> RowSettings:
        """Return the settings on which rows depend."""
        section = self.section
        return RowSettings(self.columns(cases), section.nudge, section.keep.histories, section.repeats)

    def wrong_as_in(self, error: InputError, at: KeyPath, *, key: bool = False) -> None:
        """Keep the mistake of an error at a place in the study."""
        self.reader.wrong(at, error.problems[0].message, error.problems[0].advice, key=key)

    def cases(self) -> dict[str, Case]:
        """Return the cases by label: the file name without its ending, or the path if two names are alike."""
        names = self.section.cases
        stems = [Path(case_file).stem for case_file in names]
        cases: dict[str, Case] = {}
        for i, case_file in enumerate(names):
            label = stems[i] if stems.count(stems[i]) == 1 else case_file
            if label in cases:
                self.reader.wrong(("cases", i), f"the case '{case_file}' is named twice", "Keep one.")
                continue
            try:
                case = load(self.source.folder / case_file, plugins=self.plugins)
            except InputError as error:
                first = error.problems[0]
                if first.message == "no such file":
                    self.reader.wrong(("cases", i), f"no such file: {self.source.folder / case_file}", first.advice)
                else:
                    self.reader.problems += [((0, i + 1, 0), problem) for problem in error.problems]
                continue
            changed = self.with_set(case)
            if changed is not None:
                cases[label] = changed
        return cases

    def with_set(self, case: Case) -> Case | None:
        """Return the case with the values of `set` and without its expectations, which hold for other runs, or None."""
        given = self.section.set
        try:
            return case.with_overrides({**given, "expect": ()})
        except InputError as error:
            for problem in error.problems:
                mistake = mistake_in_study(problem, {path: ("set", path) for path in given})
                if mistake is not None:
                    self.reader.report(mistake)
                else:
                    self.reader.problems.append(((1, 0, 0), problem))
            return None

    def methods(self, family: str, registries: list[Registry]) -> Entries:
        """Return label and value of each named method; at least one case must have it."""
        path, kind = ("methods", family), SINGULAR[family]
        given: tuple[Any, ...] = getattr(self.section.methods, family)
        known_names = sorted({name for registry in registries for name in registry.names(family)})
        out: Entries = {}
        names = [method_name(method) for method in given]
        for i, method in enumerate(given):
            at = (*path, i, "name") if isinstance(method, Mapping) else (*path, i)
            if not names[i]:
                message = f"expected the name of a {kind}, found {found(method)}"
                self.reader.wrong((*path, i), message, suggestion("", known_names))
            elif names[i] not in known_names:
                self.reader.wrong(at, f"unknown {kind} '{names[i]}'", name_advice(names[i], family, *registries))
            else:
                label = names[i] if names.count(names[i]) == 1 else flow(method)
                if label in out:
                    self.reader.wrong((*path, i), f"{label} is named twice", "Keep one.")
                out[label] = method
        return out

    def values(self, at: KeyPath, given: object) -> list[object]:
        """Return the values of a list or of a text in the grammar of `values_in`, or a single value as a list."""
        if isinstance(given, str):
            try:
                return [*values_in(given)]
            except InputError as error:
                self.wrong_as_in(error, at)
                return []
        out = list(given) if isinstance(given, tuple) else [given]
        if not out or given is None or isinstance(given, Mapping):
            advice = f"Or {GRAMMAR}."
            self.reader.wrong(at, f"expected a list of values, found {found(given)}", advice)
        return out

    def check_paths(self) -> None:
        """Report a path that is varied in two ways, as the second would silently replace the first, and the like."""
        section, seen = self.section, [*NAMES, *self.section.vary]
        for i, point in enumerate(section.paired):
            if set(point) != set(section.paired[0]):
                message = f"has {', '.join(point)}, and the first has {', '.join(section.paired[0])}"
                self.reader.wrong(("paired", i), message, "Give every point the same paths.")
        together = dict.fromkeys(path for point in section.paired for path in point)
        for key, paths in (("paired", together), ("sample", section.sample.of if section.sample else {})):
            for path in (path for path in paths if path in seen):
                self.reader.wrong((key,), f"{path} is varied twice", "Give each path once.")
            seen += paths
        for i, condition in enumerate(section.where):
            if condition.path not in seen:
                message = f"'{condition.path}' is not varied"
                self.reader.wrong(("where", i, "path"), message, suggestion(condition.path, seen))

    def columns(self, cases: Mapping[str, Case]) -> tuple[Column, ...]:
        """Return the measured columns."""
        out: dict[str, Column] = {}
        for i, measure in enumerate(self.section.measure):
            made = self.column(("measure", i), measure, cases)
            if made is not None and (made.name in out or (made.name in RESERVED and not isinstance(measure, str))):
                self.reader.wrong(("measure", i), f"the name '{made.name}' is the name of another column", "Rename it.")
            elif made is not None:
                out[made.name] = made
        # Every row has the cost that does not depend on the machine, and the finer runs by which it may be judged.
        names, judges = [*([] if out else METRICS), COST], [case.reference for case in cases.values()]
        names += [JUDGED_BY] if any(judge is not None for judge in judges) else []
        errors = [name for name in ranking([*out, *names]) if name in TRUE_ERRORS][:1]
        two = any(judge is not None and judge.second is not None for judge in judges)
        names += [path for error in errors for path in by_two(error)] if two else []
        return tuple({**out, **{name: column_by_name(name) for name in names}}.values())

    def column(self, at: KeyPath, measure: MeasureSection | str, cases: Mapping[str, Case]) -> Column | None:
        """Return the column of a measure, or None if the measure is wrong."""
        contacts = dict.fromkeys(name for case in cases.values() for name in case.contacts)
        bodies = [name for case in cases.values() for name in case.bodies]
        supports = list(dict.fromkeys(name for case in cases.values() for name in case.supports))
        owners = {"contact": contacts, "support": supports}
        dimension = max((case.dimension for case in cases.values()), default=3)
        try:
            if isinstance(measure, str):
                made = column_by_name(measure, [case.registry for case in cases.values()])
            else:
                for mistake in misfits(measure, owners, dimension):
                    self.reader.report(mistake, at)
                made = column(measure, bodies)
            made.check({"contacts": contacts, "bodies": bodies, "supports": supports})
        except ValueError as error:  # raised without the place in the study, which the column does not know
            message, advice, *inside = error.args
            self.reader.wrong((*at, *inside), message, advice)
            return None
        return made


# --------------------------------------------------------------------------------- values before the first run


def refuse_wrong_values(spec: StudySpec, read: Sequence[tuple[Task, InputError | None]]) -> None:
    """Raise InputError for the values that are wrong in every run, at their places in the study.

    A value that is right in some run fails as the other runs; so does one that was drawn.

    Parameters
    ----------
    spec
        The study.
    read
        Each task, with the error by which its case cannot be changed so.
    """
    places: dict[tuple[str, str], KeyPath] = {}
    for path, values in spec.vary.items():
        listed = isinstance(spec.section.vary[path], tuple)
        places |= {(path, repr(value)): ("vary", path, i)[: 3 if listed else 2] for i, value in enumerate(values)}
    for i, point in enumerate(spec.section.paired):
        places |= {(path, repr(value)): ("paired", i, path) for path, value in point.items()}
    for kind, methods in (("integrator", spec.integrators), ("contact", spec.contacts)):
        at = f"method.{kind}"
        places |= {(at, repr(one)): ("methods", FAMILIES[kind], i) for i, one in enumerate(methods.values())}
    errors = [(task, error) for task, error in read if error is not None]
    for task, error in read:
        for path, value in task.changes.items() if error is None else ():
            places.pop((path, repr(value)), None)
    mistakes: dict[Mistake, None] = {}
    for task, wrong in errors:
        values_of_task = {path: (path, repr(value)) for path, value in task.changes.items()}
        wrong_here = {path: places[value] for path, value in values_of_task.items() if value in places}
        told = (mistake_in_study(problem, wrong_here) for problem in wrong.problems)
        mistakes |= dict.fromkeys(filter(None, told))
    ordered = sorted(mistakes, key=lambda mistake: spec.source.order(mistake.path, key=mistake.key))
    refuse_if_any([spec.source.problem(*mistake[:3], key=mistake.key) for mistake in ordered])
    if len(errors) == len(read):
        raise errors[0][1]
