"""Bodies from mesh files of gmsh: what is read is what is in the file, and every other file is one message."""

import re
from pathlib import Path

import numpy as np
import pytest

import percuss
import places
from command_line import percuss_command
from marks import deep
from percuss.case.mesh_file import ENCODING, mesh_in
from percuss.errors import InputError
from percuss_methods.shapes.mesh import MeshFromFile

pytest.importorskip("meshioplusplus")
# Made with gmsh 4.15, as text and as bytes of both versions: a rectangle 2 by 1 of triangles and of quadrilaterals, a
# box 1 by 1 by 2 of tetrahedra and of hexahedra, with `bottom` and `top` at the ends of the last coordinate; and
# `parts`, the box of two parts `low` and `high`, which are `both` too.
MADE_BY_GMSH = Path(__file__).parents[1] / "support" / "meshes"
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
ELEMENTS = TWO_TRIANGLES.partition("$Elements")[2]
UNGROUPED = re.sub(r"^(\d \d 2) \d", r"\1 0", ELEMENTS, flags=re.MULTILINE)


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
        ("3 2 2 1 1 1 3 2", "3 2 2 1 1 1 3 77", "cannot read this mesh of gmsh: plate.msh: an element names a node"),
        ("3 2 1 0", "3 2 0 0", "found 1 of 2 that are flat or fold over, the first about (1.33333, 0, 0): plate.msh"),
        ("$Nodes", "$PartitionedEntities\n$EndPartitionedEntities\n$Nodes", "without partitions: plate.msh"),
        (ELEMENTS, UNGROUPED, "No cell has a group. Where gmsh saves all cells (Mesh.SaveAll), version 2.2 loses"),
        ('3\n1 2 "left"', '4\n1 7 "none"\n1 2 "left"', "found none in 'none': plate.msh"),
        ("4 2 2 1 1 1 3 4", "4 6 2 1 1 1 2 3 4 9 9", "percuss has no element for wedge: mesh it without"),
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


def assert_same(one, other):
    """Raise AssertionError unless two texts hold the same nodes, cells and groups."""
    one, other = (mesh_in(text, "plate.msh") for text in (one, other))
    assert one.nodes.tolist() == other.nodes.tolist()
    for found, expected in (
        (one.cells, other.cells),
        *((one.groups[name], other.groups[name]) for name in other.groups),
    ):
        assert {kind: rows.tolist() for kind, rows in found.items()} == {k: v.tolist() for k, v in expected.items()}


def test_results_in_a_mesh_file_are_passed_over():
    """Also those on some of the nodes."""
    assert_same(TWO_TRIANGLES + '$NodeData\n1\n"T"\n1\n0\n3\n0\n1\n2\n1 0.5\n2 0.25\n$EndNodeData\n', TWO_TRIANGLES)


def test_a_part_of_a_group_that_gmsh_has_turned_around_belongs_to_it():
    """Version 4.1 then has the number of the group with a minus."""
    usual = made_by_gmsh("triangle-4.1-text")
    entities = usual.partition("$Entities")[2].partition("$EndEntities")[0]
    turned = re.sub(r"^(\d+(?: \S+){6} 1) (?=\d)", r"\1 -", entities, flags=re.MULTILINE)
    assert turned != entities
    assert_same(usual.replace(entities, turned), usual)


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
        ("contacts.stop.body=plate.lift", "Did you mean 'left'?"),
        ("refine=1.5", "refine: expected a whole number for a mesh from a file, found 1.5"),
        ("refine=1e6", "refine: expected elements that fit into memory"),
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
    assert "give `--reference refine=4`" in done.stdout + done.stderr
    (tmp_path / "plate.msh").unlink()
    again = percuss.open_result(tmp_path / "plate.nc")
    assert again.provenance["data_files"] == {"plate.msh": TWO_TRIANGLES}
    assert percuss_command("verify", "plate.nc", cwd=tmp_path, plain=True).returncode == 0


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        deep({}, None),
        ({"bodies.plate.fixed": [{"on": "skin", "along": "y"}]}, None),
        ({"contacts.stop.body": "plate.skin"}, "'plate.skin', which is in contact, is no face across the axis"),
        ({"bodies.plate.material.poisson": 0.3}, "body 'plate' contracts, and no rollers hold its side at [0.25, 0.0]"),
    ],
)
def test_a_rectangle_from_a_file_is_judged_by_the_exact_solution_of_a_bar(changes, reason, tmp_path):
    (tmp_path / "plate.msh").write_text(TWO_TRIANGLES, encoding="utf-8")
    (tmp_path / "case.yaml").write_text(CASE.replace("0.3}", "0}"), encoding="utf-8")
    result = percuss.run(percuss.load(tmp_path / "case.yaml", {"refine": 4, "time.end": 5, **changes}))
    assert result.summary["exact_reason"] == (reason and f"the bodies do not move as a row of bars: {reason}")
    if reason is None:
        assert result.solution.contacts["stop"].force(np.array([1.0, 3.9, 4.1])) == pytest.approx([0.1, 0.1, 0.0])


@pytest.mark.parametrize(("at", "pieces"), [(None, 1), (0, 2), (3, 2)])
def test_a_mesh_in_pieces_is_told_by_check_and_run(tmp_path, at, pieces):
    text = TWO_TRIANGLES
    if at is not None:  # the second triangle has nodes of its own
        nodes = f"8\n10 {at} 0 0\n11 {at} 1 0\n12 {at + 2} 1 0\n1 0"
        text = text.replace("5\n1 0", nodes).replace("1 3 4\n", "10 12 11\n").replace("1 4 1\n", "1 11 10\n")
    (tmp_path / "plate.msh").write_text(text, encoding="utf-8")
    (tmp_path / "case.yaml").write_text(CASE.replace("plate.left", "plate.skin"), encoding="utf-8")
    case = percuss.load(tmp_path / "case.yaml")
    said = "is in 2 pieces without a common node, which move each for itself: the smallest has 1 of 2"
    for told in (percuss.check(case).text, *percuss.run(case).summary["notes"][:1]):
        assert (said in " ".join(told.split())) is (pieces == 2)


def made_by_gmsh(name):
    return (MADE_BY_GMSH / f"{name}.msh").read_bytes().decode(ENCODING)


FORMS = [f"{version}-{mode}" for version in ("2.2", "4.1") for mode in ("text", "bytes")]
FILES = [f"{kind}-{form}" for kind in ("triangle", "quad", "tetra", "hexahedron") for form in FORMS]


def volume(mesh):
    """Return the area or volume inside the boundary, by the divergence theorem: not by the cells."""
    corners = mesh.nodes[next(iter(mesh.regions["skin"].facets.values()))]
    if mesh.nodes.shape[1] == 2:
        a, b = corners[:, 0], corners[:, 1]
        return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2
    pairs = [(1, 2), (2, 3)][: corners.shape[1] - 2]
    return sum((corners[:, 0] * np.cross(corners[:, j], corners[:, k])).sum() for j, k in pairs) / 6


@pytest.mark.parametrize("name", FILES)
def test_files_that_gmsh_made_are_the_bodies_that_it_was_asked_for(name):
    shape = body(made_by_gmsh(name))
    mesh = shape.mesh(np.zeros(shape.dimension()), 1)
    kind, dim = name.partition("-")[0], shape.dimension()
    assert (shape.cell, dim) == (kind, 2 if kind in {"triangle", "quad"} else 3)
    assert mesh.nodes.max(axis=0).tolist() == {2: [2, 1], 3: [1, 1, 2]}[dim]
    assert volume(mesh) == pytest.approx(2.0, rel=1e-14)
    assert shape.regions == ("bottom", "top", "skin")
    for region, sign in (("bottom", -1.0), ("top", 1.0)):
        assert mesh.regions[region].outward == pytest.approx(np.eye(dim)[-1] * sign, abs=1e-15)
        assert set(mesh.nodes[list(mesh.regions[region].nodes)][:, -1]) == {
            0.0 if sign < 0 else mesh.nodes[:, -1].max()
        }


@pytest.mark.parametrize("form", FORMS)
def test_a_cell_in_two_groups_is_one_cell_or_the_file_is_refused(form):
    text = made_by_gmsh(f"parts-{form}")
    if form.startswith("4.1"):
        with pytest.raises(ValueError, match="expected cells in each physical group, found none in 'both'"):
            body(text)
        return
    low, whole = (body(text, part=part).mesh(np.zeros(3), 1) for part in ("low", ""))
    assert len(whole.cells["tetra"]) == len(np.unique(np.sort(whole.cells["tetra"]), axis=0))
    assert (volume(low), volume(whole)) == pytest.approx((1.0, 2.0), rel=1e-14)


@pytest.mark.parametrize(("corner", "folds"), [(0.9, False), (0.5, True), (0.2, True)])
def test_a_quadrilateral_is_convex_or_refused(corner, folds):
    square = TWO_TRIANGLES.replace("4\n1 1 2", "3\n1 1 2").replace("3 2 1 0", f"3 {2 * corner} {corner} 0")
    text = square.replace("3 2 2 1 1 1 3 2\n4 2 2 1 1 1 3 4", "3 3 2 1 1 1 2 3 4")
    if folds:
        with pytest.raises(ValueError, match="found 1 of 1 that are flat or fold over"):
            body(text)
    else:
        assert volume(body(text).mesh(np.zeros(2), 1)) == pytest.approx(2 * corner)


def test_a_turned_hexahedron_is_turned_back_and_a_twisted_one_refused():
    rows = made_by_gmsh("hexahedron-2.2-text").splitlines()
    at = next(k for k, row in enumerate(rows) if row.split()[1:2] == ["5"])
    *tags, a, b, c, d, e, f, g, h = rows[at].split()
    rows[at] = " ".join([*tags, e, f, g, h, a, b, c, d])
    assert volume(body("\n".join(rows) + "\n").mesh(np.zeros(3), 1)) == pytest.approx(2.0)
    rows[at] = " ".join([*tags, a, b, c, d, f, e, g, h])
    with pytest.raises(ValueError, match="1 of 8 that are flat or fold over"):
        body("\n".join(rows) + "\n")


def test_without_the_reader_of_meshes_a_case_says_where_and_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "meshioplusplus", None)
    with pytest.raises(InputError) as told:
        percuss.load(places.CASES / "ball-on-wall-3d.yaml")
    assert re.search(r"ball-on-wall-3d\.yaml:\d+:\d+: .*meshioplusplus", str(told.value))
    assert "pip install 'percuss[mesh]'" in str(told.value)
