"""Folders that the tests read."""

from pathlib import Path

SUPPORT = Path(__file__).resolve().parent
ROOT = SUPPORT.parents[1]
CASES = ROOT / "cases"
