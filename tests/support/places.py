"""Folders that the tests read."""

from pathlib import Path

SUPPORT = Path(__file__).resolve().parent
ROOT = SUPPORT.parents[1]
CASES = ROOT / "cases"

# Nothing but the tests, the cases and the pages may be here: percuss itself is installed.
has_source_tree = (ROOT / "framework" / "percuss").is_dir()
