"""Printing of results that were compared with another run of the cases inside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console

from percuss.case.quantities import percent
from percuss.reporting.tables import plain_text

if TYPE_CHECKING:
    from percuss.results.differences import Difference
    from percuss.results.rerun import Rerun

SHOWN = 12  # differences that are printed; all of them are in the JSON


def tell_reruns(reruns: Sequence[Rerun]) -> None:
    """Print of each result whether its bits agree, where they differ, and what has changed since it was made."""
    console = Console(highlight=False, soft_wrap=True)
    for rerun in reruns:
        mark = "[green]the same bits[/green]" if rerun.passed else "[red]DIFFERS[/red]"
        console.print(f"{mark} [bold]{plain_text(rerun.path)}[/bold] {plain_text(rerun.title)}")
        if rerun.error:
            console.print(f"  {plain_text(rerun.error)}")
        for difference in rerun.differences[:SHOWN]:
            console.print(f"  {plain_text(_words(difference))}")
        if len(rerun.differences) > SHOWN:
            console.print(f"  and {len(rerun.differences) - SHOWN} other quantities: see --json")
        for change in rerun.changes:
            then, now = (_shortened(value) for value in (change.then, change.now))
            console.print(f"  changed since: {plain_text(change.what)}: {plain_text(then)}, now {plain_text(now)}")
        if not rerun.passed and not rerun.changes:
            console.print("  nothing that percuss records has changed: on one machine that should give the same bits")
    passed = sum(rerun.passed for rerun in reruns)
    console.print(f"{passed} of {len(reruns)} results made again to the last bit")


def _words(difference: Difference) -> str:
    """Return a difference in words."""
    of = f" of {difference.of}" if difference.of else ""
    when = "" if difference.time is None else f" from t = {difference.time:.9g} on"
    words = f"{difference.quantity}{of}{when}: {_number(difference.then)}, now {_number(difference.now)}"
    if difference.largest is None or difference.time is None:
        return words
    share = "" if difference.relative is None else f", {percent(difference.relative)} of its largest value"
    return f"{words}; at most {difference.largest:.3g} apart{share}"


def _number(value: Any) -> str:
    return "none" if value is None else str(value)


def _shortened(value: str | None) -> str:
    """Return a text in which a digest has its first digits alone."""
    words = (word[:12] if len(word) == 64 else word for word in (value or "none").split(" "))
    return " ".join(words)
