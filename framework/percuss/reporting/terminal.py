"""Printing of results, comparisons, checks and plug-ins as tables on a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from percuss import version
from percuss.case.quantities import COMPARISON_TABLE, CONTACT_NUMBERS, METRICS, QUANTITIES, TRUE_ERRORS
from percuss.methods.admission import OLDEST
from percuss.results.ledger import ledger_words
from percuss.studies.comparison import Run, metrics

if TYPE_CHECKING:
    from percuss.certificate.waves import Waves
    from percuss.methods.registry import Registry
    from percuss.results.exact_result import ExactSolutionResult
    from percuss.results.result import Result
    from percuss.results.summary import Summary


def _number(value: Any, digits: int = 6) -> str:
    if value is None:
        return "-"
    return f"{value:.{digits}g}" if isinstance(value, float) else escape(str(value))


def _console() -> Console:
    console = Console(highlight=False)
    # Piped output is read by programs and pasted into notes, so it is made wide enough that no name is cut.
    return console if console.is_terminal else Console(highlight=False, width=400)


def tell_result(result: Result) -> None:
    """Print a run: status, step, notes, contacts, true errors, energy ledger and momentum balance."""
    summary = result.summary
    resolved = result.provenance["resolved"]
    console = _console()
    console.print(f"[bold]{escape(result.title or 'untitled case')}[/bold]: {summary['status']}")
    console.print(
        f"{resolved['integrator']}, "
        f"{summary['steps']} steps of {summary['dt']:.6g} (Courant number {summary['courant']:.4g}), "
        f"{'compiled' if summary['compiled'] else 'plain Python'}, marched in {summary['seconds']['march']:.3g} s"
    )
    for note in summary["notes"]:
        console.print(f"  note: {escape(note)}")
    for reason in summary["compiled_why"]:
        console.print(f"  not compiled: {escape(reason)}")
    if summary["status"] == "unstable" and summary["steps"] == 0:
        return
    laws = {}
    for name, law in resolved["contacts"].items():
        options = ", ".join(
            f"{key} {_number(law[key], 4)}" for key in resolved.get("headline", {}).get(name, ()) if key in law
        )
        laws[name] = f"{law['law']}{f' ({options})' if options else ''}"
    depths = {name: contact["penetration"]["largest"] for name, contact in summary["contacts"].items()}
    _print_contacts(console, summary["contacts"], laws, depths)
    _print_errors(console, summary)
    _print_balances(console, summary, summary["energy"]["contact_work"])


def tell_exact(result: ExactSolutionResult) -> None:
    """Print an exact solution: how far it holds, notes, contacts, and the balances of energy and momentum."""
    summary, console = result.summary, _console()
    console.print(f"[bold]{escape(result.title or 'untitled case')}[/bold]: {result.status}")
    console.print(escape(result.solution_name))
    for note in summary["notes"]:
        console.print(f"  note: {escape(note)}")
    # Exact contacts do not overlap and do no work; the table has the columns of a run, so that both are read alike.
    contacts = summary["contacts"]
    _print_contacts(console, contacts, dict.fromkeys(contacts, "exact"), dict.fromkeys(contacts, 0.0))
    if summary["exact_reason"]:
        console.print(f"exact solution: {escape(summary['exact_reason'])}")
    _print_balances(console, summary, 0.0)


def _print_contacts(
    console: Console, contacts: dict[str, Any], laws: dict[str, str], penetrations: dict[str, float]
) -> None:
    """Print the table of contacts with their laws and penetrations, which are given by name."""
    table = Table("contact", "law", *(quantity.head for quantity in CONTACT_NUMBERS.values()))
    for name, contact in contacts.items():
        table.add_row(
            escape(name),
            laws[name],
            *(
                _number(penetrations[name], 3) if quantity.is_error else _number(quantity.of_contact(contact))
                for quantity in CONTACT_NUMBERS.values()
            ),
        )
    if contacts:
        console.print(table)


def _print_balances(console: Console, summary: Mapping[str, Any], contact_work: float) -> None:
    """Print the energies and works, and how well they and the momentum balance."""
    energy, momentum = summary["energy"], summary["momentum"]
    console.print(
        f"energy {_number(energy['initial'])} at first, {_number(energy['final'])} at last, "
        f"{_number(energy['max'])} at most; "
        f"external work {_number(energy['external_work'])}, contact work {_number(contact_work, 4)}; "
        f"{ledger_words(energy, format(energy['ledger_error'], '.1e'), 'closed')}"
    )
    balance = "do NOT balance: off by" if momentum.get("balanced") is False else "balance to"
    console.print(f"momentum and impulses {balance} {momentum['error']:.1e}")


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
                f"{quantity.head} {_number(measured[key], 3)}"
                for key, quantity in METRICS.items()
                if quantity.against_exact and key in measured
            )
            console.print(f"{'true ' if not until else ''}error of {escape(name)}{until}: {measures}")
    if summary["exact"] is not None and summary["exact"].get("fragile") is not None:
        sensitivity = (
            "hangs on round-off: a nudge of 1e-12 changes it"
            if summary["exact"]["fragile"]
            else "stands a nudge of 1e-12"
        )
        console.print(f"the contact force {sensitivity}")
    if summary["exact_reason"]:
        console.print(f"exact solution: {escape(summary['exact_reason'])}")


def tell_rows(title: str, rows: list[Run]) -> None:
    """Print the table of a comparison, one line per run, and below it the reason of each run that is not done."""
    console = _console()
    varied = list(dict.fromkeys(path for row in rows for path in row.varied))
    heads = ["integrator", "contact", *varied, "status", *(QUANTITIES[name].head for name in COMPARISON_TABLE), "s"]
    table = Table(*(escape(head) for head in heads), title=escape(title), caption="force, impulse, displ.: true errors")
    for row in rows:
        values = metrics(row) if row.status in {"done", "interrupted"} else {}
        keys = (*COMPARISON_TABLE, "seconds")
        cells = [_number(values.get(key), 3 if key in {*TRUE_ERRORS, "seconds", "penetration"} else 5) for key in keys]
        table.add_row(
            row.integrator, row.contact, *(_number(row.varied.get(path)) for path in varied), row.status, *cells
        )
    console.print(table)
    for row in rows:
        if row.reason:
            source = f" (says {row.said_by})" if row.said_by else ""
            console.print(f"[bold]{escape(row.label)}[/bold] {row.status}{escape(source)}: {escape(row.reason)}")


def tell_orders(orders: list[dict[str, Any]]) -> None:
    """Print the observed order of convergence of each error for each pair of methods."""
    console = _console()
    others = list(dict.fromkeys(path for fit in orders for path in fit if "." in path))
    heads = ["integrator", "contact", *others, "refine", *(QUANTITIES[name].label for name in TRUE_ERRORS)]
    table = Table(*(escape(head) for head in heads), title="observed orders of convergence")
    for fit in orders:
        cells = [_number(fit[f"{name}_order"], 3) for name in TRUE_ERRORS]
        refined = ", ".join(str(value) for value in fit["refine"])
        table.add_row(fit["integrator"], fit["contact"], *(_number(fit.get(path)) for path in others), refined, *cells)
    console.print(table)


def tell_stability(title: str, rows: list[dict[str, Any]]) -> None:
    """Print critical Courant numbers, one line per combination of varied values and one column per criterion."""
    console = _console()
    criteria = list(dict.fromkeys(row["by"] for row in rows))
    paths = [key for key in rows[0] if "." in key or key == "refine"]
    extra_columns = [key for key in ("margin", "theta") if any(key in row for row in rows)]
    table = Table(
        *(escape(path) for path in paths),
        *(f"C critical, {criterion}" for criterion in criteria),
        *extra_columns,
        title=escape(title),
    )
    lines: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in rows:
        lines.setdefault(tuple(row[path] for path in paths), {})[row["by"]] = row
    for values, row_of_criterion in lines.items():
        extras = {
            key: next((row[key] for row in row_of_criterion.values() if row.get(key) is not None), None)
            for key in extra_columns
        }
        cells = [
            _number(row_of_criterion[criterion]["courant_critical"]) if criterion in row_of_criterion else "-"
            for criterion in criteria
        ]
        table.add_row(*(_number(value) for value in values), *cells, *(_number(extras[key]) for key in extra_columns))
    console.print(table)
    for reason in dict.fromkeys(f"{row['by']}: {row['reason']}" for row in rows if row["reason"]):
        console.print(escape(reason))


def tell_waves(title: str, waves: Waves) -> None:
    """Print the reflection and transmission of waves at about twenty frequencies."""
    console = _console()
    table = Table(
        "omega h/c", "reflected", "transmitted", "by formula", "energy that leaves again", title=escape(title)
    )
    rows = waves.rows()
    for row in rows[:: max(1, len(rows) // 20)]:
        keys = ("frequency", "reflection", "transmission", "formula", "energy_kept")
        table.add_row(*(_number(row[key], 5) for key in keys))
    console.print(table)
    if waves.reason:
        console.print(escape(waves.reason))


def tell_checks(cases: list[dict[str, Any]]) -> None:
    """Print the checks of each case with the measured and the expected value, and the number of cases that passed."""
    console = _console()
    for case in cases:
        mark = "[green]passed[/green]" if case["passed"] else "[red]FAILED[/red]"
        console.print(f"{mark} [bold]{escape(case['case'])}[/bold] {escape(case['title'])}")
        if case["error"]:
            console.print(f"  {escape(case['error'])}")
        for check in case["checks"]:
            sign = "ok" if check["passed"] else "FAIL"
            measured = _number(check["measured"]) if not check["why"] else escape(check["why"])
            console.print(
                f"  {sign:4} {escape(check['what'])}: {measured}, "
                f"expected {check['expected']:.6g} within {check['within']:.3g} ({escape(check['source'])})"
            )
    passed = sum(case["passed"] for case in cases)
    console.print(f"{passed} of {len(cases)} cases passed")


def tell_registry(registry: Registry) -> None:
    """Print every registered component with its origin, and the plug-ins that are not usable with the reason."""
    console = _console()
    table = Table("family", "name", "what it is", "from", "file")
    for (family, name), component in registry.components.items():
        source = registry.sources[family, name]
        origin = f"{source.distribution} {source.version}".strip() if source.distribution else f"file {source.version}"
        origin += f", contract {component.contract_version}" if component.contract_version else ""
        table.add_row(family, name, escape(component.summary), escape(origin), escape(source.file))
    console.print(table)
    console.print(f"percuss {version.__version__}, contract {version.CONTRACT}; keeps contracts from {OLDEST} on")
    for broken in registry.broken:
        where = f" ({broken.file})" if broken.file else ""
        console.print(f"[red]not usable[/red] {escape(broken.source)}{escape(where)}: {escape(broken.error)}")
