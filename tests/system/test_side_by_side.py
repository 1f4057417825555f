"""Other programs beside percuss: their problem, their input, what is found of percuss, and the table of the page."""

import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks import side_by_side
from benchmarks.programs import solids_with_akantu, solids_with_calculix, solids_with_kratos

from percuss.case.mesh_file import mesh_in

SCRIPT = Path(side_by_side.__file__)


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


@pytest.mark.parametrize("method", solids_with_calculix.METHODS)
def test_the_input_of_calculix_is_written(method, tmp_path):
    model = side_by_side.model_of("blocks", {})
    solids_with_calculix.write(side_by_side.problem_of("blocks", model), tmp_path, method)
    text = (tmp_path / "blocks.inp").read_text()
    assert text.count("*ELEMENT, TYPE=C3D8") == 2
    assert f"TYPE={solids_with_calculix.METHODS[method][1]}\nSLAVE, MASTER" in text
    assert f"{model.dt!r}, {model.dt * model.steps!r}, , {model.dt!r}" in text


def test_the_input_of_kratos_is_written(tmp_path):
    problem = side_by_side.problem_of("blocks", side_by_side.model_of("blocks", {}))
    solids_with_kratos.write(problem, tmp_path, "explicit-penalty")
    mesh = (tmp_path / "blocks.mdpa").read_text()
    first, _, second = mesh.partition("Begin Elements")[2].partition("End Elements")
    assert len(first.splitlines()) == 1 + 400
    assert len(second.partition("Begin Conditions")[2].partition("End Conditions")[0].splitlines()) == 1 + 20
    parameters = json.loads((tmp_path / "parameters.json").read_text())
    assert parameters["solver_settings"]["time_stepping"]["time_step"] == problem["dt"]
    assert parameters["processes"]["contact_process_list"][0]["Parameters"]["assume_master_slave"] == {"0": ["slave"]}


def test_the_input_of_akantu_is_written(tmp_path):
    pytest.importorskip("meshioplusplus")
    problem = side_by_side.problem_of("blocks", side_by_side.model_of("blocks", {}))
    solids_with_akantu.write(problem, tmp_path)
    mesh = mesh_in((tmp_path / "blocks.msh").read_text(), "blocks.msh")
    sizes = {name: {kind: len(rows) for kind, rows in group.items()} for name, group in mesh.groups.items()}
    assert sizes == {"left": {"quad": 200}, "right": {"quad": 200}, "seam": {"line": 20}}
    assert (mesh.nodes[mesh.cells["line"], 1] == 1.0).all()
    assert f"epsilon_n = {0.25 * 10 / 0.05:.6g}" in (tmp_path / "blocks.dat").read_text()


def test_other_programs_meet_the_wall_as_a_held_block():
    pytest.importorskip("meshioplusplus")
    problem = side_by_side.problem_of("ball", side_by_side.model_of("ball", {}))
    ball, wall = problem["bodies"]
    assert problem["struck"] == [0, len(ball["nodes"])] == [0, len(problem["mass"])]
    nodes = np.array(ball["nodes"] + wall["nodes"])
    corners = nodes[np.array(wall["cells"])]
    assert np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6 == pytest.approx(1.0)
    assert {(node, axis) for node, axis in problem["fixed"] if node >= len(ball["nodes"])} == {
        (len(ball["nodes"]) + k, axis) for k in range(8) for axis in range(3)
    }
    skin, top = (np.array(surface) for surface in problem["surfaces"])
    assert (nodes[top, 2] == 0.0).all()
    assert (nodes[skin, 2] < side_by_side.LOW).all()
    low, high = side_by_side.WALL
    assert ((nodes[skin, :2] > low) & (nodes[skin, :2] < high)).all()


def test_the_page_has_a_row_for_each_method_of_each_program():
    page = (SCRIPT.parents[1] / "README.md").read_text(encoding="utf-8")
    part = page.partition(side_by_side.FIRST)[2].partition(side_by_side.LAST)[0]
    blocks, _, ball = part.partition(side_by_side.TITLES["ball"])
    for case, rows in {"blocks": blocks, "ball": ball}.items():
        expected = [("percuss", words) for words in side_by_side.OWN[case]]
        for name, program in side_by_side.PROGRAMS.items():
            expected += [(name, words) for words in program.methods[case].values()]
        found = [tuple(cell.strip() for cell in line.split("|")[1:3]) for line in rows.splitlines() if "|" in line][2:]
        assert [(name.split()[0], words) for name, words in found] == expected
    assert all(f"`{program.install}`" in page for program in side_by_side.PROGRAMS.values())
