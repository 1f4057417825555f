"""Other programs beside percuss: what is found of percuss, and a row and the input of a program that is missing."""

import json

import pytest
from benchmarks import side_by_side


@pytest.mark.deep
def test_percuss_has_two_blocks_that_meet_squarely():
    row = side_by_side.with_percuss("blocks", next(iter(side_by_side.OWN["blocks"])), 1)
    assert row.mean == pytest.approx(0.025, rel=0.005)
    assert row.contact_time == pytest.approx(2.0, abs=0.13)
    assert row.energy == pytest.approx(1.0 - 0.5 * 0.025)  # 1 - h/2L, exactly, of Lagrange multipliers
    assert row.restitution**2 == pytest.approx(row.energy, abs=0.07)  # the rest of it is in waves
    assert row.force_error < 0.06


@pytest.mark.parametrize("name", side_by_side.PROGRAMS)
def test_a_program_for_solids_that_is_missing_has_a_row_and_its_input_stays(name, tmp_path):
    rows = list(side_by_side.others("blocks", name, str(tmp_path / "no-python"), tmp_path))
    program = side_by_side.PROGRAMS[name]
    assert [row.told for row in rows] == [f"not installed: {program.install}"] * len(program.methods["blocks"])
    for method in program.methods["blocks"]:
        folder = tmp_path / f"blocks-{name}-{method}"
        assert (folder / program.script).is_file()
        problem = json.loads((folder / "problem.json").read_text())
        assert len(problem["bodies"]) == len(problem["surfaces"]) == 2
