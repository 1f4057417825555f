"""Two blocks with Akantu: its solid and contact models coupled, explicit with lumped masses, penalty at nodes.

Mesh and materials are written into the folder of the run, as for the example of Akantu that compresses two blocks.
Version 5.0.7 needs three choices:

- The axes are turned, so that the blocks meet along y: with surfaces that lie along y, no contact was found, as the
  size of a segment is taken along x.
- Both surfaces are slave and master, and the master is not deformable: each node is pressed once, by its overlap. Where
  the master is deformable, the contact forces did not sum to 0, and the momentum of both blocks changed.
- The penalty `epsilon_n` multiplies overlap and area. It is a quarter of Young's modulus over the side of a cell: of 2,
  1, 1/2 and 1/4 times that, this gave the smallest error of the force.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

MATERIAL = """material elastic [
  name = {name}
  rho = {density!r}
  E = {young!r}
  nu = {poisson!r}
]
"""
CONTACT = """contact_detector [
  type = explicit
  master = seam
  slave = seam
  projection_tolerance = 1e-10
  max_iterations = 100
  extension_tolerance = 1e-5
]
contact_resolution penalty_linear [
  name = seam
  mu = 0.0
  epsilon_n = {stiffness!r}
  is_master_deformable = false
]
"""
SEGMENT, SQUARE = 1, 3  # kinds of cells in a file of Gmsh


def turned(vectors):
    """Return vectors turned by a right angle, from x to y."""
    return [[-y, x] for x, y in vectors]


def write(problem, folder):
    """Write mesh and materials."""
    bodies = problem["bodies"]
    nodes = turned(place for body in bodies for place in body["nodes"])
    groups = [(2, SQUARE, body["name"], body["cells"]) for body in bodies]
    groups.append((1, SEGMENT, "seam", [facet for surface in problem["surfaces"] for facet in surface]))
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(groups))]
    lines += [f'{dim} {tag} "{name}"' for tag, (dim, _, name, _) in enumerate(groups, 1)]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(nodes))]
    lines += [f"{k} {x!r} {y!r} 0" for k, (x, y) in enumerate(nodes, 1)]
    cells = [(kind, tag, cell) for tag, (_, kind, _, group) in enumerate(groups, 1) for cell in group]
    lines += ["$EndNodes", "$Elements", str(len(cells))]
    lines += [
        f"{k} {kind} 2 {tag} {tag} {' '.join(str(node + 1) for node in cell)}"
        for k, (kind, tag, cell) in enumerate(cells, 1)
    ]
    (folder / "blocks.msh").write_text("\n".join([*lines, "$EndElements", ""]), encoding="ascii")
    a, b = (np.array(nodes[k]) for k in problem["surfaces"][0][0])
    stiffness = 0.25 * bodies[0]["young"] / float(np.linalg.norm(b - a))
    text = "".join(MATERIAL.format(**body) for body in bodies) + CONTACT.format(stiffness=stiffness)
    (folder / "blocks.dat").write_text(text, encoding="ascii")


def run(problem, folder):
    """Return the result of a problem whose input is in a folder."""
    import akantu

    akantu.parseInput(str(folder / "blocks.dat"))
    mesh = akantu.Mesh(2)
    mesh.read(str(folder / "blocks.msh"))
    coupler = akantu.CouplerSolidContact(mesh)
    solid, contact = coupler.getSolidMechanicsModel(), coupler.getContactMechanicsModel()
    materials = akantu.MeshDataMaterialSelectorString("physical_names", solid)
    solid.setMaterialSelector(materials)
    coupler.initFull(_analysis_method=akantu._explicit_lumped_mass)
    surfaces = akantu.PhysicalSurfaceSelector(mesh)
    contact.getContactDetector().setSurfaceSelector(surfaces)
    coupler.setTimeStep(problem["dt"])
    velocity = solid.getVelocity()
    for body in problem["bodies"]:
        own = slice(body["first_node"], body["first_node"] + len(body["nodes"]))
        velocity[own] = turned([body["velocity"]])
    axis = 1 - problem["axis"]
    mass, struck = np.array(problem["mass"]), slice(*problem["struck"])
    momentum = [float(mass[struck] @ velocity[struck, axis])]
    seconds = 0.0
    for _ in range(problem["steps"]):
        started = time.process_time()
        coupler.solveStep()
        seconds += time.process_time() - started
        momentum.append(float(mass[struck] @ velocity[struck, axis]))
    return {
        "seconds": seconds, "momentum": momentum,
        "displacement": [[y, -x] for x, y in solid.getDisplacement().tolist()],
        "velocity": [[y, -x] for x, y in velocity.tolist()],
    }  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        import akantu

        print(akantu.__version__)
    else:
        problem, folder = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2])
        write(problem, folder)
        (folder / "result.json").write_text(json.dumps(run(problem, folder)), encoding="utf-8")
