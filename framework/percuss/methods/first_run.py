"""Questions that are put twice to the methods of a plug-in, once before the first run of a source that has changed.

A method that reads the clock, draws random numbers or keeps state gives two answers to the same question; a trial call
of a kernel in plain Python finds a write, a wrong index or a forgotten branch. A source that has answered a question
once answers it in the same way as long as it is the same, so its answers are noted in the user's cache folder. Without
such a folder, and where a class has no source, each process asks anew. The conformance kit always asks.
"""

from __future__ import annotations

import json
import sys
import weakref
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from percuss import version
from percuss.cache import keep, kept
from percuss.errors import InputError
from percuss.methods.blame import is_third_party
from percuss.methods.provenance import Provenance
from percuss.methods.source_digest import SourceDigests, content_digest

if TYPE_CHECKING:
    from percuss.methods.interfaces import Component

NEVER_ANSWERED = -(2**31)  # number of good answers to a question that has been answered wrongly
MOST_NOTED = 10_000  # answers of a class, such as those of a study over as many options


class Answers:
    """The questions that a class has answered: in earlier processes, and how often in this one.

    Parameters
    ----------
    file
        Name of the file in the cache folder that has the answers of earlier processes; empty for none.
    """

    def __init__(self, file: str = "") -> None:
        self.file = file
        self.before = self._noted()
        self.now: Counter[str] = Counter()

    def _noted(self) -> frozenset[str]:
        return frozenset(json.loads(kept(self.file) or "[]") if self.file else ())

    def note(self) -> None:
        """Note in the cache folder what has been answered well in this process."""
        answered = {question for question, times in self.now.items() if times > 0}
        if self.file and answered - self.before:
            self.before = self._noted()  # another process may have added to it
            if len(self.before | answered) <= MOST_NOTED:
                keep(self.file, json.dumps(sorted(self.before | answered)).encode())


_ANSWERS: weakref.WeakKeyDictionary[type[Component], Answers] = weakref.WeakKeyDictionary()


@contextmanager
def first_asked(question: str, *components: Component, times: int = 1) -> Iterator[bool]:
    """Yield whether a question is to be put twice: a third-party source has answered it neither before nor `times` now.

    An error inside the context is a wrong answer.

    Parameters
    ----------
    question
        The question: the method or kernel, with all on which its answer may depend beside its arguments.
    components
        The methods that are asked.
    times
        How often the question is put in the first process that puts it, as one answer may be right by chance.
    """
    asked = [answers for component in components if (answers := _answers_of(type(component))) is not None]
    key = content_digest(question.encode())[:16] if asked else ""
    due = any(answers.now[key] < times and key not in answers.before for answers in asked)
    right = False
    try:
        yield due
        right = True
    finally:
        for answers in asked if due else ():
            answers.now[key] += 1 if right else NEVER_ANSWERED


def is_watched(component: Component) -> bool:
    """Return whether the answers of a method are checked: those of a third-party plug-in, and of one in the kit."""
    return _answers_of(type(component)) is not None


@contextmanager
def asked_again(component: type[Component], answers: Answers) -> Iterator[None]:
    """Ask a class everything inside this context that `answers` does not have, wherever the class comes from."""
    before = _ANSWERS.get(component)
    _ANSWERS[component] = answers
    try:
        yield
    finally:
        if before is None:
            del _ANSWERS[component]
        else:
            _ANSWERS[component] = before


def note_answers() -> None:
    """Note in the cache folder what plug-ins have answered well."""
    for answers in list(_ANSWERS.values()):
        answers.note()


def _answers_of(component: type[Component]) -> Answers | None:
    """Return the answers of a class; None for one of percuss itself, which the tests of percuss ask."""
    if component not in _ANSWERS and is_third_party(component.__module__):
        _ANSWERS[component] = Answers(_file_of(component))
    return _ANSWERS.get(component)


def _file_of(component: type[Component]) -> str:
    """Return the name of the file with the answers of a class, for its present source; empty if it has none."""
    module = component.__module__
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return ""
    package = "" if module.startswith("percuss_file_") else module.partition(".")[0]
    try:
        sources = SourceDigests().of(Provenance(package, "", module, file))
    except InputError:  # it was edited after this process imported it
        return ""
    facts = version.__version__, version.CONTRACT, module, component.__qualname__, sources
    return f"{content_digest(repr(facts).encode())}.answered"
