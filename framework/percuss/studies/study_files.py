"""The files that a study came from: its own, its cases, their tables of numbers, and single-file plug-ins."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from percuss.digest import content_digest
from percuss.studies.job_package import Bench
from percuss.studies.spec import StudySpec

LONGEST_TEXT = 200_000  # bytes of a file that is kept as text


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

    A text is kept of files up to `LONGEST_TEXT` bytes.

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
    return [
        StudyFile(path, role, content_digest(content), len(content), _text(content))
        for path, (role, content) in contents.items()
    ]


def _contents(spec: StudySpec, bench: Bench) -> Iterator[tuple[str, str, bytes]]:
    """Yield path, role and content of each file; a file that several cases name comes several times."""
    if spec.source.text:
        yield _from_here(Path(spec.source.name)), "study", _bytes_of(Path(spec.source.name), spec.source.text)
    for case in spec.cases.values():
        yield _from_here(Path(case.origin.name)), "case", _bytes_of(Path(case.origin.name), case.origin.text)
    for label, case in spec.cases.items():
        for name, text in bench.cases[label].data_files.items():
            yield _from_here(case.origin.folder / name), "data", _bytes_of(case.origin.folder / name, text)
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
    return None if "\0" in text or len(content) > LONGEST_TEXT else text


def _from_here(path: Path) -> str:
    """Return a path without detours such as ``studies/..``, from the current folder if it lies in it."""
    here, path = Path.cwd(), path.resolve()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)
