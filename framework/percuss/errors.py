"""The errors percuss raises on purpose: each says where, what was found, what was expected and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any


class PercussError(Exception):
    """Base of every error percuss raises on purpose; the command line prints it without a traceback."""

    exit_code = 2


class PluginError(PercussError):
    """A plug-in, or something it registers, breaks the contract; the message names it and the rule."""


class RefusedPair(PercussError):
    """An integrator and a contact law that make no sense together.

    Attributes
    ----------
    reason
        Why, in one sentence.
    said_by
        Name of the component that refused.
    """

    def __init__(self, integrator: str, contact: str, reason: str, said_by: str) -> None:
        super().__init__(f"{integrator} with {contact} is refused by {said_by}: {reason}")
        self.integrator, self.contact, self.reason, self.said_by = integrator, contact, reason, said_by

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.integrator, self.contact, self.reason, self.said_by)


@dataclass(frozen=True)
class Problem:
    """One mistake in an input: where it stands and what to do about it.

    Attributes
    ----------
    place
        ``file:line:column``, or the override it came from.
    path
        Dotted path inside the case, empty for a mistake of syntax.
    message
        What was expected and what was found.
    advice
        What to do; may be empty.
    excerpt
        The user's own line with a caret below the column; may be empty.
    """

    place: str
    path: str
    message: str
    advice: str = ""
    excerpt: str = ""

    def __str__(self) -> str:
        head = ": ".join(part for part in (self.place, self.path, self.message) if part)
        return "\n".join(part for part in (head, self.excerpt, f"  {self.advice}" if self.advice else "") if part)


class InputError(PercussError):
    """A case, an override or a file given by the user is wrong; carries every mistake found.

    Attributes
    ----------
    problems
        The mistakes, in the order in which they stand in the file.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.problems,)


class TooLargeError(InputError):
    """A case needs more memory than this machine has; another machine may run it."""


class RunError(PercussError):
    """A run went unstable or non-finite and was stopped.

    Attributes
    ----------
    result
        What was computed up to the stop; its ``status`` says that it is not a valid result.
    """

    exit_code = 1

    def __init__(self, message: str, result: Any = None) -> None:
        super().__init__(message)
        self.result = result

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.result)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known name closest to `word`, or None where nothing is near."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return close[0] if close else None


def suggestion(word: str, known: Iterable[str], kind: str = "name") -> str:
    """Return the advice for an unknown `word`: the nearest known name, else the list of them."""
    names = sorted(known)
    close = nearest(word, names)
    if close is not None:
        return f"Did you mean '{close}'?"
    return f"Known {kind}s: {', '.join(names)}." if names else f"There is no {kind} to choose from."
