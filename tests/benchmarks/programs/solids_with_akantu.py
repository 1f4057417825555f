"""Two blocks, and a ball on a wall, with Akantu: its solid and contact models coupled, penalty at nodes.

The method is explicit, with lumped masses. Mesh and materials are written into the folder of the run, as for the
example of Akantu that compresses two blocks. The penalty `epsilon_n` multiplies overlap and area.

For the blocks, version 5.0.7 needs three choices:

- The axes are turned, so that the blocks meet along y: with surfaces that lie along y, no contact was found, as the
  size of a segment is taken along x.
- Both surfaces are slave and master, and the master is not deformable: each node is pressed once, by its overlap. Where
  the master is deformable, the contact forces did not sum to 0, and the momentum of both blocks changed.
- The penalty is a quarter of Young's modulus over the side of a cell: of 2, 1, 1/2 and 1/4 times that, this gave the
  smallest error of the force.

On the ball:

- The nodes of the ball are slaves of the wall. The facets of the wall are written in the opposite order of their nodes;
  in the order of the other programs, no contact was found. With a deformable master, the force of a penalty was half.
- The penalty is twice the modulus over the shortest side of the surface. With 1/4, 1, 2, 4 and 8 times that quotient,
  the peak was .00326, .00340, .00343, .00346 and .00350, and the contact time 12.29, 11.61, 11.50, 11.43 and 11.39.
  With 16 times, the motion grew without bound. 2 is kept: it has the smallest errors of both.
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
  master = {master}
  slave = {slave}
  projection_tolerance = 1e-10
  max_iterations = 100
  extension_tolerance = 1e-5
]
contact_resolution penalty_linear [
  name = {master}
  mu = 0.0
  epsilon_n = {stiffness!r}
  is_master_deformable = false
]
"""
KINDS = {2: (3, 1), 3: (4, 2)}  # of cells and facets in a file of Gmsh
SIDES = {2: ("seam", "seam"), 3: ("skin", "floor")}  # slave and master
STIFF = {2: 0.25, 3: 2.0}  # penalty over the modulus, times the shortest side of the surface


def turned(vectors, way=1):
    """Return vectors of the plane turned by a right angle, from x to y, or back with -1; those in space as they are."""
    return [[-way * vector[1], way * vector[0]] if len(vector) == 2 else vector for vector in vectors]


def write(problem, folder):
    """Write mesh and materials."""
    bodies = problem["bodies"]
    nodes = turned(place for body in bodies for place in body["nodes"])
    dim = len(nodes[0])
    kind, facet_kind = KINDS[dim]
    slave, master = SIDES[dim]
    surfaces = {}
    for name, surface in zip((slave, master), problem["surfaces"], strict=True):
        order = -1 if name == "floor" else 1
        surfaces.setdefault(name, []).extend(facet[::order] for facet in surface)
    groups = [(dim, kind, body["name"], body["cells"]) for body in bodies]
    groups += [(dim - 1, facet_kind, name, surface) for name, surface in surfaces.items()]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(groups))]
    lines += [f'{size} {tag} "{name}"' for tag, (size, _, name, _) in enumerate(groups, 1)]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(nodes))]
    lines += [f"{k} {' '.join(repr(x) for x in [*place, 0.0][:3])}" for k, place in enumerate(nodes, 1)]
    cells = [(kind, tag, cell) for tag, (_, kind, _, group) in enumerate(groups, 1) for cell in group]
    lines += ["$EndNodes", "$Elements", str(len(cells))]
    lines += [
        f"{k} {kind} 2 {tag} {tag} {' '.join(str(node + 1) for node in cell)}"
        for k, (kind, tag, cell) in enumerate(cells, 1)
    ]
    (folder / "blocks.msh").write_text("\n".join([*lines, "$EndElements", ""]), encoding="ascii")
    sides = np.linalg.norm(np.diff(np.array(nodes)[np.array(problem["surfaces"][0])], axis=1), axis=2)
    stiffness = STIFF[dim] * bodies[0]["young"] / float(sides.min())
    text = "".join(MATERIAL.format(**body) for body in bodies)
    text += CONTACT.format(slave=slave, master=master, stiffness=stiffness)
    (folder / "blocks.dat").write_text(text, encoding="ascii")


def run(problem, folder):
    """Return the result of a problem whose input is in a folder."""
    import akantu

    akantu.parseInput(str(folder / "blocks.dat"))
    dim = len(problem["bodies"][0]["velocity"])
    mesh = akantu.Mesh(dim)
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
    blocked = solid.getBlockedDOFs()
    for node, k in problem["fixed"]:
        blocked[node, k] = True
    axis = {2: 1 - problem["axis"], 3: problem["axis"]}[dim]
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
        "displacement": turned(solid.getDisplacement().tolist(), -1),
        "velocity": turned(velocity.tolist(), -1),
    }  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        import akantu

        print(akantu.__version__)
    else:
        problem, folder = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2])
        write(problem, folder)
        (folder / "result.json").write_text(json.dumps(run(problem, folder)), encoding="utf-8")
