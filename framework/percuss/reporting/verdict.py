"""The verdict at the end of a command: what came out, how far it can be trusted, and what to do next, in words."""

from __future__ import annotations

import re
import statistics
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from percuss.case.quantities import JUDGED_BY, METRICS, TRUE_ERRORS, by_two, of_column, percent, ranking
from percuss.case.yaml_text import flow
from percuss.certificate.verdict import capitalised
from percuss.jsonable import Data
from percuss.march.stop import NOT_STARTED
from percuss.results.ledger import open_accounts
from percuss.results.true_error import (
    ENDED_BY_CTRL_C,
    errors_of,
    errors_of_contacts,
    judge_words,
    largest_error,
)
from percuss.studies.columns import metric
from percuss.studies.comparison import metrics
from percuss.studies.perform import label_of
from percuss.studies.tasks import TIED

if TYPE_CHECKING:
    from percuss.certificate.verdict import Certificate
    from percuss.results.result import Result
    from percuss.studies.perform import Run

SAME = 1e-6  # relative difference below which two errors are the same
LARGE_ERROR = 0.05  # a run with a smaller true error needs no search for better methods
ROUND_OFF = 1e-10  # a smaller error or change of energy is none
GROWN = 0.01  # share of the energy put in: a run that adds more is not called good by its error alone
MOST_REASONS, MOST_NAMED = 12, 3
MOST_CASES = 2  # of more cases only the wins are told; the tables and the charts have each of them
# What differs from run to run in a reason.
PLACE = re.compile(r"( at step \d+, time \S+)?, node \d+ of body '[^']*'( limits the step)?")


def run_verdict(result: Result, next_command: str) -> Iterator[str]:
    """Yield the verdict on a run, one sentence or two a line.

    Parameters
    ----------
    result
        The run.
    next_command
        The command that searches better methods for the case, in words.
    """
    summary = result.summary
    stop, certificate = summary["stop"], summary["certificate"]
    cure = f" To be stable, {certificate['cure']}." if certificate["cure"] else ""
    if stop is not None:
        refused = stop["what"] == NOT_STARTED
        happened = "percuss refused to run it" if refused else f"The run stopped at t = {stop['time']:.4g}"
        why = "the certificate says unstable" if certificate["stable"] == "no" else stop["what"]
        yield f"{happened}: {why}.{cure}"
        return
    if certificate["stable"] == "no":
        yield f"The step is unstable, so do not trust this run.{cure}"
        return
    if result.status == "interrupted":
        yield f"The run was interrupted: all numbers hold up to t = {summary['end']:.4g}."
    if open_accounts(summary):
        yield "This is not a valid result: energy or momentum does not balance. See the notes."
    kept = metric(result, "energy_kept")
    # Where a guarantee held nothing has grown: the work of loads in the first half step is not in the account.
    grown = kept - 1.0 if kept is not None and not summary["energy_growth"]["kept"] else 0.0
    if kept is not None and grown <= GROWN:
        changed = f"{'lost' if kept < 1.0 else 'added'} {percent(abs(kept - 1.0), 2)} of"
        damped = ", materials and damping" if "damped" in summary["energy"] else " and materials"
        yield f"Contacts, scheme{damped} {changed if abs(kept - 1.0) > ROUND_OFF else 'kept'} the energy put in."
    if summary["fragile"] is not None:
        what = "contact force" if summary["contacts"] else "motion"
        sensitivity = "depends on round-off: a change of 1e-10 % in one area changes it"
        yield f"The {what} {sensitivity if summary['fragile'] else 'is insensitive to round-off'}."
    yield from _error_lines(result, next_command)
    if grown > GROWN:
        added = f"But contacts, scheme and materials added {percent(grown, 2)} of the energy put in"
        yield f"{added}, which no real contact does: take other methods or a smaller step."


def error_words(result: Result) -> str:
    """Return the true error of a run in a few words, or that it is unknown."""
    summary = result.summary
    error, covered, errors = largest_error(summary), summary.get("exact_covered"), errors_of(summary)
    if error is None or errors is None:
        return "the true error is unknown"
    forces = errors_of_contacts(summary, errors, "force_error_l1")
    worst = max(forces, key=forces.__getitem__, default="")
    until = f" up to t = {covered['until']:.4g}, where the exact solution ends" if covered else ""
    about = "about " if summary.get("estimated") else ""
    off = f"off by {about}{percent(error, 2)}" if error > ROUND_OFF else "exact up to round-off"
    of_contact = f" of '{worst}'" if len(errors["contacts"]) > 1 else ""
    return f"the {f'contact force{of_contact}' if worst else 'displacement at the end'} is {off}{until}"


def _error_lines(result: Result, next_command: str) -> Iterator[str]:
    """Yield how large the true error of a run is, and how it can be made smaller."""
    summary = result.summary
    error, words = largest_error(summary), capitalised(error_words(result))
    if error is None and errors_of(summary) is None:
        if summary["exact_reason"] == ENDED_BY_CTRL_C:
            yield "Ctrl-C ended the search for the true error: make the run again to have it."
            return
        yield f"No exact solution is known, so percuss cannot compute the true error ({summary['exact_reason']})."
        finer = f"refine={4 * result.provenance['case'].get('refine', 1):g}"
        search = f", or try {next_command}" if next_command else ""
        yield f"To judge the run by a finer mesh, give `--reference {finer}`{search}."
        return
    if summary["exact_covered"]:
        yield f"The exact solution ends before the run: {summary['exact_reason']}."
    if error is None:
        every = result.provenance["case"].get("record", {}).get("every", 1)
        sparse = f"the force is compared where each step is recorded (record.every: 1, not {every})"
        yield f"{words}: {sparse if every > 1 else 'there is no force and no displacement to compare'}."
        return
    estimated = summary.get("estimated")
    known = f"an estimate, by {judge_words(summary)}" if estimated else "exact solution known"
    search = f": try {next_command}" if next_command and error > LARGE_ERROR else ""
    yield f"{words} ({known}){search}."


def comparison_verdict(title: str, runs: Sequence[Run]) -> Iterator[str]:
    """Yield the verdict on the runs of a comparison, as that on the rows of a study."""
    paths = dict.fromkeys(path for run in runs for path in run.varied)
    rows = [
        {"case": title or "untitled case", "integrator": run.integrator, "contact": run.contact}
        | {path: run.varied.get(path) for path in paths}
        | {"status": run.status, "reason": run.reason, "said_by": run.said_by, "fragile": None}
        | dict.fromkeys(METRICS)
        | metrics(run)
        for run in runs
    ]
    return rows_verdict(rows, list(METRICS))


def rows_verdict(rows: Sequence[Data], columns: Sequence[str]) -> Iterator[str]:
    """Yield which pairs are best, how many runs depend on round-off, and how many failed and why.

    Parameters
    ----------
    rows
        The runs, with the keys of the table of a study.
    columns
        The measured columns; runs are ranked by the first error among them.
    """
    yield from answer(rows, columns)
    yield from failed_rows(rows)


def answer(rows: Sequence[Data], columns: Iterable[str]) -> Iterator[str]:
    """Yield which pairs are best, and how many runs depend on round-off, as `rows_verdict` does."""
    yield from best_runs(rows, columns)
    if fragile := sum(row["fragile"] is True for row in rows):
        yield f"{fragile} of {len(rows)} runs depend on round-off."


def failed_rows(rows: Sequence[Data]) -> Iterator[str]:
    """Yield a line for each reason why rows of a study failed, the most frequent first."""
    sources = (f"{row['said_by']} says: " if row["said_by"] else "" for row in rows)
    yield from failures(
        (row["status"], row["reason"] and f"{source}{row['reason']}", run_words(row))
        for row, source in zip(rows, sources, strict=True)
    )


def best_runs(rows: Sequence[Data], columns: Iterable[str]) -> Iterator[str]:
    """Yield which pairs tie, the best on equal meshes, and the best run of each case; of many cases the best pairs.

    Parameters
    ----------
    rows
        The runs, with the keys of the table of a study.
    columns
        The measured columns; runs are ranked by the first error among them.
    """
    columns = list(columns)
    yield from tie_words(rows, columns)
    error = next(iter(ranking(name for name in columns if any(is_number(row[name]) for row in rows))), "")
    if not error:
        return
    yield from equal_mesh_words(rows, error)
    competing = [row for row in rows if row["status"] == "done" and row["contact"] != TIED]
    of_cases: dict[str, list[Data]] = {row["case"]: [] for row in rows}
    for row in competing:
        of_cases[row["case"]] += [row] if is_number(row[error]) else []
    judged = {case: done for case, done in of_cases.items() if done}
    if len(judged) > MOST_CASES:
        yield _wins(judged.values(), error, "in", f"{len(judged)} cases")
    for case, done in of_cases.items():
        if not done:
            yield f"{case}: no run has a value of {error}."
        elif len(judged) <= MOST_CASES:
            yield best_words(case, done, error)
        if unjudged := [run_words(row) for row in competing if row["case"] == case and not is_number(row[error])]:
            yield f"{case}: not compared, as their {of_column(error).label} is unknown: {_named(unjudged)}."


def _named(names: Sequence[str]) -> str:
    """Return the first names, and how many more there are."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return f"{', '.join(names[:MOST_NAMED])}{more}"


def _wins(groups: Iterable[Sequence[Data]], error: str, word: str, where: str) -> str:
    """Return in how many groups of runs which pairs have the smallest error, as "in 3 of 4 cases"."""
    wins: Counter[str] = Counter()
    for rows in groups:
        least, apart = min(row[error] for row in rows), apart_of(rows, error)
        best = (row for row in rows if is_same(error, row[error], least) or row[error] - least < apart)
        wins.update(list(dict.fromkeys(f"{row['integrator']} + {row['contact']}" for row in best)))
    (first, most), *others = wins.most_common(MOST_NAMED)
    more = "".join(f", {pair} {word} {count}" for pair, count in others)
    return f"{first} has the smallest {of_column(error).label} {word} {most} of {where}{more}."


def tie_words(rows: Iterable[Data], columns: Iterable[str]) -> Iterator[str]:
    """Yield a sentence for each group of pairs whose runs have the same numbers to the last bit.

    Parameters
    ----------
    rows
        The runs, with the keys of the table of a study.
    columns
        The measured columns.
    """
    measured = [name for name in columns if not name.startswith("seconds")]
    numbers: dict[tuple[str, str], set[object]] = {}
    for row in rows:
        found = tuple(row[name] for name in measured if is_number(row[name]))
        if row["status"] == "done" and any(isinstance(value, float) and not value.is_integer() for value in found):
            pair = row["integrator"], row["contact"]
            numbers.setdefault(pair, set()).add((row["case"], flow(varied_of(row)), found))
    alike: dict[frozenset[object], list[str]] = {}
    for pair, of_pair in numbers.items():
        alike.setdefault(frozenset(of_pair), []).append(" + ".join(pair))
    for names in alike.values():
        if len(names) > 1:
            yield f"{', '.join(names[:-1])} and {names[-1]} tie: their numbers are the same to the last bit."


def equal_mesh_words(rows: Iterable[Data], error: str) -> Iterator[str]:
    """Yield the sentence on the smallest errors on equal meshes, where runs differ in mesh and in methods.

    Parameters
    ----------
    rows
        The runs, with the keys of the table of a study.
    error
        Name of the error.
    """
    problems: dict[tuple[str, tuple[Any, ...]], list[Data]] = {}
    for row in rows:
        mesh = tuple(flow(value) for path, value in varied_of(row) if path == "refine" or path.endswith(".elements"))
        if mesh and row["status"] == "done" and row["contact"] != TIED and is_number(row[error]):
            problems.setdefault((row["case"], mesh), []).append(row)
    pairs = [[(row["integrator"], row["contact"]) for row in of_problem] for of_problem in problems.values()]
    if len(problems) < 2 or not any(len(set(of_problem)) > 1 for of_problem in pairs):
        return
    several = len({case for case, _ in problems}) > 1
    where = f"{len(problems)} {'pairs of case and mesh' if several else 'meshes'}"
    yield f"At equal mesh {_wins(problems.values(), error, 'on', where)}"


def varied_of(row: Data) -> tuple[tuple[str, Any], ...]:
    """Return path and value of each varied value of a row."""
    keys = list(row)
    return tuple((path, row[path]) for path in keys[3 : keys.index("status")])


def is_same(name: str, error: Any, least: float) -> Any:
    """Return whether an error of a name, or each of an array of errors, is the least one but for round-off."""
    return error - least <= max(SAME * abs(least), ROUND_OFF if of_column(name).is_fraction else 0.0)


def best_words(case: str, rows: Sequence[Data], error: str) -> str:
    """Return the sentence on the smallest error of a case.

    Parameters
    ----------
    case
        Name of the case.
    rows
        The runs that are compared, with the keys of the table of a study.
    error
        Name of the error.
    """
    least, quantity = min(row[error] for row in rows), of_column(error)
    apart = apart_of(rows, error)
    shared = [row for row in rows if row[error] - least < apart]
    if len(shared) > 1:
        why = f"their errors ({quantity.label}) differ by less than the two finer runs that judge them"
        share = f"{len(shared)} of {len(rows)} runs share the first rank ({_named([*map(run_words, shared)])})"
        return f"{case}: {share}: {why} ({quantity.text(apart)})."
    best = [row for row in rows if is_same(error, row[error], least)]
    first_of_pair = {(row["integrator"], row["contact"]): row for row in reversed(best)}
    names = [run_words(row) for row in reversed(first_of_pair.values())]
    pairs = f"{', '.join(names[:-1])} and {names[-1]} have" if names[1:] else f"{names[0]} has"
    median = quantity.text(statistics.median(row[error] for row in rows))
    estimated = "estimated " if any(row.get(JUDGED_BY) for row in rows) else ""
    kept = best[0].get("energy_kept") or 1.0
    grown = f"; its energy grew by {percent(kept - 1.0, 2)}" if kept > 1.0 + GROWN else ""
    among = f"; the median of {len(rows):,} runs is {median}" if len(rows) > 1 else ""
    return f"{case}: {pairs} the smallest {estimated}{quantity.label} ({quantity.text(best[0][error])}){grown}{among}."


def apart_of(rows: Iterable[Data], error: str) -> float:
    """Return how far apart the two finer runs are that judge runs, in their error; 0 where there are none.

    Parameters
    ----------
    rows
        The runs, with the keys of the table of a study.
    error
        Name of the error.
    """
    path = by_two(error)[2] if error in TRUE_ERRORS else ""
    return max((row[path] for row in rows if is_number(row.get(path))), default=0.0)


def failures(runs: Iterable[tuple[str, str, str]]) -> Iterator[str]:
    """Yield a line for each reason why runs failed, the most frequent first.

    Parameters
    ----------
    runs
        Status, reason and words of each run; runs without a reason have not failed.
    """
    by_reason: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for status, reason, words in runs:
        if reason:
            by_reason.setdefault((status, PLACE.sub("", reason.split("\n")[0])), []).append((words, reason))
    for (status, first_line), failed in sorted(by_reason.items(), key=lambda item: -len(item[1]))[:MOST_REASONS]:
        named = _named(list(dict.fromkeys(words for words, _ in failed)))
        why = first_line if len(failed) > 1 else "; ".join(line.strip() for line in failed[0][1].splitlines())
        yield f"{len(failed)} {status}: {named}: {why}"
    if len(by_reason) > MOST_REASONS:
        yield f"and {len(by_reason) - MOST_REASONS} other reasons: see the reason of each run in --json"


def run_words(row: Data) -> str:
    """Return the methods and the varied values of a run of a study in one line."""
    return label_of(row["integrator"], row["contact"], dict(varied_of(row)))


def is_number(value: object) -> bool:
    """Return whether a value of a table is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def check_verdict(
    steps: int, dt: str, certificate: Certificate, solution: str, why_not: str, *, refused: bool
) -> Iterator[str]:
    """Yield three sentences on a case before its run: whether it will run, whether it is stable, what judges it.

    Parameters
    ----------
    steps, dt
        Number of steps, and the time step as text.
    certificate
        Certificate of the case.
    solution, why_not
        Name of the exact solution of the case; else why there is none.
    refused
        Whether percuss refuses to run the case if its step is unstable.
    """
    margin, stable = certificate["margin"], certificate["stable"]
    of_critical = f": its step is {percent(margin)} of the critical one" if margin is not None else ""
    if stable == "no":
        runs = "will not run" if refused else "runs although it is unstable, as the case asks (on_unstable: warn)"
        yield f"It {runs}. To be stable, {certificate['cure']}."
    else:
        yield f"It will run: {steps} steps of {dt}."
    yield {
        "yes": f"It is stable{of_critical}.",
        "no": f"It is unstable{of_critical}.",
        "marginal": f"It is at the edge of stability{of_critical}.",
    }.get(stable, f"Whether it is stable is unknown: {certificate['why']}.")
    if solution:
        yield f"percuss will compute the true error: the exact solution is known ({solution})."
    else:
        yield f"percuss cannot compute the true error: no exact solution is known ({why_not})."
