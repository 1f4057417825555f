"""Folders that the tests read."""

import shutil
import subprocess
from pathlib import Path

SUPPORT = Path(__file__).resolve().parent
ROOT = SUPPORT.parents[1]
CASES = ROOT / "cases"

# Nothing but the tests, the cases and the pages may be here: percuss itself is installed.
has_source_tree = (ROOT / "framework" / "percuss").is_dir()

DROPPINGS = {"build", "dist", "__pycache__", "PKG-INFO"}


def project_files(*, tracked=False):
    """Return the files that belong to the project: git's, else all but what building and testing leave.

    Where there is git, `tracked` leaves out files that it does not know yet, as those that a user has made.
    """
    git = shutil.which("git")
    if git and (ROOT / ".git").exists():
        others = [] if tracked else ["--others", "--exclude-standard"]
        command = [git, "-C", str(ROOT), "ls-files", "--cached", *others, "-z"]
        listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")
        return [ROOT / name for name in listed if name and (ROOT / name).is_file()]
    return [path for path in ROOT.rglob("*") if path.is_file() and not is_dropping(path.relative_to(ROOT))]


def is_dropping(path):
    """Return whether a file is what building, testing or the commands of the README leave behind."""
    made = path.suffix in {".png", ".svg", ".pdf", ".nc", ".html", ".csv", ".sqlite"} and len(path.parts) == 1
    hidden = any(part.startswith(".") and part != ".ci" for part in path.parts[:-1])
    return made or hidden or bool(DROPPINGS & set(path.parts)) or any("egg-info" in part for part in path.parts)
