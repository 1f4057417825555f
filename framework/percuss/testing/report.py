"""The outcomes of the checks of a component: counted, grouped by what failed, and told in words."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from percuss.files import writing
from percuss.jsonable import Entries
from percuss.methods.interfaces import Component
from percuss.testing.subject import Check, Status, named

# heading of the outcomes that are no part of the verdict
OTHERS = "with methods of other plug-ins, which the verdict does not count:"
MARKS = {"passed": ".", "failed": "F", "passes unexpectedly": "F", "expected failure": "x", "not applicable": "s"}
WORDS = {"expected failure": "declared", "not applicable": "skipped", "passes unexpectedly": "unexpected pass"}
WORST: tuple[Status, ...] = ("failed", "passes unexpectedly", "expected failure", "passed")
WIDTH = 79
NEXT_ENTRY = ",\n" + " " * 25
GROUPS_SHOWN, NAMES_SHOWN = 3, 3


@dataclass(frozen=True)
class Outcome:
    """The outcome of one check of a component.

    Attributes
    ----------
    check
        Check that was made.
    partner
        Name of the partner, empty for a check that is not made in pairs.
    status
        ``passed``, ``failed``, ``expected failure``, ``passes unexpectedly`` or ``not applicable``.
    message
        Deviation from the demand, or the reason why the check does not apply.
    reason
        Reason why a failure is expected.
    case
        Text of the case that the check read last before it failed, as a case file that can be saved and run; empty if
        the check read no case.
    counts
        Whether the outcome is part of the verdict; with a partner of somebody else's plug-in it is not.
    """

    check: Check
    partner: str
    status: Status
    message: str = ""
    reason: str = ""
    case: str = ""
    counts: bool = True

    @property
    def name(self) -> str:
        """Name of the check, followed by the name of the partner if there is one."""
        return named(self.check, self.partner)

    @property
    def good(self) -> bool:
        """Whether the component meets the demand, fails as declared, or the outcome is no part of the verdict."""
        return not self.counts or self.status not in {"failed", "passes unexpectedly"}

    @property
    def sentence(self) -> str:
        """What failed, in one sentence."""
        if self.status == "passes unexpectedly":
            return f"declared to fail ({self.reason}), but it passes: delete the entry"
        return self.message.partition("\n")[0]

    @property
    def kind(self) -> str:
        """The sentence without its numbers, options and partner: failures of one kind are told together."""
        text = re.sub(r"\{.*?\}", "{}", self.sentence.replace(self.partner or "\n", "*"))
        return re.sub(r"-?\d[\d.]*(e[-+]?\d+)?", "#", text)

    def __str__(self) -> str:
        title = f"{self.status:>20}  {self.name}"
        if self.good:
            remark = self.reason or self.message
            return f"{title}{f' ({remark})' if remark else ''}"
        parts = [self.message or self.sentence, *textwrap.wrap(f"demanded: {self.check.demand}", 96)]
        parts += [f"the case of {self.name}, to be saved and run:\n{self.case}"] if self.case else []
        return "\n".join([title, *(textwrap.indent(part, " " * 22) for part in parts)])

    def as_dict(self) -> Entries:
        """Return the outcome as a dictionary that can be written as JSON."""
        fields = {key: getattr(self, key) for key in ("name", "status", "message", "reason", "case", "counts")}
        return fields | {"holds": self.check.holds, "demand": self.check.demand}


@dataclass(frozen=True)
class Report:
    """The outcomes of the checks of a component.

    Attributes
    ----------
    component
        Class of the component.
    outcomes
        Outcomes, in the order in which the checks were made.
    unmade
        Number of checks that were not made, because the component cannot run.
    """

    component: type[Component]
    outcomes: tuple[Outcome, ...]
    unmade: int = 0

    @property
    def passed(self) -> bool:
        """Whether no check failed and every declared failure occurred."""
        return all(outcome.good for outcome in self.outcomes)

    @property
    def failures(self) -> list[Outcome]:
        """Outcomes that speak against the component."""
        return [outcome for outcome in self.outcomes if not outcome.good]

    def count(self, status: str) -> int:
        """Return the number of outcomes with a status that are part of the verdict."""
        return sum(outcome.status == status for outcome in self.outcomes if outcome.counts)

    @property
    def verdict(self) -> str:
        """One line that states whether the component conforms, and the number of outcomes of each status."""
        counts = {outcome.status: self.count(outcome.status) for outcome in self.outcomes if outcome.counts}
        counted = ", ".join(f"{number} {WORDS.get(status, status)}" for status, number in counts.items())
        word = "conforms" if self.passed else "DOES NOT CONFORM"
        return f"{self.component.name} ({self.component.family}) {word}: {counted}"

    @property
    def smallest(self) -> Outcome | None:
        """The failure with the shortest case, None if no check that failed read a case."""
        return min((one for one in self.failures if one.case), key=lambda one: len(one.case), default=None)

    def groups(self) -> list[list[Outcome]]:
        """Return the failures in groups of one kind; a group of several checks comes before groups of one."""
        by_kind: dict[str, list[Outcome]] = {}
        for outcome in self.failures:
            by_kind.setdefault(outcome.kind, []).append(outcome)
        return list(by_kind.values())

    def as_dict(self) -> Entries:
        """Return the report as a dictionary that can be written as JSON."""
        return {
            "name": self.component.name,
            "family": self.component.family,
            "passed": self.passed,
            "unmade": self.unmade,
            "checks": [outcome.as_dict() for outcome in self.outcomes],
        }

    def write_cases(self, folder: Path) -> int:
        """Write the case of each failure to a file of its name in a folder, and return how many there are."""
        cases = {outcome.name.replace(" ", "-"): outcome.case for outcome in self.failures if outcome.case}
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            for name, case in cases.items():
                (folder / f"{self.component.name}-{name}.yaml").write_text(case, encoding="utf-8")
        return len(cases)

    # ----------------------------------------------------------------------------------------------- in words

    def __str__(self) -> str:
        return "\n".join([*self._table(), *self._told_groups(), *self._told_case(), *self._apart(), self.verdict])

    def _table(self) -> Iterator[str]:
        """Yield a line for each check; if some failed, for these alone."""
        rows: dict[Check, list[Outcome]] = {}
        for outcome in self.outcomes:
            if outcome.counts:
                rows.setdefault(outcome.check, []).append(outcome)
        for check, outcomes in rows.items():
            if self.passed or any(not outcome.good for outcome in outcomes):
                yield f"{check.name:23} {check.holds:40}{_result(outcomes)}"

    def _told_groups(self) -> Iterator[str]:
        """Yield the lines of the groups of failures, and how a failure is declared."""
        groups = self.groups()
        yield from [""] if groups else []
        for group in groups[:GROUPS_SHOWN]:
            names = [outcome.name for outcome in group]
            what = ", ".join(names[:2] + ["..."] * (len(names) > 2))
            what = f"{len(group)} checks ({what})" if len(group) > 1 else what
            yield from _filled(f"{what}: {group[0].sentence}")
        if len(groups) > GROUPS_SHOWN:
            yield f"other failures, shown by --verbose: {sum(map(len, groups[GROUPS_SHOWN:]))}"
        if self.unmade:
            yield f"\nIt cannot run, so {self.unmade} checks were not made."
        names = list(self._declarable())
        if names:
            yield "\nIf this is the nature of the method, declare it in its class, with the reason:"
            entries = [f'"{name}": "why"' for name in names[:NAMES_SHOWN]] + ["..."] * (len(names) > NAMES_SHOWN)
            yield f"    expected_failures = {{{NEXT_ENTRY.join(entries)}}}"

    def _declarable(self) -> Iterator[str]:
        """Yield the names by which failures in pairs can be declared: of a check that fails in all pairs, its own.

        None is the nature of a method that fails by itself, as by a wrong sign.
        """
        if not all(outcome.check.in_pairs for outcome in self.failures):
            return
        for check in dict.fromkeys(outcome.check for outcome in self.failures if outcome.check.in_pairs):
            made = [
                one for one in self.outcomes if one.check is check and one.counts and one.status != "not applicable"
            ]
            failed = [one for one in made if one.status == "failed"]
            yield from [check.name] if failed == made else [one.name for one in failed]

    def _told_case(self) -> Iterator[str]:
        """Yield the smallest case of a failure, ready to be saved and run."""
        if self.smallest:
            yield f"\nsmallest case, of {self.smallest.name}:"
            yield textwrap.indent(self.smallest.case.rstrip(), "    ")
        if not self.passed:
            yield ""

    def _apart(self) -> list[str]:
        """Return the failures that do not count, under their heading."""
        apart = [f"    {one.status}  {one.name}" for one in self.outcomes if not one.counts and one.status == "failed"]
        return [OTHERS, *apart] if apart else []


def _result(outcomes: list[Outcome]) -> str:
    """Return the worst result of a check; how many of the pairs in which it was made have it."""
    made: list[Status] = [outcome.status for outcome in outcomes if outcome.status != "not applicable"]
    status: Status = min(made, key=WORST.index, default="not applicable")
    count = f"{made.count(status)} of {len(made)} " if len(outcomes) > 1 and made else ""
    return f"{count}{WORDS.get(status, status)}".rjust(16)


def here(text: str) -> str:
    """Return a text with the paths of files below the current folder relative to it."""
    return text.replace(f"{Path.cwd()}{os.sep}", "")


def _filled(text: str) -> list[str]:
    """Return a text in lines of the width of a report."""
    return textwrap.wrap(here(text), WIDTH, subsequent_indent="    ", break_on_hyphens=False)
