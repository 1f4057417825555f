"""What is printed of results that were compared with another run of the cases inside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from percuss.case.quantities import percent
from percuss.reporting.tables import Piece

if TYPE_CHECKING:
    from percuss.results.differences import Difference
    from percuss.results.rerun import Rerun

SHOWN = 12  # differences that are printed; all of them are in the JSON


def rerun_lines(reruns: Sequence[Rerun]) -> Iterator[Piece]:
    """Yield of each result whether its bits agree, where they differ, and what has changed since it was made."""
    for rerun in reruns:
        mark = ("the same bits", "green") if rerun.passed else ("DIFFERS", "red")
        yield mark, " ", (rerun.path, "bold"), f" {rerun.title}"
        if rerun.error:
            yield f"  {rerun.error}"
        yield from (f"  {_words(difference)}" for difference in rerun.differences[:SHOWN])
        if len(rerun.differences) > SHOWN:
            yield f"  and {len(rerun.differences) - SHOWN} other quantities: see --json"
        for change in rerun.changes:
            yield f"  changed since: {change.what}: {_shortened(change.then)}, now {_shortened(change.now)}"
        if not rerun.passed and not rerun.changes:
            yield "  nothing that percuss records has changed: on one machine that should give the same bits"
    passed = sum(rerun.passed for rerun in reruns)
    yield f"{passed} of {len(reruns)} results made again to the last bit"


def _words(difference: Difference) -> str:
    """Return a difference in words."""
    of = f" of {difference.of}" if difference.of else ""
    when = "" if difference.time is None else f" from t = {difference.time:.9g} on"
    words = f"{difference.quantity}{of}{when}: {_number(difference.then)}, now {_number(difference.now)}"
    if difference.largest is None or difference.time is None:
        return words
    share = "" if difference.relative is None else f", {percent(difference.relative)} of its largest value"
    return f"{words}; at most {difference.largest:.3g} apart{share}"


def _number(value: object) -> str:
    return "none" if value is None else str(value)


def _shortened(value: str | None) -> str:
    """Return a text in which a digest has its first digits alone."""
    words = (word[:12] if len(word) == 64 else word for word in (value or "none").split(" "))
    return " ".join(words)
