"""The case inside a result, run again: whether every bit agrees, and if not, what differs and what has changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from percuss.errors import InputError, PercussError, RunError
from percuss.jsonable import Entries
from percuss.results.differences import Change, Difference, changes, differences
from percuss.results.exact_only import run_exact
from percuss.results.provenance import case_inside
from percuss.results.result import open_result
from percuss.results.runner import run_again


@dataclass(frozen=True)
class Rerun:
    """Comparison of a result with another run of the case inside it.

    Attributes
    ----------
    path
        Path of the result.
    title
        Title of the case.
    differences
        Quantities whose bits differ.
    changes
        What has changed since the result was made.
    error
        Why there is no other result, if there is none; else empty.
    """

    path: str
    title: str
    differences: tuple[Difference, ...]
    changes: tuple[Change, ...]
    error: str = ""

    @property
    def passed(self) -> bool:
        """Whether all bits agree."""
        return not self.differences and not self.error

    def as_dict(self) -> Entries:
        """Return the comparison as plain data for JSON."""
        told = asdict(self)
        return {"result": told.pop("path"), "passed": self.passed, **told}


def rerun(path: Path, plugins: Sequence[Path] = ()) -> Rerun:
    """Run the case inside a result again and compare all that was recorded and summed up.

    A run that was interrupted is ended after the same step; one that was stopped is expected to stop again.

    Parameters
    ----------
    path
        Path of the result.
    plugins
        Single-file plug-ins that stand in for those of the result.

    Raises
    ------
    InputError
        If the file is no result or is damaged, or its case cannot be read; see `case_inside`.
    """
    then = open_result(path)
    case = case_inside(then.provenance, plugins=plugins, name=str(path))
    try:
        now = run_again(case, then.summary) if then.marched else run_exact(case)
    except RunError as stopped:
        now = stopped.result
    except InputError:
        raise
    except PercussError as refused:
        return Rerun(str(path), then.title, (), (), f"there is no result any more: {refused}")
    if now.status == "interrupted" != then.status:
        raise KeyboardInterrupt  # Ctrl-C ended the second run
    found = differences(then, now), changes(then.provenance, now.provenance)
    return Rerun(str(path), then.title, tuple(found[0]), tuple(found[1]))
