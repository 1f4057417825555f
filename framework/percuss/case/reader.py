"""Reading of a source into checked sections; every mistake is kept with its place, and reading goes on."""

from __future__ import annotations

from typing import Any, TypeVar

import pydantic

from percuss.case.source import Source
from percuss.case.validation import Context, mistakes_in, validate
from percuss.case.yaml_text import KeyPath
from percuss.errors import InputError, Problem
from percuss.methods.registry import Registry

T = TypeVar("T")


class Reader:
    """Reader of one source.

    Attributes
    ----------
    source, registry
        The source, and the registry of the components that it may name.
    context
        Surroundings of its validation; the parts without mistakes are in it, whether others have mistakes or not.
    problems
        Mistakes so far, each with its place in the order of the source.
    """

    def __init__(self, source: Source, registry: Registry) -> None:
        self.source, self.registry = source, registry
        self.context = Context(registry, source.folder, source.data_files)
        self.problems: list[tuple[tuple[int, int, int], Problem]] = []

    def wrong(self, path: KeyPath, message: str, advice: str = "", *, key: bool = False) -> None:
        """Keep a mistake."""
        problem = self.source.problem(path, message, advice, key=key)
        self.problems.append((self.source.order(path, key=key), problem))

    def finish(self) -> None:
        """Raise InputError with all mistakes in the order of the file, if there are any."""
        if self.problems:
            ordered = sorted(self.problems, key=lambda placed: placed[0])
            # An anchor that is used twice would be reported twice.
            raise InputError(dict.fromkeys(problem for _, problem in ordered))

    def read(self, cls: type[T]) -> T | None:
        """Return the whole source as a section, or None if it has mistakes."""
        try:
            return validate(cls, self.source.data, self.context)
        except pydantic.ValidationError as error:
            for path, message, advice, key in mistakes_in(error):
                self.wrong(path, message, advice, key=key)
            return None

    def part(self, path: KeyPath) -> Any:
        """Return the checked section at `path`, or None if it has mistakes or is no section."""
        return self.context.checked.get(id(self.source.get(path)))
