"""Errors that percuss raises on purpose: each names the place, the value found, the value expected and a remedy."""

from __future__ import annotations

import copyreg
import difflib
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

MOST_SHOWN = 20  # mistakes that the message of an error shows
SIMILAR, WITH_ITS_LETTER = 0.8, 0.65  # least similarity of a name that is suggested, and of one with the first letter
LONGEST_SHOWN = 1000  # letters of a path or a message that are shown
# Characters that move the cursor of a terminal, change its state or the direction of its text; a line may end and be
# indented.
CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


class PercussError(Exception):
    """Base class of all errors that percuss raises on purpose; the command line prints them without a traceback."""

    exit_code = 2

    def __reduce__(self) -> tuple[object, ...]:
        # An error is made anew with its attributes, whatever its class is made of: its text stands in `args`.
        return copyreg.__newobj__, (type(self), *self.args), vars(self)  # type: ignore[attr-defined]


class PluginError(PercussError):
    """Breach of the contract by a plug-in or by a component it registers; the message names it and the rule.

    Attributes
    ----------
    place
        ``file:line`` of the breach, with which the message begins; empty if it is not known.
    """

    def __init__(self, message: str, place: str = "") -> None:
        super().__init__(f"{place}: {message}" if place else message)
        self.place = place


class RefusedPair(PercussError):
    """Refusal to combine an integrator with a contact law because the combination makes no sense.

    Attributes
    ----------
    reason
        Reason for the refusal, in one sentence.
    said_by
        Name of the component that refused the combination.
    problems
        The places of both names in the case, once the case is known; the message then begins with them.
    """

    def __init__(
        self, integrator: str, contact: str, reason: str, said_by: str, problems: Iterable[Problem] = ()
    ) -> None:
        self.integrator, self.contact, self.reason, self.said_by = integrator, contact, reason, said_by
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)) or self.sentence)

    @property
    def sentence(self) -> str:
        """The refusal in one sentence, without the places of the names."""
        return f"{self.integrator} with {self.contact} is refused by {self.said_by}: {self.reason}"


@dataclass(frozen=True)
class Problem:
    """A mistake in an input, with its place and a remedy.

    Attributes
    ----------
    place
        ``file:line:column``, or the override that contains the mistake.
    path
        Dotted path inside the case; empty for a syntax error.
    message
        Value expected and value found.
    advice
        Remedy; may be empty.
    excerpt
        Line of the user's file with a caret below the column; may be empty.
    """

    place: str
    path: str
    message: str
    advice: str = ""
    excerpt: str = ""

    def __str__(self) -> str:
        head = ": ".join(part for part in (self.place, shortened(self.path), shortened(self.message)) if part)
        return "\n".join(part for part in (head, self.excerpt, f"  {self.advice}" if self.advice else "") if part)


class InputError(PercussError):
    """Mistakes in a case, an override or a file given by the user; the error carries all mistakes found.

    Its message shows the first `MOST_SHOWN` of them.

    Attributes
    ----------
    problems
        The mistakes, in their order in the file.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        shown = [str(problem) for problem in self.problems[:MOST_SHOWN]]
        if hidden := len(self.problems) - len(shown):
            shown.append(f"... and {hidden} more mistake{'s' if hidden > 1 else ''}")
        super().__init__("\n".join(shown))


def wrong_input(place: str, message: str, advice: str = "", *, path: str = "") -> InputError:
    """Return the error of a single mistake."""
    return InputError([Problem(place, path, message, advice)])


def refuse_if_any(problems: Collection[Problem]) -> None:
    """Raise an InputError with all problems, if there are any."""
    if problems:
        raise InputError(problems)


class TooLargeError(InputError):
    """Refusal of a case that needs more memory than this machine has; another machine may run it."""


class UnwrittenError(PercussError):
    """Failure to write a file, as on a full disk; a file of that name from before is left as it was."""


class RunError(PercussError):
    """Stop of a run that became unstable or non-finite.

    Attributes
    ----------
    result
        Result up to the stop; its ``status`` says that it is not a valid result.
    """

    exit_code = 1

    def __init__(self, message: str, result: Any = None) -> None:
        super().__init__(message)
        self.result = result


def printable(text: str) -> str:
    """Return a text with an escape instead of each control character, so that it cannot steer a terminal."""
    return CONTROLS.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def shortened(text: str, most: int = LONGEST_SHOWN) -> str:
    """Return a text with at most `most` letters, the last three of them dots where some were left out."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def nearest(word: str, names: Iterable[str]) -> str | None:
    """Return the name in `names` that is closest to `word` or has it as a part; None if none is similar."""
    names = list(names)
    close = (
        difflib.get_close_matches(word, [name for name in names if word in name.split("-")], n=1, cutoff=0.0)
        or difflib.get_close_matches(word, names, n=1, cutoff=SIMILAR)
        or difflib.get_close_matches(word, [n for n in names if n[:1] == word[:1]], n=1, cutoff=WITH_ITS_LETTER)
    )
    return close[0] if close else None


def suggestion(word: str, candidates: Iterable[str], kind: str = "name") -> str:
    """Return advice for an unknown `word`: the nearest of the candidate names, or a list of them if none is similar."""
    names = sorted(candidates)
    close = nearest(word, names)
    if close is not None:
        return f"Did you mean '{close}'?"
    return f"Known {kind}s: {', '.join(names)}." if names else f"There is no {kind} to choose from."
