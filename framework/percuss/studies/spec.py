"""Specification of a study, read from its file and checked: cases, methods, varied values and measures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from percuss.case.case import Case, load
from percuss.case.cross_checks import misfits
from percuss.case.hints import name_advice
from percuss.case.quantities import JUDGED_BY, METRICS, TRUE_ERRORS, by_two, ranking
from percuss.case.source import Source
from percuss.case.type_words import found
from percuss.case.validation import Mistake, Reader
from percuss.case.yaml_text import KeyPath, flow
from percuss.errors import InputError, Problem, refuse_if_any, suggestion
from percuss.jsonable import Data, Entries, as_lists
from percuss.methods.blame import SINGULAR
from percuss.methods.registry import Registry
from percuss.studies import parameters
from percuss.studies.columns import Column, RowSettings, column, column_by_name
from percuss.studies.layout import Condition, SampleSection, StudySection
from percuss.studies.tasks import FAMILIES, Task, method_name, two_references

RESERVED = {"case", "integrator", "contact", "status", "reason", "said_by", "fragile", "seconds", "key", *METRICS}
COST = "node_steps"
Places = Mapping[str, KeyPath]  # where the study writes out a value, by the path that it is set at
NAMES = ("case", "integrator", "contact")  # columns of every row, besides the varied paths


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
    paired
        Points whose values go together.
    rows
        Measured columns, and the other settings on which rows depend.
    section, source
        The file as it was read, and its text.
    """

    cases: dict[str, Case]
    integrators: Entries
    contacts: Entries
    vary: dict[str, list[object]]
    paired: list[Entries]
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
        values += [value for point in self.paired for value in point.values()]
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
    source = Source.of(given) if isinstance(given, Mapping) else Source.read(given)
    if isinstance(given, Mapping):
        source = Source("study", "", source.data, source.marks)
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
    reader = _StudyReader(Source.of(data), [])
    return reader.checked(reader.reader.read(StudySection), reader.columns(dict(cases)))[1]


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
    """Reader of a study, based on the reader of cases."""

    def __init__(self, source: Source, plugins: list[Path]) -> None:
        self.reader = Reader(source, Registry.load(plugins))
        self.source, self.plugins = source, plugins

    def study(self) -> StudySpec:
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
        names = data.get("cases")
        if not isinstance(names, tuple) or not all(isinstance(path, str) for path in names):
            reader.finish()  # without cases nothing else can be checked
        cases = self.cases(names)
        registries = [case.registry for case in cases.values()] or [self.reader.registry]
        integrators, contacts = self.methods("integrators", registries), self.methods("contacts", registries)
        if contacts:
            cases = {label: case.with_one_law() for label, case in cases.items()}
        varied = {path: self.values(("vary", path), given) for path, given in self.entries("vary").items()}
        paired, sample = self.paired(), self.sample()
        self.refuse_repeated_paths(varied, paired, sample)
        if (count := parameters.number_of_combinations(varied, paired, sample)) > parameters.MOST:
            message = f"expected at most {parameters.MOST} combinations of values, found {count}"
            self.reader.wrong(("vary",), message, "Vary fewer values, or draw a sample of them.", key=True)
        paths = [*varied, *(path for point in paired for path in point), *(sample.of if sample else ())]
        points = [{path: value} for path, values in varied.items() for value in values]
        cases = {label: two_references(case, contacts, [*points, *paired]) for label, case in cases.items()}
        self.check_conditions([*NAMES, *dict.fromkeys(paths)])
        section, rows = self.checked(section, self.columns(cases))
        return StudySpec(cases, integrators, contacts, varied, paired, rows, section, self.source)

    def checked(self, section: StudySection | None, columns: tuple[Column, ...]) -> tuple[StudySection, RowSettings]:
        """Return the section and the settings of its rows, if no mistake was found."""
        self.reader.finish()
        if section is None:
            raise AssertionError("a study is wrong and nothing says why")
        return section, RowSettings(columns, section.nudge, section.keep.histories, section.repeats)

    # -------------------------------------------------------------------------------------------- parts

    def entries(self, *path: str) -> Data:
        """Return the entries of a mapping, none where it is absent or no mapping, which is reported already."""
        value = self.source.get(path)
        return value if isinstance(value, Mapping) else {}

    def items(self, *path: str) -> tuple[object, ...]:
        """Return the items of a list, none where it is absent or no list, which is reported already."""
        value = self.source.get(path)
        return value if isinstance(value, tuple) else ()

    def cases(self, names: tuple[str, ...]) -> dict[str, Case]:
        """Return the cases by label: the file name without its ending, or the path if two names are alike."""
        stems = [Path(case_file).stem for case_file in names]
        if not names:
            self.reader.wrong(("cases",), "expected at least one case, found none", "Name a file.")
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
        given = self.entries("set")
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
        path, given, kind = ("methods", family), self.items("methods", family), SINGULAR[family]
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
        """Return the values of a list or of a text in the grammar of `parameters`, or a single value as a list."""
        if isinstance(given, str):
            try:
                return [*parameters.values(given)]
            except InputError as error:
                self.reader.wrong(at, error.problems[0].message, error.problems[0].advice)
                return []
        out = list(given) if isinstance(given, tuple) else [given]
        if not out or given is None or isinstance(given, Mapping):
            advice = f"Or {parameters.GRAMMAR}."
            self.reader.wrong(at, f"expected a list of values, found {found(given)}", advice)
        return out

    def paired(self) -> list[Entries]:
        """Return the points whose values go together."""
        points = [(i, dict(point)) for i, point in enumerate(self.items("paired")) if isinstance(point, Mapping)]
        for i, point in points[1:]:
            first = points[0][1]
            if set(point) != set(first):
                message = f"has {', '.join(point)}, and the first has {', '.join(first)}"
                self.reader.wrong(("paired", i), message, "Give every point the same paths.")
        return [point for _, point in points]

    def sample(self) -> SampleSection | None:
        """Return the points to be drawn, or None if there are none."""
        section: SampleSection | None = self.reader.part(("sample",))
        if section is not None and not section.of:
            self.reader.wrong(("sample", "of"), "expected at least one path, found none", "Add PATH: {from: 0, to: 1}.")
        return section

    def check_conditions(self, paths: list[str]) -> None:
        """Report the conditions on what is not varied."""
        for i in range(len(self.items("where"))):
            condition: Condition | None = self.reader.part(("where", i))
            if condition is not None and condition.path not in paths:
                message = f"'{condition.path}' is not varied"
                self.reader.wrong(("where", i, "path"), message, suggestion(condition.path, paths))

    def refuse_repeated_paths(self, varied: Data, paired: Sequence[Data], sample: SampleSection | None) -> None:
        """Report a path that is varied in two ways, as the second would silently replace the first."""
        seen = set(varied)
        together = dict.fromkeys(path for point in paired for path in point)
        for section, paths in (("paired", together), ("sample", sample.of if sample else {})):
            for path in (path for path in paths if path in seen):
                self.reader.wrong((section,), f"{path} is varied twice", "Give each path once.")
            seen |= set(paths)

    def columns(self, cases: dict[str, Case]) -> tuple[Column, ...]:
        """Return the measured columns."""
        out: dict[str, Column] = {}
        for i, measure in enumerate(self.items("measure")):
            column_of_measure = self.column(("measure", i), measure, cases)
            if column_of_measure is None:
                continue
            name = column_of_measure.name
            if not isinstance(measure, str) and name in RESERVED:
                self.reader.wrong(("measure", i), f"the name '{name}' is the name of another column", "Rename it.")
            elif name in out:
                self.reader.wrong(("measure", i), f"the name '{name}' is taken by another measure", "Rename it.")
            else:
                out[name] = column_of_measure
        # Every row has the cost that does not depend on the machine, and the finer runs by which it may be judged.
        names, judges = [*([] if out else METRICS), COST], [case.reference for case in cases.values()]
        names += [JUDGED_BY] if any(judge is not None for judge in judges) else []
        errors = [name for name in ranking([*out, *names]) if name in TRUE_ERRORS][:1]
        two = any(judge is not None and judge.second is not None for judge in judges)
        names += [path for error in errors for path in by_two(error)] if two else []
        return tuple({**out, **{name: column_by_name(name) for name in names}}.values())

    def column(self, at: KeyPath, measure: object, cases: dict[str, Case]) -> Column | None:
        """Return the column of a measure, or None if the measure is wrong."""
        contacts = dict.fromkeys(name for case in cases.values() for name in case.contacts)
        try:
            if isinstance(measure, str):
                made = column_by_name(measure, [case.registry for case in cases.values()])
            elif (section := self.reader.part(at)) is not None:
                for mistake in misfits(section, contacts):
                    self.reader.report(mistake, at)
                made = column(section, [name for case in cases.values() for name in case.bodies])
            else:
                return None
            made.check(contacts)
        except ValueError as error:  # raised without the place in the study, which the column does not know
            message, advice, *inside = error.args
            self.reader.wrong((*at, *inside), message, advice)
            return None
        return made


# --------------------------------------------------------------------------------- values before the first run


def refuse_wrong_values(spec: StudySpec, read: Iterable[tuple[Task, InputError | None]]) -> None:
    """Raise InputError for the values that are wrong in every run, at their places in the study.

    A value that is right in some run fails as the other runs; so does one that was drawn.

    Parameters
    ----------
    spec
        The study.
    read
        Each task, with the error by which its case cannot be changed so.
    """
    places: dict[tuple[str, str], Places] = {}
    for path, values in spec.vary.items():
        listed = isinstance(spec.source.get(("vary", path)), tuple)
        for i, value in enumerate(values):
            places[path, repr(value)] = {path: ("vary", path, i) if listed else ("vary", path)}
    for i, point in enumerate(spec.paired):
        places |= {(path, repr(value)): {path: ("paired", i, path)} for path, value in point.items()}
    for kind, family in FAMILIES.items():
        for i, method in enumerate((spec.integrators if kind == "integrator" else spec.contacts).values()):
            places[f"method.{kind}", repr(method)] = {f"method.{kind}": ("methods", family, i)}
    right: set[tuple[str, str]] = set()
    wrong: dict[tuple[str, str], InputError] = {}
    errors = []
    for task, error in read:
        values_of_task = {(path, repr(value)) for path, value in task.changes.items()}
        errors.append(error)
        if error is None:
            right |= values_of_task
        else:
            wrong |= {value: error for value in values_of_task & places.keys() if value not in wrong}
    problems: dict[Problem, None] = {}
    for value in (value for value in places if value in wrong and value not in right):
        mistakes = (mistake_in_study(problem, places[value]) for problem in wrong[value].problems)
        for mistake in filter(None, mistakes):
            problems.setdefault(spec.source.problem(*mistake[:3], key=mistake.key))
    refuse_if_any(problems)
    if errors and all(errors):
        raise next(filter(None, errors))
