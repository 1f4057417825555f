"""The files that a study came from: its own, its cases, their tables of numbers, and single-file plug-ins."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from percuss.digest import content_digest
from percuss.studies.job_package import Bench
from percuss.studies.spec import StudySpec

LONGEST_TEXT = 200_000  # bytes of a file that is kept as text
LONGEST_TEXTS = 2_000_000  # bytes of all texts of a study


@dataclass(frozen=True)
class StudyFile:
    """A file that a study came from.

    Attributes
    ----------
    path
        Path of the file, from the folder where the study was started if it lies in it.
    role
        ``study``, ``case``, ``data`` or ``plug-in``.
    sha256
        SHA-256 digest of its bytes, hexadecimal.
    size
        Size in bytes.
    text
        The text; None for a file that is too large or no text in UTF-8, of which only the digest is kept.
    """

    path: str
    role: str
    sha256: str
    size: int
    text: str | None


def files_of(spec: StudySpec, bench: Bench) -> list[StudyFile]:
    """Return the files of a study as they were read: those that the rows depend on, and the study file itself.

    A text is kept of files up to `LONGEST_TEXT` bytes, until they are `LONGEST_TEXTS` bytes together.

    Parameters
    ----------
    spec
        The study.
    bench
        Its job package, which holds what its cases name.
    """
    contents: dict[str, tuple[str, bytes]] = {}
    for path, role, content in _contents(spec, bench):
        contents.setdefault(path, (role, content))
    files, left = [], LONGEST_TEXTS
    for path, (role, content) in contents.items():
        text = _text(content) if len(content) <= min(LONGEST_TEXT, left) else None
        left -= len(content) if text is not None else 0
        files.append(StudyFile(path, role, content_digest(content), len(content), text))
    return files


def _contents(spec: StudySpec, bench: Bench) -> Iterator[tuple[str, str, bytes]]:
    """Yield path, role and content of each file; a file that several cases name comes several times."""
    if spec.source.text:
        yield named_path(Path(spec.source.name)), "study", _bytes_of(Path(spec.source.name), spec.source.text)
    for case in spec.cases.values():
        yield named_path(Path(case.origin.name)), "case", _bytes_of(Path(case.origin.name), case.origin.text)
    for label, case in spec.cases.items():
        for name, text in bench.cases[label].data_files.items():
            yield named_path(case.origin.folder / name), "data", _bytes_of(case.origin.folder / name, text)
        for file in case.registry.single_files:
            yield _from_here(file.path), "plug-in", file.content


def _bytes_of(path: Path, text: str) -> bytes:
    """Return the bytes of a text that was read, with the mark at their beginning that is no part of the text."""
    content = text.encode()
    try:
        on_disk = path.read_bytes()
    except OSError:
        return content
    return on_disk if on_disk.removeprefix(b"\xef\xbb\xbf") == content else content


def _text(content: bytes) -> str | None:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    return None if "\0" in text else text


def named_path(path: Path) -> str:
    """Return the name of a file without detours such as ``studies/..``."""
    name = os.path.normpath(path)
    try:
        # Behind a symbolic link the folder above is another one.
        return name if Path(name).samefile(path) else str(path)
    except OSError:
        return str(path)


def _from_here(path: Path) -> str:
    """Return an absolute path as one from the current folder if it lies in it."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)
