"""What percuss stands on: every dependency is justified and has a lowest version."""

import re
import tomllib

import lowest
import pages
import places

EXTRAS = ("plot", "study", "kit")  # those for users

PROJECT = tomllib.loads((places.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DECLARED = [*lowest.declared(PROJECT), *(name for extra in EXTRAS for name in lowest.declared(PROJECT, extra))]


def test_every_dependency_is_justified():
    rows = re.findall(r"^\| `([\w-]+)` \| (.+) \| [\d.]+ \|$", pages.section("## Dependencies"), re.MULTILINE)
    assert [name for name, _ in rows] == DECLARED


def test_every_dependency_has_a_lowest_version():
    bounds = lowest.declared(PROJECT) | lowest.declared(PROJECT, "test")
    assert len(bounds) > 18
    assert None not in bounds.values()
    assert f"numba=={bounds['numba']}" in lowest.constraints(PROJECT)
