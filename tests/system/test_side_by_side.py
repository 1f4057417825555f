"""Other programs beside percuss: what the command says without them, and what it finds of those that are there."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from benchmarks import side_by_side, side_by_side_solids
from benchmarks.programs import solids_with_akantu, solids_with_calculix, solids_with_kratos

from percuss.case.mesh_file import mesh_in

PENALTY = "central difference, penalty"
SCRIPT = Path(side_by_side.__file__)

# A program of the test's own: both bars by velocities half a step early, whole arrays, and a spring between them.
LEAP_FROG = """
import json, sys
import numpy as np

if sys.argv[1] == "--version":
    print("1.2.3")
    sys.exit()
p = json.load(open(sys.argv[1]))
dt, count = p["dt"], [bar["elements"] + 1 for bar in p["bars"]]
mass, velocity, stiffness = np.zeros(sum(count)), np.zeros(sum(count)), np.zeros(sum(count) - 1)
first = 0
for bar, n in zip(p["bars"], count):
    h = bar["length"] / bar["elements"]
    for k in range(n - 1):
        mass[first + k : first + k + 2] += 0.5 * bar["density"] * bar["area"] * h
        stiffness[first + k] = bar["young"] * bar["area"] / h
    velocity[first : first + n] = bar["velocity"]
    first += n
a, b = count[0] - 1, count[0]
u, force = np.zeros(first), []
for _ in range(p["steps"] + 1):
    axial = stiffness * np.diff(u)
    acting = np.diff(axial, prepend=0.0, append=0.0)
    force.append(p["penalty"] * max(0.0, u[a] - u[b]))
    acting[a] -= force[-1]
    acting[b] += force[-1]
    velocity += dt * acting / mass
    velocity[-1] = 0.0
    before, u = u, u + dt * velocity
    if len(force) == p["steps"]:
        result = {"before": before.tolist(), "displacement": u.tolist()}
result |= {"seconds": 1.6, "force": force, "time": [k * dt for k in range(p["steps"] + 1)]}
json.dump(result, open(sys.argv[2], "w"))
"""


@pytest.fixture(scope="module")
def own():
    """Return the row of percuss's central difference with a penalty."""
    return side_by_side.with_percuss(PENALTY, 1, 1)


def test_a_program_is_judged_as_percuss_judges_itself(own, tmp_path, monkeypatch):
    script = tmp_path / "leap_frog.py"
    script.write_text(LEAP_FROG)
    monkeypatch.setitem(side_by_side.PROGRAMS, "own", side_by_side.Program("leap-frog", str(script), "nothing"))
    (row,) = side_by_side.others(["own"], {"own": sys.executable}, 1, 2)
    assert row.program == "own 1.2.3"
    assert row.seconds == pytest.approx(1.6 / 1600)
    for quantity in ("force_error", "displacement_error", "energy"):
        assert getattr(row, quantity) == pytest.approx(getattr(own, quantity), rel=1e-9)


@pytest.mark.parametrize("name", side_by_side.PROGRAMS)
def test_a_missing_program_is_named_with_what_to_install(name, tmp_path):
    command = [sys.executable, str(SCRIPT), "--programs", name, "--python", f"{name}={tmp_path / 'no-python'}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert f"{name}: {side_by_side.PROGRAMS[name].install}" in done.stderr
    assert "nothing was run" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("given", ["opensees", "opensees=", "nastran=/usr/bin/python3"])
def test_a_wrong_python_is_refused(given, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["side_by_side.py", "--python", given])
    with pytest.raises(SystemExit) as ended:
        side_by_side.main()
    assert ended.value.code == 2
    assert f"expected NAME=PATH with a name among opensees, akantu, siconos, found {given!r}" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "module"), [("opensees", "openseespy"), ("akantu", "akantu")])
def test_leap_frog_programs_have_the_errors_of_central_difference_with_a_penalty(name, module, own):
    if side_by_side.called(sys.executable, side_by_side.PROGRAMS[name].script, "--version").returncode:
        pytest.skip(f"{module} is not installed: percuss[side-by-side]")
    (row,) = side_by_side.others([name], {name: sys.executable}, 1, 1)
    for quantity in ("force_error", "displacement_error", "energy"):
        assert getattr(row, quantity) == pytest.approx(getattr(own, quantity), rel=1e-9)


def test_siconos_has_the_impact():
    program = side_by_side.PROGRAMS["siconos"]
    if side_by_side.called(program.python, program.script, "--version").returncode:
        pytest.skip("siconos is not installed: python3-siconos")
    (row,) = side_by_side.others(["siconos"], {"siconos": program.python}, 1, 1)
    assert row.force_error < 0.05
    assert row.displacement_error < 0.03
    assert 0.99 < row.energy <= 1.0


def test_the_extra_names_the_programs_that_pip_installs():
    text = (SCRIPT.parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    (line,) = [line for line in text.splitlines() if line.startswith("side-by-side = ")]
    names = [need.partition(">=")[0] for need in json.loads(line.partition(" = ")[2])]
    assert names == ["akantu", "openseespy"]


def test_percuss_has_two_blocks_that_meet_squarely():
    row = side_by_side_solids.with_percuss("blocks", next(iter(side_by_side_solids.OWN["blocks"])), 1)
    assert row.mean == pytest.approx(0.025, rel=0.005)
    assert row.contact_time == pytest.approx(2.0, abs=0.13)
    assert row.energy == pytest.approx(1.0 - 0.5 * 0.025)  # 1 - h/2L, exactly, of Lagrange multipliers
    assert row.restitution**2 == pytest.approx(row.energy, abs=0.07)  # the rest of it is in waves
    assert row.force_error < 0.06


@pytest.mark.parametrize("name", side_by_side_solids.PROGRAMS)
def test_a_program_for_solids_that_is_missing_has_a_row_and_its_input_stays(name, tmp_path):
    rows = list(side_by_side_solids.others("blocks", name, str(tmp_path / "no-python"), tmp_path))
    program = side_by_side_solids.PROGRAMS[name]
    assert [row.told for row in rows] == [f"not installed: {program.install}"] * len(program.methods["blocks"])
    for method in program.methods["blocks"]:
        folder = tmp_path / f"blocks-{name}-{method}"
        assert (folder / program.script).is_file()
        problem = json.loads((folder / "problem.json").read_text())
        assert len(problem["bodies"]) == len(problem["surfaces"]) == 2


@pytest.mark.parametrize("method", solids_with_calculix.METHODS)
def test_the_input_of_calculix_is_written(method, tmp_path):
    model = side_by_side_solids.model_of("blocks", {})
    solids_with_calculix.write(side_by_side_solids.problem_of("blocks", model), tmp_path, method)
    text = (tmp_path / "blocks.inp").read_text()
    assert text.count("*ELEMENT, TYPE=C3D8") == 2
    assert f"TYPE={solids_with_calculix.METHODS[method][1]}\nSLAVE, MASTER" in text
    assert f"{model.dt!r}, {model.dt * model.steps!r}, , {model.dt!r}" in text


@pytest.mark.parametrize("method", solids_with_kratos.METHODS)
def test_the_input_of_kratos_is_written(method, tmp_path):
    problem = side_by_side_solids.problem_of("blocks", side_by_side_solids.model_of("blocks", {}))
    solids_with_kratos.write(problem, tmp_path, method)
    mesh = (tmp_path / "blocks.mdpa").read_text()
    first, _, second = mesh.partition("Begin Elements")[2].partition("End Elements")
    assert len(first.splitlines()) == 1 + 400
    assert len(second.partition("Begin Conditions")[2].partition("End Conditions")[0].splitlines()) == 1 + 20
    parameters = json.loads((tmp_path / "parameters.json").read_text())
    assert parameters["solver_settings"]["time_stepping"]["time_step"] == problem["dt"]
    assert parameters["processes"]["contact_process_list"][0]["Parameters"]["assume_master_slave"] == {"0": ["slave"]}


def test_the_input_of_akantu_is_written(tmp_path):
    pytest.importorskip("meshioplusplus")
    problem = side_by_side_solids.problem_of("blocks", side_by_side_solids.model_of("blocks", {}))
    solids_with_akantu.write(problem, tmp_path)
    mesh = mesh_in((tmp_path / "blocks.msh").read_text(), "blocks.msh")
    sizes = {name: {kind: len(rows) for kind, rows in group.items()} for name, group in mesh.groups.items()}
    assert sizes == {"left": {"quad": 200}, "right": {"quad": 200}, "seam": {"line": 20}}
    assert (mesh.nodes[mesh.cells["line"], 1] == 1.0).all()
    assert f"epsilon_n = {0.25 * 10 / 0.05:.6g}" in (tmp_path / "blocks.dat").read_text()


@pytest.fixture(scope="module")
def ball_problem():
    """Return the ball on a wall in the words of the scripts."""
    pytest.importorskip("meshioplusplus")
    return side_by_side_solids.problem_of("ball", side_by_side_solids.model_of("ball", {}))


@pytest.mark.parametrize(("method", "steps"), [("implicit-alm", 32), ("explicit-penalty", 1)])
def test_the_ball_for_kratos_is_written(method, steps, ball_problem, tmp_path):
    solids_with_kratos.write(ball_problem, tmp_path, method)
    mesh = (tmp_path / "blocks.mdpa").read_text()
    cells, _, facets = mesh.partition("SmallDisplacementElement3D4N")[2].partition("SurfaceCondition3D3N")
    assert cells.partition("End")[0].count("\n") == 1 + sum(len(body["cells"]) for body in ball_problem["bodies"])
    assert facets.partition("End")[0].count("\n") == 1 + sum(map(len, ball_problem["surfaces"]))
    solver = json.loads((tmp_path / "parameters.json").read_text())["solver_settings"]
    assert solver["domain_size"] == 3
    assert solver["time_stepping"]["time_step"] == steps * ball_problem["dt"]


def test_the_ball_for_akantu_is_written(ball_problem, tmp_path):
    solids_with_akantu.write(ball_problem, tmp_path)
    mesh = mesh_in((tmp_path / "blocks.msh").read_text(), "blocks.msh")
    sizes = {name: {kind: len(rows) for kind, rows in group.items()} for name, group in mesh.groups.items()}
    ball, wall = (len(body["cells"]) for body in ball_problem["bodies"])
    skin, _ = map(len, ball_problem["surfaces"])
    assert sizes == {
        "ball": {"tetra": ball}, "wall": {"tetra": wall}, "skin": {"triangle": skin}, "floor": {"triangle": 2},
    }  # fmt: skip
    a, b, c = mesh.nodes[mesh.cells["triangle"][mesh.groups["floor"]["triangle"]]].swapaxes(0, 1)
    assert (np.cross(b - a, c - a)[:, 2] < 0).all()  # against the order of the other programs
    text = (tmp_path / "blocks.dat").read_text()
    assert "master = floor\n  slave = skin" in text


def test_other_programs_meet_the_wall_as_a_held_block(ball_problem):
    problem = ball_problem
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
    assert (nodes[skin, 2] < side_by_side_solids.LOW).all()
    low, high = side_by_side_solids.WALL
    assert ((nodes[skin, :2] > low) & (nodes[skin, :2] < high)).all()


def test_the_page_has_a_row_for_each_method_of_each_program():
    page = (SCRIPT.parents[1] / "README.md").read_text(encoding="utf-8")
    part = page.partition(side_by_side_solids.FIRST)[2].partition(side_by_side_solids.LAST)[0]
    blocks, _, ball = part.partition(side_by_side_solids.TITLES["ball"])
    for case, rows in {"blocks": blocks, "ball": ball}.items():
        expected = [("percuss", words) for words in side_by_side_solids.OWN[case]]
        for name, program in side_by_side_solids.PROGRAMS.items():
            expected += [(name, words) for words in program.methods[case].values()]
        found = [tuple(cell.strip() for cell in line.split("|")[1:3]) for line in rows.splitlines() if "|" in line][2:]
        assert [(name.split()[0], words) for name, words in found] == expected
    assert all(f"`{program.install}`" in page for program in side_by_side_solids.PROGRAMS.values())
