"""Printing of a recommendation on a terminal."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Any

from percuss.case.quantities import METRICS
from percuss.case.yaml_text import flow
from percuss.reporting.tables import Column, plain_text, print_table
from percuss.reporting.tables import console as console_of_output

if TYPE_CHECKING:
    from percuss.studies.recommendation import Bounds, Recommendation, Tried

MOST_REASONS = 5
INDENT = "  "


def tell_recommendation(found: Recommendation) -> None:
    """Print what was tried, the recommendation with what it says in a case, what came second, and the Pareto front."""
    console = console_of_output()
    done = [one for one in found.tried if one.status == "done"]
    pairs = len({one.candidate.pair for one in done})
    marches = sum(one.seconds or 0.0 for one in done)
    console.print(
        f"[bold]{plain_text(found.study.title)}[/bold]: {plain_text(bounds_in_words(found.bounds))}: {len(done)} runs "
        f"of {pairs} pairs, whose marches took {marches:.3g} s"
    )
    console.print(f"the error is {plain_text(error_in_words(found))}")
    if found.untried:
        console.print(f"{found.untried} pairs were not tried: --runs allows no more")
    if found.left:
        console.print(f"{found.left} choices of methods, options and step are not settled: --runs allows no more")
    if found.best is not None:
        _print_best(console, found, found.best)
    elif found.nearest is not None:
        console.print(f"no run meets that; the nearest is {plain_text(in_words(found.nearest))}", soft_wrap=True)
    else:
        console.print("no run meets that, and none has the numbers that are bounded")
    _print_front(console, found)
    reasons = Counter((one.status, one.reason.split("\n")[0]) for one in found.tried if one.status != "done")
    for (status, reason), count in reasons.most_common(MOST_REASONS):
        console.print(f"{count} {status}: {plain_text(reason)}", soft_wrap=True)
    if len(reasons) > MOST_REASONS:
        console.print(f"and {len(reasons) - MOST_REASONS} other reasons")
    if found.refused:
        pairs_refused = "; ".join(f"{integrator} + {contact}" for integrator, contact in found.refused)
        console.print(f"refused, with reasons in --json: {plain_text(pairs_refused)}", soft_wrap=True)
    console.print(f"runs: {plain_text(str(found.study.path))}", soft_wrap=True)


def bounds_in_words(bounds: Bounds) -> str:
    """Return what was asked, in words."""
    parts = []
    if bounds.error is not None:
        parts.append(f"{METRICS[bounds.measure].label} of at most {100 * bounds.error:.4g} %")
    if bounds.energy is not None:
        parts.append(f"energy kept to {100 * bounds.energy:.4g} %")
    if bounds.seconds is not None:
        parts.append(f"a march of at most {bounds.seconds:.4g} s")
    return ", ".join(parts)


def error_in_words(found: Recommendation) -> str:
    """Return how the errors are known, in words."""
    if found.estimated:
        return (
            "an estimate: what a mesh twice as fine changes of peak force and impulse, as no exact solution covers "
            "the case"
        )
    return f"true, against the exact solution: {METRICS[found.bounds.measure].metric}"


def in_words(one: Tried) -> str:
    """Return a run in one line: methods, options, mesh, step, and its numbers."""
    numbers = [
        f"error {100 * one.error:.3g} %" if one.error is not None else "",
        f"energy {100 * one.energy:.2g} %" if one.energy is not None else "",
        f"{one.evaluations:.3g} node evaluations",
        f"{1e3 * one.seconds:.3g} ms" if one.seconds is not None else "",
    ]
    return f"{methods_in_words(one)}: {', '.join(filter(None, numbers))}"


def methods_in_words(one: Tried) -> str:
    """Return methods, options, mesh and step of a run."""
    candidate = one.candidate
    names = [
        f"{name} {flow(dict(options))}" if options else name
        for name, options in (
            (candidate.integrator, candidate.integrator_options),
            (candidate.contact, candidate.contact_options),
        )
    ]
    return f"{' + '.join(names)}, refine {candidate.refine:g}, Courant number {candidate.courant:g}"


def _print_best(console: Any, found: Recommendation, best: Tried) -> None:
    console.print(f"[bold]cheapest:[/bold] {plain_text(in_words(best))}", soft_wrap=True)
    changes = best.candidate.changes
    method = {name: changes[f"method.{name}"] for name in ("integrator", "contact")}
    lines = ["method:", *(f"{INDENT}{name}: {flow(value)}" for name, value in method.items())]
    lines += [f"refine: {best.candidate.refine:g}", f"time: {{courant: {best.candidate.courant:g}}}"]
    for line in lines:
        console.print(f"{INDENT}{plain_text(line)}", soft_wrap=True)
    command = found.study.command(best.key)
    if command is not None:
        console.print(f"{INDENT}{plain_text(command)}", soft_wrap=True)
    if best.stable != "yes":
        console.print(f"its certificate says {best.stable}: that it is stable is known from this run alone")
    console.print(f"of its {found.beside} neighbours none is cheaper and meets the bounds")
    if found.unsettled:
        console.print(f"{found.unsettled} other neighbours were not tried: give more --runs")
    if found.second is not None:
        console.print(f"[bold]second:[/bold] {plain_text(in_words(found.second))}", soft_wrap=True)
    else:
        console.print("no run of another pair meets the bounds")


def _print_front(console: Any, found: Recommendation) -> None:
    front = found.front
    if not front:
        return
    columns = [
        Column("methods", [methods_in_words(one) for one in front], is_number=False),
        Column("error", [_share(one.error) for one in front]),
        Column("energy", [_share(one.energy) for one in front], drop=1),
        Column("node evaluations", [f"{one.evaluations:.3g}" for one in front]),
        Column("ms", [f"{1e3 * one.seconds:.3g}" if one.seconds is not None else "-" for one in front], drop=2),
    ]
    print_table(console, columns, "none is both cheaper and nearer to the bounds")


def _share(value: float | None) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{100 * value:.3g} %"
