"""Results, comparisons, checks and plug-ins as tables on a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

import percuss
from percuss.methods.admission import OLDEST
from percuss.reporting.convergence_figure import WORDS
from percuss.results.ledger import ledger_words
from percuss.studies.comparison import ERRORS, Row, metrics

if TYPE_CHECKING:
    from percuss.certificate.waves import Waves
    from percuss.methods.registry import Registry
    from percuss.results.result import Result


def _number(value: Any, digits: int = 6) -> str:
    if value is None:
        return "-"
    return f"{value:.{digits}g}" if isinstance(value, float) else escape(str(value))


def _console() -> Console:
    console = Console(highlight=False)
    # piped output is read by programs and pasted into notes: wide enough that no name is cut
    return console if console.is_terminal else Console(highlight=False, width=400)


def tell_result(result: Result) -> None:
    """Print what a run gave."""
    s = result.summary
    resolved = result.provenance["resolved"]
    console = _console()
    console.print(f"[bold]{escape(result.title or 'untitled case')}[/bold]: {s['status']}")
    step = (
        ""
        if s["dt"] is None
        else (
            f"{s['steps']} steps of {s['dt']:.6g} (Courant number {s['courant']:.4g}), "
            f"{'compiled' if s['compiled'] else 'plain Python'}, marched in {s['seconds']['march']:.3g} s"
        )
    )
    console.print(f"{resolved['integrator']}{', ' if step else ''}{step}")
    for note in s["notes"]:
        console.print(f"  note: {escape(note)}")
    for why in s["compiled_why"]:
        console.print(f"  not compiled: {escape(why)}")
    if s["status"] == "unstable" and s["steps"] == 0:
        return
    table = Table("contact", "law", "impulse", "peak force", "closed at", "open at", "closed for", "penetration")
    for name, c in s["contacts"].items():
        law = resolved["contacts"][name]
        options = ", ".join(f"{k} {_number(law[k], 4)}" for k in resolved.get("headline", {}).get(name, ()) if k in law)
        table.add_row(
            escape(name),
            f"{law['law']}{f' ({options})' if options else ''}",
            *(_number(c[k]) for k in ("impulse", "peak_force", "first_closed", "last_open", "closed_time")),
            _number(c["penetration"]["largest"], 3),
        )
    if s["contacts"]:
        console.print(table)
    _tell_errors(console, s)
    e = s["energy"]
    console.print(
        f"energy {_number(e['initial'])} at first, {_number(e['final'])} at last, {_number(e['max'])} at most; "
        f"external work {_number(e['external_work'])}, contact work {_number(e['contact_work'], 4)}; "
        f"{ledger_words(e, format(e['ledger_error'], '.1e'), 'closed')}"
    )
    m = s["momentum"]
    balance = "do NOT balance: off by" if m.get("balanced") is False else "balance to"
    console.print(f"momentum and impulses {balance} {m['error']:.1e}")


def _tell_errors(console: Console, s: dict[str, Any]) -> None:
    """Print the true errors of a run, or why there are none; those of a part of it as such."""
    covered = s.get("exact_covered")
    until = f" up to {_number(covered['until'])}, where the exact solution ends" if covered is not None else ""
    for known in (s["exact"], covered):
        for name, error in known["contacts"].items() if known is not None else ():
            told = ", ".join(
                f"{word} {_number(error[key], 3)}"
                for word, key in (
                    ("L1", "force_error_l1"),
                    ("L2", "force_error_l2"),
                    ("impulse", "impulse_error"),
                    ("noise", "noise"),
                    ("overshoot", "overshoot"),
                )
            )
            console.print(f"{'true ' if not until else ''}error of {escape(name)}{until}: {told}")
    if s["exact"] is not None and s["exact"].get("fragile") is not None:
        hangs = (
            "hangs on round-off: a nudge of 1e-12 changes it" if s["exact"]["fragile"] else "stands a nudge of 1e-12"
        )
        console.print(f"the contact force {hangs}")
    if s["exact_reason"]:
        console.print(f"exact solution: {escape(s['exact_reason'])}")


def tell_rows(title: str, rows: list[Row]) -> None:
    """Print a comparison: a line a row, and below it why rows have no numbers."""
    console = _console()
    varied = list(dict.fromkeys(path for row in rows for path in row.varied))
    heads = ["integrator", "contact", *varied, "status", "force L1", "force L2", "impulse", "displ."]
    heads += ["peak force", "penetration", "energy kept", "largest energy", "steps", "s"]
    table = Table(*(escape(h) for h in heads), title=escape(title), caption="force, impulse, displ.: true errors")
    for row in rows:
        m = metrics(row) if row.status in {"done", "interrupted"} else {}
        keys = (*ERRORS, "peak_force", "penetration", "energy_kept", "energy_max", "steps", "seconds")
        cells = [_number(m.get(k), 3 if k in {*ERRORS, "seconds", "penetration"} else 5) for k in keys]
        table.add_row(row.integrator, row.contact, *(_number(row.varied.get(p)) for p in varied), row.status, *cells)
    console.print(table)
    for row in rows:
        if row.reason:
            said = f" (says {row.said_by})" if row.said_by else ""
            console.print(f"[bold]{escape(row.label)}[/bold] {row.status}{escape(said)}: {escape(row.reason)}")


def tell_orders(orders: list[dict[str, Any]]) -> None:
    """Print the observed order of each error for each method."""
    console = _console()
    others = list(dict.fromkeys(path for one in orders for path in one if "." in path))
    heads = ["integrator", "contact", *others, "refine", *WORDS.values()]
    table = Table(*(escape(h) for h in heads), title="observed orders of convergence")
    for one in orders:
        cells = [_number(one[f"{name}_order"], 3) for name in WORDS]
        refined = ", ".join(str(value) for value in one["refine"])
        table.add_row(one["integrator"], one["contact"], *(_number(one.get(p)) for p in others), refined, *cells)
    console.print(table)


def tell_stability(title: str, rows: list[dict[str, Any]]) -> None:
    """Print critical Courant numbers, a line a combination and a column a way to judge."""
    console = _console()
    ways = list(dict.fromkeys(row["by"] for row in rows))
    paths = [key for key in rows[0] if "." in key or key == "refine"]
    told = [key for key in ("margin", "theta") if any(key in row for row in rows)]
    table = Table(*(escape(p) for p in paths), *(f"C critical, {way}" for way in ways), *told, title=escape(title))
    lines: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in rows:
        lines.setdefault(tuple(row[p] for p in paths), {})[row["by"]] = row
    for values, by in lines.items():
        known = {key: next((row[key] for row in by.values() if row.get(key) is not None), None) for key in told}
        cells = [_number(by[way]["courant_critical"]) if way in by else "-" for way in ways]
        table.add_row(*(_number(v) for v in values), *cells, *(_number(known[key]) for key in told))
    console.print(table)
    for reason in dict.fromkeys(f"{row['by']}: {row['reason']}" for row in rows if row["reason"]):
        console.print(escape(reason))


def tell_waves(title: str, found: Waves) -> None:
    """Print reflection and transmission at some frequencies."""
    console = _console()
    table = Table(
        "omega h/c", "reflected", "transmitted", "by formula", "energy that leaves again", title=escape(title)
    )
    rows = found.rows()
    for row in rows[:: max(1, len(rows) // 20)]:
        keys = ("frequency", "reflection", "transmission", "formula", "energy_kept")
        table.add_row(*(_number(row[key], 5) for key in keys))
    console.print(table)
    if found.reason:
        console.print(escape(found.reason))


def tell_checks(told: list[dict[str, Any]]) -> None:
    """Print what cases expected and what came out."""
    console = _console()
    for one in told:
        mark = "[green]passed[/green]" if one["passed"] else "[red]FAILED[/red]"
        console.print(f"{mark} [bold]{escape(one['case'])}[/bold] {escape(one['title'])}")
        if one["error"]:
            console.print(f"  {escape(one['error'])}")
        for c in one["checks"]:
            sign = "ok" if c["passed"] else "FAIL"
            found = _number(c["measured"]) if not c["why"] else escape(c["why"])
            console.print(
                f"  {sign:4} {escape(c['what'])}: {found}, expected {c['expected']:.6g} within {c['within']:.3g} "
                f"({escape(c['source'])})"
            )
    good = sum(one["passed"] for one in told)
    console.print(f"{good} of {len(told)} cases passed")


def tell_registry(registry: Registry) -> None:
    """Print every component with its source, and the plug-ins that failed."""
    console = _console()
    table = Table("family", "name", "what it is", "from", "file")
    for (family, name), component in registry.components.items():
        source = registry.sources[family, name]
        origin = f"{source.distribution} {source.version}".strip() if source.distribution else f"file {source.version}"
        origin += f", contract {component.contract_version}" if component.contract_version else ""
        table.add_row(family, name, escape(component.summary), escape(origin), escape(source.file))
    console.print(table)
    console.print(f"percuss {percuss.__version__}, contract {percuss.CONTRACT}; keeps contracts from {OLDEST} on")
    for broken in registry.broken:
        where = f" ({broken.file})" if broken.file else ""
        console.print(f"[red]not usable[/red] {escape(broken.source)}{escape(where)}: {escape(broken.error)}")
