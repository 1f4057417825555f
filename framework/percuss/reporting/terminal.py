"""Printing of results, comparisons, checks and plug-ins as tables on a terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Console

from percuss.case.quantities import (
    COMPARISON_TABLE,
    CONTACT_NUMBERS,
    METRICS,
    QUANTITIES,
    TRUE_ERRORS,
    percent,
    with_unit,
)
from percuss.reporting.tables import Column, plain_text, print_table
from percuss.reporting.tables import console as console_of_output
from percuss.results.ledger import ledger_words
from percuss.studies.comparison import metrics
from percuss.studies.perform import Run

if TYPE_CHECKING:
    from percuss.certificate.waves import Waves
    from percuss.jsonable import Data
    from percuss.results.result import Result
    from percuss.results.summary import Summary


STABILITY_LINES = 12  # most lines of the table of critical Courant numbers, unless the whole table is asked for
STABILITY_REASONS = 3  # most reasons below it


def _number(value: Any, digits: int = 6) -> str:
    if value is None:
        return "-"
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def tell_result(result: Result) -> None:
    """Print a result: status, methods and step, notes, contacts, true errors, energy ledger and momentum balance.

    Of the exact solution alone its name stands in place of methods and step, and how far it holds in place of errors.
    """
    summary, console = result.summary, console_of_output()
    console.print(f"[bold]{plain_text(result.title or 'untitled case')}[/bold]: {summary['status']}")
    if result.marched:
        console.print(
            f"{result.provenance['resolved']['integrator']}, "
            f"{summary['steps']} steps of {summary['dt']:.6g} (Courant number {summary['courant']:.4g}), "
            f"{'compiled' if summary['compiled'] else 'plain Python'}, marched in {summary['seconds']['march']:.3g} s"
        )
    else:
        console.print(plain_text(result.solution_name))
    for note in summary["notes"]:
        console.print(f"  note: {plain_text(note)}")
    for reason in summary.get("compiled_why", ()):
        console.print(f"  not compiled: {plain_text(reason)}")
    if summary["status"] == "unstable" and summary["steps"] == 0:
        return
    # Exact contacts do not overlap and do no work; the table has the columns of a run, so that both are read alike.
    contacts = summary["contacts"]
    depths = {name: contact["penetration"]["largest"] if result.marched else 0.0 for name, contact in contacts.items()}
    laws = _laws(result.provenance["resolved"]) if result.marched else dict.fromkeys(contacts, "exact")
    _print_contacts(console, contacts, laws, depths, result.units)
    if result.marched:
        _print_errors(console, summary)
    elif summary["exact_reason"]:
        console.print(f"exact solution: {plain_text(summary['exact_reason'])}")
    _print_balances(console, summary, summary["energy"].get("contact_work", 0.0))


def _laws(resolved: Data) -> dict[str, str]:
    """Return the law of each contact with its most important parameters."""
    laws = {}
    for name, law in resolved["contacts"].items():
        options = ", ".join(
            f"{key} {_number(law[key], 4)}" for key in resolved.get("headline", {}).get(name, ()) if key in law
        )
        laws[name] = f"{law['law']}{f' ({options})' if options else ''}"
    return laws


def _print_contacts(
    console: Console,
    contacts: Mapping[str, Data],
    laws: dict[str, str],
    penetrations: dict[str, float],
    units: Mapping[str, str],
) -> None:
    """Print the table of contacts with their laws and penetrations, which are given by name, and names of units."""
    columns = [
        Column("contact", list(contacts), is_number=False),
        Column("law", [laws[name] for name in contacts], is_number=False),
    ]
    for rank, quantity in enumerate(CONTACT_NUMBERS.values()):
        cells = [
            _number(penetrations[name], 3) if quantity.is_error else _number(quantity.of_contact(contact))
            for name, contact in contacts.items()
        ]
        columns.append(Column(with_unit(quantity.head, quantity.unit, units), cells, drop=rank or None))
    if contacts:
        print_table(console, columns)


def _print_balances(console: Console, summary: Mapping[str, Any], contact_work: float) -> None:
    """Print the energies and works, and how well they and the momentum balance."""
    energy, momentum = summary["energy"], summary["momentum"]
    console.print(
        f"energy {_number(energy['initial'])} at first, {_number(energy['final'])} at last, "
        f"{_number(energy['max'])} at most; "
        f"external work {_number(energy['external_work'])}, contact work {_number(contact_work, 4)}; "
        f"{ledger_words(energy)}"
    )
    balance = "do NOT balance: off by" if momentum.get("balanced") is False else "balance to"
    console.print(f"momentum and impulses {balance} {percent(momentum['error'], 2)}")


def _print_errors(console: Console, summary: Summary) -> None:
    """Print the errors of a run against the exact solution, or the reason why there is no exact solution.

    Where the exact solution ends before the run, the errors are printed with the time up to which they hold.
    """
    covered = summary.get("exact_covered")
    until = f" up to {_number(covered['until'])}, where the exact solution ends" if covered is not None else ""
    for comparison in (summary["exact"], covered):
        for name, error in comparison["contacts"].items() if comparison is not None else ():
            measured: Mapping[str, Any] = error
            measures = ", ".join(
                f"{quantity.head} {quantity.text(measured[key])}"
                for key, quantity in METRICS.items()
                if quantity.against_exact and key in measured
            )
            console.print(f"{'true ' if not until else ''}error of {plain_text(name)}{until}: {measures}")


def tell_rows(title: str, rows: list[Run]) -> None:
    """Print the table of a comparison, one line per run."""
    console = console_of_output()
    varied = list(dict.fromkeys(path for row in rows for path in row.varied))
    values = [metrics(row) if row.status in {"done", "interrupted"} else {} for row in rows]
    columns = [
        Column("integrator", [row.integrator for row in rows], is_number=False),
        Column("contact", [row.contact for row in rows], is_number=False),
        *(Column(path, [_number(row.varied.get(path)) for row in rows]) for path in varied),
        # The last numbers are left out first, and the state of the runs only after all that has nothing to say.
        Column("status", [row.status for row in rows], drop=0, is_number=False),
    ]
    for rank, key in enumerate((*COMPARISON_TABLE, "seconds")):
        digits = 3 if key in {*TRUE_ERRORS, "seconds", "penetration"} else 5
        quantity = QUANTITIES.get(key)
        head = quantity.head if quantity is not None else "s"
        cells = [(quantity.text if quantity is not None else _number)(of_row.get(key), digits) for of_row in values]
        columns.append(Column(head, cells, drop=1 + rank))
    print_table(console, columns, title)
    console.print("force, impulse, displ.: true errors")


def tell_orders(orders: list[dict[str, Any]]) -> None:
    """Print the observed order of convergence of each error for each pair of methods."""
    console = console_of_output()
    others = list(dict.fromkeys(path for fit in orders for path in fit if "." in path))
    columns = [
        Column("integrator", [fit["integrator"] for fit in orders], is_number=False),
        Column("contact", [fit["contact"] for fit in orders], is_number=False),
        *(Column(path, [_number(fit.get(path)) for fit in orders]) for path in others),
        Column("refine", [", ".join(map(str, fit["refine"])) for fit in orders], drop=9, is_number=False),
    ]
    for rank, name in enumerate(TRUE_ERRORS):
        cells = [_number(fit[f"{name}_order"], 3) for fit in orders]
        columns.append(Column(QUANTITIES[name].label, cells, drop=rank or None))
    print_table(console, columns, "observed orders of convergence")


def tell_stability(title: str, rows: list[dict[str, Any]], *, whole: bool = False) -> None:
    """Print critical Courant numbers: for each criterion the least and the largest, and a table of some lines.

    Parameters
    ----------
    title
        Title of the case.
    rows
        The rows of `percuss.stability`.
    whole
        Whether the table has a line for each combination of varied values, however many there are.
    """
    console = console_of_output()
    criteria = list(dict.fromkeys(row["by"] for row in rows))
    paths = [key for key in rows[0] if "." in key or key == "refine"]
    extra_columns = [key for key in ("margin", "theta") if any(key in row for row in rows)]
    lines: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in rows:
        lines.setdefault(tuple(row[path] for path in paths), {})[row["by"]] = row
    shown = list(lines) if whole or len(lines) <= STABILITY_LINES else _telling_lines(lines)
    columns = [Column(path, [_number(values[k]) for values in shown]) for k, path in enumerate(paths)]
    for criterion in criteria:
        found = [lines[values].get(criterion) for values in shown]
        cells = [_number(row["courant_critical"]) if row is not None else "-" for row in found]
        columns.append(Column(f"C critical, {criterion}", cells))
    for rank, key in enumerate(extra_columns):
        given = [[row[key] for row in lines[values].values() if row.get(key) is not None] for values in shown]
        columns.append(Column(key, [_number(numbers[0] if numbers else None) for numbers in given], drop=rank))
    print_table(console, columns, title)
    if len(shown) < len(lines):
        console.print(f"{len(shown)} of {len(lines)} combinations: --all prints every one, -o FILE.csv saves them")
    reasons = Counter(f"{row['by']}: {row['reason']}" for row in rows if row["reason"])
    for reason, count in list(reasons.items())[: None if whole else STABILITY_REASONS]:
        console.print(f"{f'{count} times ' if count > 1 else ''}{plain_text(reason)}")
    if not whole and len(reasons) > STABILITY_REASONS:
        console.print(f"and {len(reasons) - STABILITY_REASONS} other reasons: --all prints them")
    for criterion in criteria:
        console.print(_summary_of(criterion, [row for row in rows if row["by"] == criterion], paths), markup=False)


def _telling_lines(lines: Mapping[tuple[Any, ...], Mapping[str, Any]]) -> list[tuple[Any, ...]]:
    """Return the combinations to be shown of many: evenly spread, with the least and the largest critical step."""
    values = list(lines)
    count = STABILITY_LINES - 4
    chosen = {round(k * (len(values) - 1) / (count - 1)) for k in range(count)}
    numbers = [
        (row["courant_critical"], k)
        for k, by_criterion in enumerate(lines.values())
        for row in by_criterion.values()
        if row["courant_critical"] is not None
    ]
    if numbers:
        chosen |= {min(numbers)[1], max(numbers)[1]}
    return [values[k] for k in sorted(chosen)]


def _summary_of(criterion: str, rows: list[dict[str, Any]], paths: list[str]) -> str:
    """Return the least and the largest critical Courant number by a criterion, and where they are, in words."""
    found = [row for row in rows if row["courant_critical"] is not None]
    if not found:
        return f"{criterion}: no critical Courant number in {len(rows)} combinations"

    def with_place(row: dict[str, Any]) -> str:
        place = ", ".join(f"{path} {_number(row[path])}" for path in paths)
        return f"{_number(row['courant_critical'])}{place and f' (at {place})'}"

    least, largest = (choose(found, key=lambda row: row["courant_critical"]) for choose in (min, max))
    values = f" = {with_place(least)}" if least is largest else f" from {with_place(least)} to {with_place(largest)}"
    words = f"{criterion}: C critical{values}"
    if judged := [row for row in found if row.get("margin") is not None]:
        stable = sum(row["margin"] <= 1.0 for row in judged)
        words += f"; the step is at most the critical one in {stable} of {len(judged)}"
    missing = len(rows) - len(found)
    return words + (f"; no number in {missing} of {len(rows)}" if missing else "")


def tell_waves(title: str, waves: Waves) -> None:
    """Print the reflection and transmission of waves at about twenty frequencies."""
    console = console_of_output()
    rows = waves.rows()
    rows = rows[:: max(1, len(rows) // 20)]
    heads = {
        "omega h/c": "frequency",
        "reflected": "reflection",
        "transmitted": "transmission",
        "by formula": "formula",
        "energy that leaves again": "energy_kept",
    }
    columns = [
        Column(head, [_number(row[key], 5) for row in rows], drop=rank or None)
        for rank, (head, key) in enumerate(heads.items())
    ]
    print_table(console, columns, title)
    if waves.reason:
        console.print(plain_text(waves.reason))
    kept, passed = waves.kept, abs(waves.transmitted)
    verdict = f"Of the energy of a wave, {percent(kept.min())} to {percent(kept.max())} leaves the contact again"
    if passed.any():
        amplitude = (
            f"{percent(passed[0])} of the amplitude at the lowest frequency and {percent(passed[-1])} at the highest"
        )
        verdict = f"The second bar receives {amplitude}. {verdict}"
    console.print(f"{verdict}.")


def tell_checks(cases: list[dict[str, Any]]) -> None:
    """Print the checks of each case with the measured and the expected value, and the number of cases that passed."""
    console = console_of_output()
    for case in cases:
        mark = "[green]passed[/green]" if case["passed"] else "[red]FAILED[/red]"
        console.print(f"{mark} [bold]{plain_text(case['case'])}[/bold] {plain_text(case['title'])}")
        if case["error"]:
            console.print(f"  {plain_text(case['error'])}")
        for check in case["checks"]:
            sign = "ok" if check["passed"] else "FAIL"
            measured = _number(check["measured"]) if not check["why"] else plain_text(check["why"])
            console.print(
                f"  {sign:4} {plain_text(check['what'])}: {measured}, "
                f"expected {check['expected']:.6g} within {check['within']:.3g} ({plain_text(check['source'])})"
            )
    passed = sum(case["passed"] for case in cases)
    console.print(f"{passed} of {len(cases)} cases passed")
