"""What type checkers see of percuss: in a user's file the public names are what they are, not `Any`."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import percuss
from percuss.cli.scaffold import KINDS, new

USER = """
from dataclasses import dataclass
from typing import assert_type

import percuss
from percuss_methods.contacts.penalty import Penalty

case = percuss.load("case.yaml")
assert_type(case, percuss.Case)
result = percuss.run(case)
assert_type(result, percuss.Result)
assert_type(result.status, str)
assert_type(result.summary["dt"], float)
assert_type(percuss.study("study.yaml"), percuss.Study)
assert_type(percuss.CONTRACT, int)
assert_type(Penalty().scale, float | None)


@dataclass(frozen=True)
class Spring(percuss.ContactLaw):
    name = "spring"
    stiffness: float = 1.0

    def bind(self, points: percuss.ContactPoints, dt: float) -> percuss.LinearLaw:
        assert_type(points.stiffness, percuss.Floats)
        return percuss.LinearLaw(at="end", sigma=1.0 / points.stiffness)


@percuss.compiled_function
def doubled(value: float) -> float:
    return 2.0 * value


assert_type(doubled(value=1.0), float)
"""
WRONG = """
import percuss

percuss.run("case.yaml")
percuss.laws
"""


def test_every_public_name_is_there_and_in_the_list_once():
    """Type checkers and the package read one list: each line of the file of the types gives a name and its module."""
    listed = (Path(percuss.__file__).parent / "__init__.pyi").read_text("utf-8")
    lines = [line.split() for line in ast.unparse(ast.parse(listed)).splitlines() if not line.startswith('"""')]
    assert all(line == ["from", line[1], "import", line[3], "as", line[3]] for line in lines)
    assert sorted({*percuss.__all__, "__version__"}) == sorted(line[3] for line in lines)
    assert all(getattr(percuss, name) is not None for name in percuss.__all__)


@pytest.mark.deep
def test_a_users_file_is_checked_against_the_types_of_percuss(tmp_path):
    pytest.importorskip("mypy", reason="the types are checked by mypy")
    (tmp_path / "user.py").write_text(USER, encoding="utf-8")
    (tmp_path / "wrong.py").write_text(WRONG, encoding="utf-8")
    for kind in KINDS:
        new(f"my-{kind}", kind, tmp_path)
    files = sorted(path.name for path in tmp_path.glob("*.py"))
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--cache-dir=cache", *files]
    said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False).stdout
    first, second, _ = said.splitlines()
    assert first.startswith('wrong.py:4: error: Argument 1 to "run" has incompatible type "str"; expected "Case"')
    assert second.startswith('wrong.py:5: error: Module has no attribute "laws"')
