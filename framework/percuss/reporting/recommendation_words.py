"""What is printed of a recommendation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from percuss.case.quantities import JUDGED_BY, METRICS, percent
from percuss.case.yaml_text import flow
from percuss.reporting.tables import Column, Piece, Table, Unbroken, words
from percuss.reporting.verdict import error_text, failures

if TYPE_CHECKING:
    from percuss.studies.recommendation import Bounds, Recommendation, Tried

INDENT = "  "
# What is known of a recommended run beside a certificate that does not say yes.
STABILITY = {
    "marginal": ", and the pair guarantees that energy never grows",
    "unknown": ": only this run shows that it is stable",
}


def recommendation_lines(found: Recommendation) -> Iterator[Piece]:
    """Yield what was tried, the Pareto front, and what the recommendation is in a case and as a command."""
    done = [one for one in found.tried if one.status == "done"]
    pairs = len({one.candidate.pair for one in done})
    marches = sum(one.seconds or 0.0 for one in done)
    tried = f"{len(done)} runs of {pairs} pairs, whose marches took {marches:.3g} s"
    yield (found.study.title, "bold"), f": {bounds_in_words(found.bounds)}: {tried}"
    yield f"the error is {error_in_words(found)}"
    if front := found.front:
        columns = [
            words("methods", map(methods_in_words, front)),
            Column("error", [error_text(one.error, one.both) for one in front]),
            Column("energy", [percent(one.energy) for one in front]),
            Column("node evaluations", [f"{one.evaluations:.3g}" for one in front]),
            Column("ms", [f"{1e3 * one.seconds:.3g}" if one.seconds is not None else "-" for one in front]),
        ]
        yield Table(columns, "no run is both cheaper and nearer to the bounds")
    if found.refused:
        yield f"{len(found.refused)} pairs are refused; --json has the reasons"
    yield Unbroken(f"runs: {found.study.path}")
    if found.best is not None:
        yield "in a case:"
        yield from (Unbroken(f"{INDENT}{line}") for line in _in_case(found, found.best))


def recommendation_verdict(found: Recommendation) -> Iterator[str]:
    """Yield the cheapest run that meets the bounds, what came second, and what was not tried."""
    yield from failures((one.status, one.reason, " + ".join(one.candidate.pair)) for one in found.tried)
    if found.untried:
        yield f"Pairs that were not tried, as --runs allows no more: {found.untried}."
    if found.left:
        yield f"Choices of methods, options and step that were not tried, as --runs allows no more: {found.left}."
    if found.best is None:
        nearest = f"the nearest is {in_words(found.nearest)}" if found.nearest else "none has the bounded numbers"
        why = f" (the error is not known: {found.unjudged})" if found.unjudged else ""
        yield f"No run meets the bounds; {nearest}{why}."
        return
    others = f" (not tried: {found.unsettled})" if found.unsettled else ""
    yield f"None of {found.beside} neighbours of the best is cheaper and meets the bounds{others}."
    yield f"Second: {in_words(found.second)}." if found.second else "No run of another pair meets the bounds."
    yield f"Cheapest: {in_words(found.best)}."


def bounds_in_words(bounds: Bounds) -> str:
    """Return what was asked, in words."""
    parts = []
    if bounds.error is not None:
        parts.append(f"{METRICS[bounds.measure].label} of at most {percent(bounds.error, 4)}")
    kept = "kept to" if bounds.energy is not None else "grown by at most"
    parts.append(f"energy {kept} {percent(bounds.growth, 4)}")
    if bounds.seconds is not None:
        parts.append(f"a march of at most {bounds.seconds:.4g} s")
    return ", ".join(parts)


def error_in_words(found: Recommendation) -> str:
    """Return how the errors are known, in words."""
    judges = dict.fromkeys(str(row[JUDGED_BY]) for row in found.study.as_records() if row.get(JUDGED_BY))
    runs = "the larger one against two finer runs" if any(one.both for one in found.tried) else "against a finer run"
    judge = f"an estimate, {runs} ({'; '.join(judges)})" if judges else "true, against the exact solution"
    return f"{judge}: {METRICS[found.bounds.measure].metric}"


def in_words(one: Tried) -> str:
    """Return a run in one line: methods, options, mesh, step, and its numbers."""
    numbers = [
        f"error {error_text(one.error, one.both)}" if one.error is not None else "",
        f"energy {percent(one.energy, 2)}" if one.energy is not None else "",
        f"{one.evaluations:.3g} node evaluations",
        f"{1e3 * one.seconds:.3g} ms" if one.seconds is not None else "",
        f"the certificate says {one.stable}{STABILITY[one.stable]}" if one.stable in STABILITY else "",
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
    names[1:] = [f"{names[1]}, {candidate.pairing}" if candidate.pairing else names[1]]
    return f"{' + '.join(names)}, refine {candidate.refine:g}, Courant number {candidate.courant:g}"


def _in_case(found: Recommendation, best: Tried) -> Iterator[str]:
    """Yield what the best run says in a case, and the command that makes it."""
    yield "method:"
    changes = {path: value for path, value in best.candidate.changes.items() if path.startswith("method.")}
    yield from (f"{INDENT}{path.removeprefix('method.')}: {flow(value)}" for path, value in changes.items())
    yield f"refine: {best.candidate.refine:g}"
    yield f"time: {{courant: {best.candidate.courant:g}}}"
    if (command := found.study.command(best.key)) is not None:
        yield command
