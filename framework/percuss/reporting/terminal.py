"""What commands print of results, comparisons and checks: lines and tables."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from percuss.case.quantities import (
    COMPARISON_TABLE,
    CONTACT_NUMBERS,
    METRICS,
    QUANTITIES,
    STUDY_TABLE,
    TRUE_ERRORS,
    by_two,
    in_unit,
    of_column,
    percent,
    ranking,
    with_unit,
)
from percuss.certificate.flutter import NO_STEP
from percuss.jsonable import Data, Entries
from percuss.reporting.tables import Column, Piece, Table, Unbroken, words
from percuss.reporting.verdict import apart_of, is_number
from percuss.results.ledger import ledger_words
from percuss.results.true_error import errors_of, judge_words
from percuss.studies.comparison import metrics
from percuss.studies.perform import Run

if TYPE_CHECKING:
    from percuss.certificate.waves import Waves
    from percuss.results.rerun import Difference, Rerun
    from percuss.results.result import Result
    from percuss.studies.study_table import Study


OF_FRICTION = {
    "friction_dissipated": "took",
    "friction_stored": "stick stores",
    "contact_slip": "longest slide",
}
STABILITY_LINES = 12  # most lines of the table of critical Courant numbers
BEST, FEWEST_BEST = 12, 3  # rows of a study in all tables of the best, and of a case in its own if it has as many
STABILITY_REASONS = 3  # most reasons below it


def number_text(value: object, digits: int = 6) -> str:
    """Return a value of a table as text, a number with `digits` digits, None as a dash."""
    if value is None:
        return "-"
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def result_lines(result: Result) -> Iterator[Piece]:
    """Yield a run or an exact solution: status, notes, contacts; of a run true errors and balances too."""
    summary = result.summary
    yield (result.title or "untitled case", "bold"), f": {result.status}"
    if result.marched:
        dt = in_unit(summary["dt"], 6, "time", result.units)
        threads = f"{summary['threads']} threads, " if summary.get("threads", 1) > 1 else ""
        yield (
            f"{result.provenance['resolved']['integrator']}, "
            f"{summary['steps']} steps of {dt} (Courant number {summary['courant']:.4g}), "
            f"{'compiled' if summary['compiled'] else 'plain Python'}, {threads}marched in "
            f"{summary['seconds']['march']:.3g} s"
        )
    else:
        yield result.solution_name
    yield from (f"  note: {note}" for note in summary["notes"])
    yield from (f"  not compiled: {reason}" for reason in summary.get("compiled_why", ()))
    if result.status == "unstable" and summary["steps"] == 0:
        return
    if summary["contacts"]:
        yield Table(_contact_columns(result))
    if result.marched:
        yield from _error_lines(summary)
        yield from (f"{what}: {balance}" for what, balance in balances(result).items())
    elif summary["exact_reason"]:
        yield f"exact solution: {summary['exact_reason']}"


def _contact_columns(result: Result) -> list[Column]:
    """Return the columns of the table of contacts: their laws, and the numbers that the summary has of each."""
    contacts, resolved = result.summary["contacts"], result.provenance.get("resolved", {})
    laws = []
    for name in contacts:
        law = resolved.get("contacts", {}).get(name, {"law": "exact"})
        headline = [key for key in resolved.get("headline", {}).get(name, ()) if key in law]
        options = ", ".join(f"{key} {number_text(law[key], 4)}" for key in headline)
        laws.append(f"{law['law']}{f' ({options})' if options else ''}")
    columns = [words("contact", contacts), words("law", laws)]
    for quantity in CONTACT_NUMBERS.values():
        digits = 3 if quantity.is_error else 6
        # Exact contacts do not overlap; the table has the columns of a run, so that both are read alike.
        overlaps = result.marched or not quantity.is_error
        values = [quantity.of_contact(contact) if overlaps else 0.0 for contact in contacts.values()]
        cells = [number_text(value, digits) for value in values]
        if quantity is CONTACT_NUMBERS["last_open"]:
            opened = zip(cells, contacts.values(), strict=True)
            cells = ["still closed" if _is_closed(contact) else cell for cell, contact in opened]
        columns.append(Column(with_unit(quantity.head, quantity.unit, result.units), cells))
    return columns


def _is_closed(contact: Data) -> bool:
    """Return whether a contact is closed at the end of its run."""
    return contact["first_closed"] is not None and contact["last_open"] is None


def balances(result: Result) -> dict[str, str]:
    """Return in words the energies and works, and how well they and the momentum balance."""
    energy, momentum = result.summary["energy"], result.summary["momentum"]
    bound = energy.get("renewal")
    renewed = f" (rows that move brought {number_text(bound, 2)} at most)" if bound is not None else ""
    works = [contact["wall_work"] for contact in result.summary["contacts"].values() if "wall_work" in contact]
    walls = f" ({number_text(sum(works))} by walls)" if works else ""
    damped = f"damping took {number_text(energy['damped'])}, " if "damped" in energy else ""
    balance = "NOT balanced: off by" if momentum.get("balanced") is False else "balanced to"
    return {
        with_unit("energy", "energy", result.units): f"{number_text(energy['initial'])} at the start, "
        f"{number_text(energy['final'])} at the end, at most {number_text(energy['max'])}; "
        f"external work {number_text(energy['external_work'])}{walls}, {damped}"
        f"contact work {number_text(energy['contact_work'], 4)}{renewed}; {ledger_words(energy)}",
        **{
            with_unit(f"friction of {name}", "energy", result.units): _of_friction(contact)
            for name, contact in result.summary["contacts"].items()
            if "friction_dissipated" in contact
        },
        "momentum and impulses": f"{balance} {percent(momentum['error'], 2)}",
    }


def _of_friction(contact: Data) -> str:
    """Return the numbers that friction has of a contact, in words."""
    return ", ".join(f"{words} {number_text(contact[key] + 0.0)}" for key, words in OF_FRICTION.items())


def _error_lines(summary: Data) -> Iterator[str]:
    """Yield the errors of a run against the exact solution.

    Where the exact solution ends before the run, the errors are told with the time up to which they hold.
    """
    covered, estimated = summary.get("exact_covered"), summary.get("estimated")
    if estimated:
        yield f"the errors are estimates, by {judge_words(summary)}"
    kind = "estimated " if estimated else "" if covered else "true "
    until = f" up to {number_text(covered['until'])}, where the exact solution ends" if covered is not None else ""
    second = estimated.get("second") if estimated else None
    for comparison in (summary["exact"], covered, estimated, second):
        for name, error in comparison["contacts"].items() if comparison is not None else ():
            measures = ", ".join(
                f"{quantity.head} {quantity.text(error[key])}{quantity.beside and f' ({quantity.beside})'}"
                for key, quantity in METRICS.items()
                if quantity.against_exact and key in error and (error[key] is not None or not estimated)
            )
            whose = ", by the second finer run" if comparison is second else ""
            yield f"{kind}error of {name}{until}{whose}: {measures}"


def comparison_lines(title: str, rows: list[Run]) -> Iterator[Piece]:
    """Yield the table of a comparison, one line per run."""
    varied = list(dict.fromkeys(path for row in rows for path in row.varied))
    values = [metrics(row) if row.status in {"done", "interrupted"} else {} for row in rows]
    units = next((row.result.units for row in rows if row.result is not None), {})
    columns = [words(name, (getattr(row, name) for row in rows)) for name in ("integrator", "contact")]
    columns += [Column(path, [number_text(row.varied.get(path)) for row in rows]) for path in varied]
    columns.append(words("status", (row.status for row in rows)))
    for key in (*COMPARISON_TABLE, "seconds"):
        digits = 3 if key in {*TRUE_ERRORS, "seconds", "penetration"} else 5
        quantity = QUANTITIES.get(key)
        head = with_unit(quantity.head, quantity.unit, units) if quantity is not None else "s"
        cells = [(quantity.text if quantity is not None else number_text)(of_row.get(key), digits) for of_row in values]
        if key in TRUE_ERRORS:
            cells = [_by_two(of_row, key) or cell for of_row, cell in zip(values, cells, strict=True)]
        columns.append(Column(head, cells))
    yield Table(columns, title)
    summaries = [row.result.summary for row in rows if row.result is not None]
    judges = dict.fromkeys(filter(None, map(judge_words, summaries)))
    true = [
        f"{row.integrator} + {row.contact}" for row in rows if row.result is not None and row.result.summary["exact"]
    ]
    if judges:
        also = f"; true errors of {', '.join(dict.fromkeys(true))}" if true else ""
        yield f"force, impulse, displ.: errors estimated by {'; '.join(judges)}{also}"
    elif any(errors_of(summary) for summary in summaries):
        yield "force, impulse, displ.: true errors"


def order_lines(orders: list[Entries]) -> Iterator[Piece]:
    """Yield the observed order of convergence of each error for each pair of methods."""
    others = list(dict.fromkeys(path for fit in orders for path in fit if "." in path))
    columns = [words(name, (fit[name] for fit in orders)) for name in ("integrator", "contact")]
    columns += [Column(path, [number_text(fit.get(path)) for fit in orders]) for path in others]
    columns.append(words("refine", (", ".join(map(str, fit["refine"])) for fit in orders)))
    for name in TRUE_ERRORS:
        columns.append(Column(QUANTITIES[name].label, [number_text(fit[f"{name}_order"], 3) for fit in orders]))
    if orders:
        yield Table(columns, "observed orders of convergence")


def study_lines(study: Study) -> Iterator[Piece]:
    """Yield the number of rows with each status, and the best of the done rows."""
    rows = study.as_records()
    counts = ", ".join(f"{count} {status}" for status, count in study.counts.items())
    resumed = f", {study.found} found done" if study.found else ""
    yield (study.title or "untitled study", "bold"), f": {len(rows)} runs: {counts}{resumed}"
    done = [row for row in rows if row["status"] == "done"]
    measured = [name for name in study.columns if any(is_number(row[name]) for row in done)]
    if done and measured:
        yield from _best_runs(done, measured, list(rows[0]))
    for name, without in _without_value(study, done).items():
        yield f"no value of {name} in {without} of {len(done)} done: {study.columns[name]}"
    yield Unbroken(f"rows: {study.path}")


def _without_value(study: Study, done: list[Entries]) -> dict[str, int]:
    """Return in how many of the done rows each measure of a time has no value, as they end before it; without zeros."""
    asked = [one for one in study.spec.get("measure") or () if isinstance(one, dict) and {"during", "at"} & one.keys()]
    counts = {one["name"]: sum(row[one["name"]] is None for row in done) for one in asked}
    return {name: count for name, count in counts.items() if count}


def _best_runs(done: Sequence[Data], measured: list[str], keys: list[str]) -> Iterator[Table]:
    """Yield the done rows by the first measured error: as a table of cases and pairs, or as a ranking of each case."""
    error = next(iter(ranking(measured)), "")
    varied = keys[3 : keys.index("status")]
    cases = list(dict.fromkeys(row["case"] for row in done))
    if error and len(cases) > 1 and not varied:
        yield _cases(done, error)
        return
    usual = [name for name in STUDY_TABLE if name in measured] or measured[:6]
    shown = list(dict.fromkeys([*([error] if error and error not in usual else []), *usual, "seconds"]))
    for case in cases:
        rows = [row for row in done if row["case"] == case]
        # A run without a number for the error cannot be ranked by it.
        ranked = sorted((row for row in rows if is_number(row[error])), key=lambda row: row[error]) if error else rows
        best = ranked[: max(FEWEST_BEST, BEST // len(cases))]
        columns = [words(head, (number_text(row[head]) for row in best)) for head in ("integrator", "contact")]
        columns += [
            Column(head, [number_text(row[head], 5) for row in best])
            for head in varied
            if len({str(row[head]) for row in rows}) > 1
        ]
        if apart := apart_of(rows, error):
            columns.append(Column("rank", _ranks([row[error] for row in best], apart)))
        columns += [Column(head, [_cell(row, head) for row in best]) for head in shown]
        title = f"smallest {error}" if error else "first runs"
        yield Table(columns, f"{case}: {title}" if len(cases) > 1 else title)


def _ranks(errors: Sequence[float], apart: float) -> list[str]:
    """Return the ranks of rising errors: those that are less than `apart` above the first of a rank share it."""
    ranks: list[int] = []
    for k, error in enumerate(errors):
        ranks.append(ranks[-1] if ranks and error - errors[ranks[-1] - 1] < apart else k + 1)
    return [str(rank) for rank in ranks]


def _cell(row: Data, name: str) -> str:
    """Return a number of a row as text; of an error by two finer runs both."""
    return _by_two(row, name) or of_column(name).text(row[name])


def _by_two(row: Data, name: str) -> str:
    """Return the errors of a run against two finer runs, the first one's first; empty where not two judge it."""
    both = [row.get(path) for path in by_two(name)[:2]] if name in TRUE_ERRORS else []
    return " / ".join(map(percent, both)) if any(map(is_number, both[1:])) else ""


def _cases(done: Sequence[Data], error: str) -> Table:
    """Return one measure as a table with one line per pair of methods and one column per case."""
    value_of = {(row["case"], row["integrator"], row["contact"]): _cell(row, error) for row in done}
    cases = dict.fromkeys(case for case, *_ in value_of)
    pairs = list(dict.fromkeys((integrator, contact) for _, integrator, contact in value_of))
    columns = [Column(case, [value_of.get((case, *pair), "-") for pair in pairs]) for case in cases]
    return Table([words("integrator", (i for i, _ in pairs)), words("contact", (c for _, c in pairs)), *columns], error)


def stability_lines(title: str, rows: list[Entries]) -> Iterator[Piece]:
    """Yield critical Courant numbers: for each criterion the least and the largest, and a table of some lines."""
    criteria = list(dict.fromkeys(row["by"] for row in rows))
    paths = [key for key in rows[0] if "." in key or key == "refine"]
    extra_columns = [key for key in ("margin", "theta", "flutter") if any(key in row for row in rows)]
    lines: dict[tuple[object, ...], Entries] = {}
    for row in rows:
        lines.setdefault(tuple(row[path] for path in paths), {})[row["by"]] = row
    shown = list(lines)[:: math.ceil(len(lines) / STABILITY_LINES)]  # evenly spread
    columns = [Column(path, [number_text(values[k]) for values in shown]) for k, path in enumerate(paths)]
    for criterion in criteria:
        found = [lines[values].get(criterion) for values in shown]
        cells = [number_text(row["courant_critical"]) if row is not None else "-" for row in found]
        columns.append(Column(f"C critical, {criterion}", cells))
    for key in extra_columns:
        given = [[row[key] for row in lines[values].values() if row.get(key) is not None] for values in shown]
        columns.append(Column(key, [number_text(numbers[0] if numbers else None) for numbers in given]))
    yield Table(columns, title)
    if len(shown) < len(lines):
        yield f"{len(shown)} of {len(lines)} combinations: -o FILE.csv saves every one, --json prints them"
    reasons = Counter(f"{row['by']}: {row['reason']}" for row in rows if row["reason"])
    for reason, count in reasons.most_common(STABILITY_REASONS):
        yield f"{f'{count} times ' if count > 1 else ''}{reason}"
    if any(row.get("flutter") for row in rows):
        yield f"flutter: how fast the equations themselves grow while all points with friction slide; {NO_STEP}"
    for criterion in criteria:
        yield _summary_of(criterion, [row for row in rows if row["by"] == criterion], paths)


def _summary_of(criterion: str, rows: list[Entries], paths: list[str]) -> str:
    """Return the least and the largest critical Courant number by a criterion, and where they are, in words."""
    found = [row for row in rows if row["courant_critical"] is not None]
    if not found:
        return f"{criterion}: no critical Courant number in {len(rows)} combinations"

    def with_place(row: Entries) -> str:
        place = ", ".join(f"{path} {number_text(row[path])}" for path in paths)
        return f"{number_text(row['courant_critical'])}{place and f' (at {place})'}"

    least, largest = (choose(found, key=lambda row: row["courant_critical"]) for choose in (min, max))
    values = f" = {with_place(least)}" if least is largest else f" from {with_place(least)} to {with_place(largest)}"
    words = f"{criterion}: C critical{values}"
    if judged := [row for row in found if row.get("margin") is not None]:
        stable = sum(row["margin"] <= 1.0 for row in judged)
        words += f"; the step is at most the critical one in {stable} of {len(judged)}"
    missing = len(rows) - len(found)
    return words + (f"; no number in {missing} of {len(rows)}" if missing else "")


def waves_lines(title: str, waves: Waves) -> Iterator[Piece]:
    """Yield the reflection and transmission of waves at about twenty frequencies."""
    rows = waves.rows()
    rows = rows[:: max(1, len(rows) // 20)]
    heads = {
        "omega h/c": "frequency",
        "reflected": "reflection",
        "transmitted": "transmission",
        "by formula": "formula",
        "energy that leaves again": "energy_kept",
    }
    yield Table([Column(head, [number_text(row[key], 5) for row in rows]) for head, key in heads.items()], title)
    if waves.reason:
        yield waves.reason
    low, high = percent(waves.kept.min()), percent(waves.kept.max())
    yield f"Of the energy of a wave, {low} to {high} leaves the contact again."


def check_lines(cases: list[Entries]) -> Iterator[Piece]:
    """Yield the checks of each case with the measured and the expected value, and the number of cases that passed."""
    for case in cases:
        mark = ("passed", "green") if case["passed"] else ("FAILED", "red")
        yield mark, " ", (case["case"], "bold"), f" {case['title']}"
        if case["error"]:
            yield f"  {case['error']}"
        for check in case["checks"]:
            sign, measured = "ok" if check["passed"] else "FAIL", check["why"] or number_text(check["measured"])
            expected = f"expected {check['expected']:.6g} within {check['within']:.3g} ({check['source']})"
            yield f"  {sign:4} {check['what']}: {measured}, {expected}"
    passed = sum(case["passed"] for case in cases)
    yield f"{passed} of {len(cases)} cases passed"


def rerun_lines(reruns: Sequence[Rerun]) -> Iterator[Piece]:
    """Yield of each result whether its bits agree, where they differ, and what has changed since it was made."""
    for rerun in reruns:
        mark = ("the same bits", "green") if rerun.passed else ("DIFFERS", "red")
        yield mark, " ", (rerun.path, "bold"), f" {rerun.title}"
        if rerun.error:
            yield f"  {rerun.error}"
        yield from (f"  {_difference_words(difference)}" for difference in rerun.differences)
        for change in rerun.changes:
            yield f"  changed since: {change.what}: {_shortened(change.then)}, now {_shortened(change.now)}"
        if not rerun.passed and not rerun.changes:
            yield "  nothing that percuss records has changed: on one machine that should give the same bits"
    passed = sum(rerun.passed for rerun in reruns)
    yield f"{passed} of {len(reruns)} made again to the last bit"


def _difference_words(difference: Difference) -> str:
    """Return a difference in words."""
    of = f" of {difference.of}" if difference.of else ""
    when = "" if difference.time is None else f" from t = {difference.time:.9g} on"
    then, now = ("none" if value is None else str(value) for value in (difference.then, difference.now))
    words = f"{difference.quantity}{of}{when}: {then}, now {now}"
    if difference.largest is None or difference.time is None:
        return words
    return f"{words}; at most {difference.largest:.3g} apart"


def _shortened(value: str | None) -> str:
    """Return a text in which a digest has its first digits alone."""
    words = (word[:12] if len(word) == 64 else word for word in (value or "none").split(" "))
    return " ".join(words)
