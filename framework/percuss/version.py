"""Versions: of percuss, of the contract that plug-ins rely on, and of installed distributions."""

from __future__ import annotations

import functools

__version__ = "0.1.0"
CONTRACT = 5


@functools.cache
def installed_version(distribution: str) -> str:
    """Return the version of an installed distribution, ``not installed`` where it is not there.

    Only the line with the version is read: the metadata of some distributions contain whole licences, which
    `importlib.metadata.version` reads as if they were mail.
    """
    import re
    from importlib import metadata

    try:
        found = metadata.distribution(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"
    line = re.search(r"^Version: *(\S+) *$", found.read_text("METADATA") or "", re.MULTILINE)
    return line[1] if line else found.version
