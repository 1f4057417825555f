"""The truth that each method is held against, and the test that does it: tables of the reference of methods."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

import places
from percuss.methods.registry import Registry

FILE = Path(__file__).with_suffix(".yaml")
HELD: dict[str, dict[str, tuple[str, str]]] = yaml.safe_load(FILE.read_text(encoding="utf-8"))


def facts(family: str, registry: Registry) -> Iterator[tuple[str, ...]]:
    """Yield name, order and limit (of an integrator), declared properties, truth and test of each method."""
    for name in registry.names(family):
        against, test = HELD[family][name]
        cls: Any = registry.get(family, name)
        limit = f"{cls.critical_courant:.3g}" if getattr(cls, "critical_courant", None) else ""
        kept = ", ".join([*getattr(cls, "conserves", ()), *getattr(cls, "guarantees", ())])
        file, _, function = test.partition("::")
        yield (
            f"`{name}`",
            *((str(cls.order), limit) if family == "integrators" else ()),
            kept,
            f"{against}: [`{function}`](../tests/truth/{file})",
        )


def tests_named() -> Iterator[tuple[Path, str]]:
    """Yield the file and the name of each test that the table names."""
    for held in HELD.values():
        for _, test in held.values():
            file, _, function = test.partition("::")
            yield places.ROOT / "tests" / "truth" / file, function
