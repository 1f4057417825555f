"""Checks before the first run of a study: whether its paths and its measures exist."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

from percuss.case.yaml_text import KeyPath
from percuss.errors import InputError, Problem, refuse_if_any
from percuss.jsonable import Data, Entries, plain
from percuss.studies.parameters import combinations
from percuss.studies.perform import perform
from percuss.studies.spec import StudySpec, mistake_in_study
from percuss.studies.tasks import Task, tasks


def check_points(spec: StudySpec) -> None:
    """Check that each varied path and value, and each option of a method, is right for at least one run.

    Of long lists of numbers only the ends are tried: a wrong value among right ones fails as a run of its own.

    Raises
    ------
    InputError
        With all values that are wrong in every run, at their places in the study.
    """
    problems: dict[Problem, None] = dict.fromkeys(_wrong_methods(spec))
    for places, point in _points_to_try(spec, _first_point(spec)):
        wrong = _wrong_everywhere(spec, point)
        for problem in wrong:
            mistake = mistake_in_study(problem, places)
            if mistake is not None:
                problems[spec.source.problem(*mistake[:3], key=mistake.key)] = None
            elif mistake_in_study(problem, dict.fromkeys(point, ())) is None:  # else the ends of its range say it
                problems[problem] = None
        if wrong and len(problems) > 20:
            break
    refuse_if_any(problems)


def _wrong_methods(spec: StudySpec) -> Iterator[Problem]:
    """Yield the mistakes in the options of listed methods that are wrong in every run of the first point."""
    first = _first_point(spec)
    for family, path, listed in (
        ("integrators", "method.integrator", spec.integrators),
        ("contacts", "method.contact", spec.contacts),
    ):
        for i, (label, method) in enumerate(listed.items()):
            if not isinstance(method, Mapping) or path in first:
                continue
            changes: Entries = {family: {label: method}}
            for problem in _wrong_everywhere(dataclasses.replace(spec, **changes), first):
                if problem.place.startswith(f"--set {path}="):
                    inside = problem.path.removeprefix(path).split(".")[1:]
                    at = ("methods", family, i, *(int(part) if part.isdecimal() else part for part in inside))
                    unknown = problem.message.startswith("unknown key")
                    yield spec.source.problem(at, problem.message, problem.advice, key=unknown)


def _first_point(spec: StudySpec) -> Entries:
    """Return a point of the study without making the others."""
    sample = dataclasses.replace(spec.sample, count=1) if spec.sample is not None else None
    return combinations({path: values[:1] for path, values in spec.vary.items()}, spec.paired[:1], sample)[0]


def _points_to_try(spec: StudySpec, first: Data) -> Iterator[tuple[Mapping[str, KeyPath], Entries]]:
    """Yield a point for each value to try, with the place of each of its values that the study writes out.

    All other values are those of the first point.
    """

    def place(path: str, i: int) -> KeyPath:
        return ("vary", path, i) if isinstance(spec.source.get(("vary", path)), tuple) else ("vary", path)

    places: dict[str, KeyPath] = {path: place(path, 0) for path in spec.vary}
    places |= {path: ("paired", 0, path) for point in spec.paired[:1] for path in point}
    for path, values in spec.vary.items():
        for i, value in enumerate(values):
            if i in (0, len(values) - 1) or not isinstance(value, int | float):
                yield {**places, path: place(path, i)}, {**first, path: value}
    for i, point in enumerate(spec.paired):
        yield {**places, **{path: ("paired", i, path) for path in point}}, {**first, **point}
    if spec.sample is not None:
        for path, axis in spec.sample.of.items():
            for key, value in (("from", axis.from_), ("to", axis.to)):
                yield {**places, path: ("sample", "of", path, key)}, {**first, path: value}


def _wrong_everywhere(spec: StudySpec, point: Data) -> Sequence[Problem]:
    """Return the problems of a point in its first run if it is wrong in all runs, else an empty sequence.

    An option is a mistake only if no pair of methods has it.
    """
    problems: Sequence[Problem] = ()
    any_right, used = False, set()
    for label, case in spec.cases.items():
        for task in tasks(label, case, spec.integrators, spec.contacts, [point]):
            used |= set(task.varied)
            try:
                case.with_overrides(task.changes)
            except InputError as error:
                problems = problems or error.problems
            else:
                any_right = True
            if any_right and used == set(point):
                return ()  # nothing that the other runs say would change that
    if not any_right:
        return problems
    unused = {path: value for path, value in point.items() if path not in used}
    for label, case in spec.cases.items():
        for task in tasks(label, case, spec.integrators, spec.contacts, [unused], strict=True):
            try:
                case.with_overrides(task.changes)
            except InputError as error:
                return error.problems
    return ()


def check_measures(spec: StudySpec, task: Task) -> None:
    """Check that each measured path is in the summary of a run, which makes one step of a task.

    Raises
    ------
    InputError
        With all paths that are not in the summary.
    """
    if not any(column.kind == "summary" for column in spec.rows.columns) or not spec.source.get(("measure",), ()):
        return
    case = spec.cases[task.case]
    changes = {path: value for path, value in task.changes.items() if path.split(".")[0] != "time"}
    step = {"step": case.time.step} if case.time.courant is None else {"courant": case.time.courant}
    one_step = {**changes, "time": {**step, "steps": 1, "on_unstable": "warn"}}
    run, _ = perform(case, dataclasses.replace(task, changes=one_step))
    if run.result is None or run.status != "done":
        return  # its rows will say why
    summary, problems = plain(run.result.summary), []
    for i, column in enumerate(spec.rows.columns):
        if unknown := column.unknown_to(summary):
            missing_path, advice = unknown
            message = (
                f"the summary of a run has no '{missing_path}'" if missing_path else f"{column.name} is not one number"
            )
            problems.append(spec.source.problem(("measure", i), message, advice))
    refuse_if_any(problems)
