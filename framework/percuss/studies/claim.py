"""The claim of a study on the file of its rows, so that no other study or process writes to it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from percuss.errors import InputError, Problem
from percuss.filelock import BusyError, locked
from percuss.files import expect_place
from percuss.jsonable import Data
from percuss.methods.source_digest import content_digest
from percuss.studies.spec import StudySpec
from percuss.studies.store import Store, as_json_data


@contextmanager
def claimed(
    out: str | os.PathLike[str] | None, given: str | Path | Data, spec: StudySpec, keys: set[str]
) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Lock the file of a study against all other processes, after a check that it holds no other study.

    Raises
    ------
    InputError
        If it holds another study, or another process writes to it.
    """
    refused: InputError | None = None
    for file in [Path(out)] if out is not None else _default_files(given, spec.name):
        identity = _identity(given, spec, file)
        expect_place(file)
        try:
            with locked(file, {"study": identity}):
                other = _other_study(file, identity, keys)
                if other is None:
                    yield file, identity
                    return
                refused = other
        except BusyError as error:
            holder = error.holder.get("study")
            if out is not None or not isinstance(holder, dict) or _is_same(holder, identity):
                raise
            refused = error
    if refused is None:
        raise AssertionError("a study has no file and nothing says why")
    raise refused


def _default_files(given: str | Path | Data, name: str) -> list[Path]:
    """Return the default files for the rows of a study, of which the first that is free or its own is used.

    Studies of the same name in several folders have a file each: the name of the second also depends on its place.
    """
    if isinstance(given, Mapping):
        return [Path(f"{name}.sqlite")]
    place = content_digest(str(Path(given).resolve()).encode())[:6]
    first, second = Path(f"{name}.sqlite"), Path(f"{name}-{place}.sqlite")
    return [second] if second.exists() else [first, second]


def _identity(given: str | Path | Data, spec: StudySpec, out: Path) -> dict[str, Any]:
    """Return the identity of a study: path of its file, absolute and relative to `out`, title and cases.

    A study remains the same if its plan changes, and if it moves together with its rows.
    """
    description = {"title": str(spec.data.get("title", "")), "cases": as_json_data(spec.data.get("cases", ()))}
    if isinstance(given, Mapping):
        return {"file": None, "beside": None, **description}
    file = Path(given).resolve()
    try:
        relative = os.path.relpath(file, out.resolve().parent)
    except ValueError:  # a path on another drive has no relative form
        relative = None
    return {"file": str(file), "beside": relative, **description}


def _is_same(first: Data, second: Data) -> bool:
    """Return whether two identities are of the same study."""
    if first.get("file") is None or second.get("file") is None:
        return all(first.get(name) == second.get(name) for name in ("file", "title", "cases"))
    return any(first.get(name) is not None and first.get(name) == second.get(name) for name in ("file", "beside"))


def _other_study(file: Path, identity: Data, keys: set[str]) -> InputError | None:
    """Return the error of a file that holds another study, or None if it does not."""
    store = Store(file, new=True)
    held = store.facts().get("study")
    if held is None or _is_same(held, identity) or store.planned() == keys:
        return None
    message = f"holds another study: {_described(held)}; this is {_described(identity)}"
    return InputError([Problem(str(file), "", message, "Name another file with -o, or remove this one.")])


def _described(identity: Data) -> str:
    title = f"'{identity.get('title')}'" if identity.get("title") else "one without a title"
    return f"{title} of {identity.get('file') or 'a mapping'}"
