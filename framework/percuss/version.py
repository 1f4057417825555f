"""Versions: of percuss, of the contract that plug-ins rely on, and of installed distributions."""

from __future__ import annotations

import functools
from importlib import metadata

__version__ = "0.1.0"
CONTRACT = 1


@functools.cache
def installed_version(distribution: str) -> str:
    """Return the version of an installed distribution, ``not installed`` where it is not there."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"
