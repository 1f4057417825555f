"""Every shipped case is a test of itself, and says where its numbers are from."""

from pathlib import Path

import pytest

import percuss
import places
from marks import deep
from percuss.results.verify import verify

CASES = sorted(places.CASES.glob("*.yaml"))
BENCHMARKS = {
    "carpenter",
    "hunek",
    "unlike",
    "doyen-impact",
    "doyen-bounce",
    "sdnv100",
    "preloaded",
    "cradle",
    "smooth-pulse",
}


LONG = {
    "ball-on-wall",
    "ball-on-wall-3d",
    "disk-on-wall",
    "oblique-spheres",
    "two-spheres",
}  # coarser ones are quick: test_disk.py
LONG |= {"fifty-impacts"}  # its exact solution compiles a march of its own
LONG |= {
    "box-impact",
    "gross-slip-disk",
    "slide-off",
}  # kernels of their own: test_space.py, test_friction.py, test_sliding.py
LONG |= {"shallow-ironing"}  # 28 000 steps; test_finite_strain.py holds its forces against figures


def test_the_benchmarks_are_there() -> None:
    assert {path.stem for path in CASES} >= BENCHMARKS


@pytest.mark.parametrize(
    "path", [deep(path) if path.stem in LONG else path for path in CASES], ids=lambda path: path.stem
)
def test_a_case_gives_what_it_expects(path: Path) -> None:
    case = percuss.load(path)
    assert case.title
    assert case.source
    assert case.expect
    result = percuss.run(case)
    failed = [check.as_dict() for check in verify(case, result) if not check.passed]
    assert failed == []
    assert result.summary["energy"]["ledger_error"] < 1e-12
    assert result.summary["momentum"]["error"] < 1e-12
    assert result.summary["energy_growth"]["kept"] is not False
    told = result.summary["notes"]
    of_surfaces = ("lies", "presses")  # points that see nothing, or press at a distance
    assert not [note for note in told if any(f" {kind} " in note for kind in of_surfaces)]


@pytest.mark.parametrize(
    "path",
    [path if "bar: " in path.read_text(encoding="utf-8") and path.stem not in LONG else deep(path) for path in CASES],
    ids=lambda path: path.stem,
)
def test_expectations_can_fail(path: Path) -> None:
    """A case whose material or friction is twice as large must not pass: its expectations are not empty words."""
    case = percuss.load(path)
    name = next(iter(case.bodies))
    if case.method.friction is not None:
        change = {"method.friction.mu": 2 * case.method.friction.mu}
    else:
        change = {f"bodies.{name}.material.young": 2 * case.bodies[name].material.young}
    result = percuss.run(case, change)
    assert any(not check.passed for check in verify(case, result))
