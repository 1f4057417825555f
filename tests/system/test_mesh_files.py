"""Bodies from mesh files of gmsh: what is read is what is in the file, and every other file is one message."""

import numpy as np
import pytest

import percuss
from command_line import percuss_command
from percuss.case.mesh_file import ENCODING, mesh_in
from percuss_methods.shapes.mesh import MeshFromFile

pytest.importorskip("meshioplusplus")
ASCII = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
TWO_TRIANGLES = (
    ASCII
    + """$PhysicalNames
3
1 2 "left"
1 4 "right"
2 1 "plate"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 2 0 0
3 2 1 0
4 0 1 0
9 7 7 0
$EndNodes
$Elements
4
1 1 2 2 1 4 1
2 1 2 4 2 2 3
3 2 2 1 1 1 3 2
4 2 2 1 1 1 3 4
$EndElements
"""
)


def body(text, **options):
    return MeshFromFile(mesh_in(text, "plate.msh"), **options)


def test_cells_turn_anticlockwise_unused_nodes_are_left_out_and_groups_are_regions():
    shape = body(TWO_TRIANGLES, scale=0.5)
    mesh = shape.mesh(np.array([1.0, 2.0]), 1)
    assert mesh.nodes.tolist() == [[1.0, 2.0], [2.0, 2.0], [2.0, 2.5], [1.0, 2.5]]
    assert sorted(map(sorted, mesh.cells["triangle"].tolist())) == [[0, 1, 2], [0, 2, 3]]
    corners = mesh.nodes[mesh.cells["triangle"]]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    assert (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0).all()
    assert shape.regions == ("left", "right", "skin")
    assert mesh.regions["left"].outward.tolist() == [-1.0, 0.0]
    assert mesh.regions["right"].facets["line"].tolist() == [[1, 2]]
    assert len(mesh.regions["skin"].facets["line"]) == 4
    assert mesh.regions["skin"].outward.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("$MeshFormat", "solid", "expected a mesh of gmsh, found a file that begins otherwise"),
        ("2.2 0 8", "1.0 0 8", "expected version 2.2 or 4.1 of a mesh of gmsh, found 1.0"),
        ("3 2 2 1 1 1 3 2", "3 2 2 1 1 1 3 77", "damaged mesh of gmsh"),
        ("3 2 2 1 1 1 3 2\n4 2 2 1 1 1 3 4\n", "", "damaged mesh of gmsh"),
        ("3 2 1 0", "3 2 nan 0", "damaged mesh of gmsh"),
        ("4\n1 1 2 2 1 4 1", "4\n1 8 2 2 1 4 1 2", "expected cells of first order"),
        ("2 1 2 4 2 2 3", "2 1 2 4 2 1 3", "1 of 1 facets of 'right' are not on it"),
        ("3 2 1 0", "3 2 1 3", "found a surface in space"),
        ("4 2 2 1 1 1 3 4", "4 3 2 1 1 1 3 4 9", "expected cells of one kind, found triangle and quad cells"),
    ],
)
def test_a_file_that_cannot_be_a_body_is_one_message(old, new, words, tmp_path):
    assert old in TWO_TRIANGLES
    (tmp_path / "plate.msh").write_text(TWO_TRIANGLES.replace(old, new), encoding="utf-8")
    done = run(tmp_path)
    assert done.returncode == 2
    assert words in done.stderr
    assert "bodies.plate.mesh" in done.stderr
    assert "1 mistake; nothing was run" in done.stderr


CASE = """percuss: 1
bodies:
  plate:
    mesh: {file: plate.msh, part: plate}
    at: [0, 0]
    material: {young: 1, density: 1, poisson: 0.3}
    velocity: [-0.1, 0]
contacts:
  stop: {body: plate.left, wall: {point: [0, 0], normal: [1, 0]}}
time: {end: 2, courant: 0.5}
"""


def run(folder, *words):
    (folder / "case.yaml").write_text(CASE, encoding="utf-8")
    return percuss_command("run", "case.yaml", *words, cwd=folder, plain=True)


@pytest.mark.parametrize(
    ("word", "words"),
    [
        ("bodies.plate.mesh.part=plat", "expected a physical group of cells of plate.msh, found 'plat'; it has plate"),
        ("bodies.plate.mesh.file=other.msh", "no such file"),
        ("contacts.stop.body=plate.lift", "Did you mean 'left'?"),
        ("refine=2", "refine: expected 1, as the mesh of the body 'plate' is given, found 2"),
    ],
)
def test_a_case_that_does_not_suit_the_file_is_one_message(word, words, tmp_path):
    (tmp_path / "plate.msh").write_text(TWO_TRIANGLES, encoding="utf-8")
    done = run(tmp_path, f"--set={word}")
    assert done.returncode == 2
    assert words in done.stderr


def test_a_result_has_the_file_inside_and_is_made_again_without_it(tmp_path):
    (tmp_path / "plate.msh").write_text(TWO_TRIANGLES, encoding="utf-8")
    done = run(tmp_path, "-o", "plate.nc")
    assert done.returncode == 0, done.stderr
    assert "compare it with one on a finer mesh" in done.stdout + done.stderr
    (tmp_path / "plate.msh").unlink()
    again = percuss.open_result(tmp_path / "plate.nc")
    assert again.provenance["data_files"] == {"plate.msh": TWO_TRIANGLES}
    assert percuss_command("verify", "plate.nc", cwd=tmp_path, plain=True).returncode == 0


@pytest.mark.parametrize("seed", range(40))
def test_a_file_with_wrong_bytes_is_a_mesh_or_one_message(seed):
    random = np.random.default_rng(seed)
    good = TWO_TRIANGLES.encode(ENCODING)
    bad = bytearray(good)
    for _ in range(random.integers(1, 5)):
        bad[random.integers(len(bad))] = random.integers(256)
    text = bytes(bad[: random.integers(len(bad)) if seed % 4 == 0 else None]).decode(ENCODING)
    try:
        shape = body(text)
    except ValueError as error:
        said = str(error)
    else:
        said = ""
    if said:
        assert "plate.msh" in said
        return
    mesh = shape.mesh(np.zeros(2), 1)
    assert np.isfinite(mesh.nodes).all()


def test_meshes_of_the_reader_missing_say_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "meshioplusplus", None)
    with pytest.raises(percuss.PercussError, match=r"pip install 'percuss\[mesh\]'"):
        mesh_in(TWO_TRIANGLES, "plate.msh")
