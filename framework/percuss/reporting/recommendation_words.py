"""What is printed of a recommendation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from percuss.case.quantities import METRICS, percent
from percuss.case.yaml_text import flow
from percuss.reporting.tables import Column, Piece, Table, Unbroken, words
from percuss.reporting.verdict import failures
from percuss.studies.recommendation import MEASURE

if TYPE_CHECKING:
    from percuss.studies.recommendation import Bounds, Recommendation, Tried


def recommendation_lines(found: Recommendation) -> Iterator[Piece]:
    """Yield what was tried, the Pareto front, and what the recommendation is in a case and as a command."""
    pairs = len({one.candidate.pair for one in found.tried})
    tried = f"{len(found.tried)} runs of {pairs} pairs; {len(found.refused)} pairs are refused, --json has the reasons"
    yield (found.study.title, "bold"), f": {bounds_in_words(found.bounds)}: {tried}"
    judge = f"an estimate, against a finer run ({'; '.join(found.judges)})" if found.judges else "true"
    yield f"the error is {judge}: {METRICS[MEASURE].metric}"
    columns = [
        words("methods", map(methods_in_words, found.front)),
        Column("error", [percent(one.error) for one in found.front]),
        Column("energy", [percent(one.energy) for one in found.front]),
        Column("node evaluations", [f"{one.evaluations:.3g}" for one in found.front]),
        Column("ms", [f"{1e3 * (one.seconds or 0.0):.3g}" for one in found.front]),
        words("stable", (str(one.stable) for one in found.front)),
    ]
    yield Table(columns, "no run is both cheaper and nearer to the bounds")
    yield Unbroken(f"runs: {found.study.path}")
    if found.best is not None:
        yield "in a case:"
        changes = found.best.candidate.changes
        method = {path.removeprefix("method."): value for path, value in changes.items() if path.startswith("method.")}
        yield Unbroken(f"  method: {flow(method)}")
        yield Unbroken(f"  refine: {changes['refine']:g}")
        yield Unbroken(f"  time: {{courant: {changes['time.courant']:g}}}")
        yield Unbroken(f"  {found.study.command(found.best.key)}")


def recommendation_verdict(found: Recommendation) -> Iterator[str]:
    """Yield why runs failed, how many choices were not tried, and the cheapest run that meets the bounds."""
    yield from failures((one.status, one.reason, " + ".join(one.candidate.pair)) for one in found.tried)
    if found.left:
        yield f"Choices of methods, options and step that were not tried, as --runs allows no more: {found.left}."
    if found.best is not None:
        yield f"Cheapest: {in_words(found.best)}."
    else:
        nearest = f"the nearest is {in_words(found.front[-1])}" if found.front else "none has the bounded numbers"
        yield f"No run meets the bounds; {nearest}."


def bounds_in_words(bounds: Bounds) -> str:
    """Return what was asked, in words."""
    kept = "kept to" if bounds.energy is not None else "grown by at most"
    parts = [
        f"{METRICS[MEASURE].label} of at most {percent(bounds.error, 4)}" if bounds.error is not None else "",
        f"energy {kept} {percent(bounds.growth, 4)}",
    ]
    return ", ".join(filter(None, parts))


def in_words(one: Tried) -> str:
    """Return a run in one line: methods, options, mesh, step, and its numbers."""
    numbers = f"error {percent(one.error)}, energy {percent(one.energy, 2)}, {one.evaluations:.3g} node evaluations"
    return f"{methods_in_words(one)}: {numbers}, the certificate says {one.stable}"


def methods_in_words(one: Tried) -> str:
    """Return methods, options, mesh and step of a run."""
    candidate = one.candidate
    options = (
        f" {flow(given)}" if given else "" for given in (candidate.integrator_options, candidate.contact_options)
    )
    pair = " + ".join(map(str.__add__, candidate.pair, options))
    pairing = f", {candidate.pairing}" if candidate.pairing else ""
    return f"{pair}{pairing}, refine {candidate.refine:g}, Courant number {candidate.courant:g}"
