"""Reasons why runs of a study are not done."""

from __future__ import annotations

import re
from typing import Any

from percuss.reporting.study_data.values import WAITING, methods, texts


def lost(table: Any) -> list[dict[str, Any]]:
    """Return the reasons why runs are not done, most frequent first; reasons that differ by numbers alone are one."""
    rows = table[~table["status"].isin(["done", WAITING])]
    pairs = methods(rows)
    sources, reasons, status = (texts(rows[name]) for name in ("said_by", "reason", "status"))
    groups: dict[Any, dict[str, Any]] = {}
    for entry in zip(status, pairs, sources, reasons, strict=True):
        kind = (*entry[:3], re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", entry[3]))
        group = groups.setdefault(kind, dict(zip(("status", "method", "said_by", "reason"), entry, strict=True)))
        group["count"] = group.get("count", 0) + 1
    return sorted(groups.values(), key=lambda group: -int(group["count"]))
