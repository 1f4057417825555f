"""Two blocks, and a ball on a wall, with fedoo: central difference with lumped masses and penalty contact.

The contact is that of nodes and facets. Its stiffness `eps_n` is a force for each node and length, and is to be
chosen by the rigidity of the bodies. For the blocks it is a quarter of Young's modulus, a quarter of the stiffness of a
row of cells: of 2, 1, 1/2 and 1/4 times the modulus, this gave the smallest peak of the force. For the ball it is 4
times the modulus times the shortest side of the surface; with 1/4 of that product, the contact lasted too long.
Facets are searched by the nearest node: the default search, by buckets, found no contact with a wall of two facets.
The weak form is updated in each step, as fedoo asks for where there is contact.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

SPACES = {2: "2Dplane", 3: "3D"}
KINDS = {2: ("quad4", "lin2"), 3: ("tet4", "tri3")}  # cells and facets
NAMES = ("DispX", "DispY", "DispZ")


def run(problem):
    """Return the result of a problem."""
    import fedoo as fd

    bodies, axis, dt = problem["bodies"], problem["axis"], problem["dt"]
    dim = len(bodies[0]["velocity"])
    names, (kind, facet_kind) = NAMES[:dim], KINDS[dim]
    fd.ModelingSpace(SPACES[dim])
    nodes = np.concatenate([body["nodes"] for body in bodies])
    mesh = fd.Mesh(nodes, np.concatenate([body["cells"] for body in bodies]), kind)
    material = fd.constitutivelaw.ElasticIsotrop(bodies[0]["young"], bodies[0]["poisson"])
    material.set_density(bodies[0]["density"])
    solid = fd.Assembly.create(fd.weakform.StressEquilibrium(material), mesh)
    slave, master = (np.unique(surface) for surface in problem["surfaces"])
    sides = [np.linalg.norm(np.diff(nodes[facet], axis=0), axis=1).min() for facet in problem["surfaces"][0]]
    skin = fd.mesh.extract_surface(fd.Mesh(nodes, np.array(bodies[1]["cells"]), kind))
    facing = [facet for facet in skin.elements if set(facet) <= set(master)]
    facing = fd.Mesh(nodes, np.array(facing), facet_kind)
    contact = fd.constraint.Contact(slave, facing, search_algorithm="search_nearest")
    contact.eps_n = bodies[0]["young"] * (0.25 if dim == 2 else 4.0 * min(sides))
    contact.max_dist = 0.1 if dim == 2 else 2.0
    speed = np.concatenate([np.tile(body["velocity"], (len(body["nodes"]), 1)) for body in bodies])
    struck = slice(*problem["struck"])
    mass = np.array(problem["mass"])[struck]
    assembly = fd.Assembly.sum(solid, contact)
    momentum = [float(mass @ speed[struck, axis])]
    pb = fd.problem.ExplicitDynamic(assembly, time_step=dt)
    for k, name in enumerate(names):
        pb.set_initial_velocity(name, speed[:, k])
    for node, k in problem["fixed"]:
        pb.bc.add("Dirichlet", node, names[k], 0.0)
    seconds = 0.0
    for _ in range(problem["steps"]):
        started = time.process_time()
        pb.solve_time_increment(update_weakform=True, set_start=True)
        seconds += time.process_time() - started
        momentum.append(float(mass @ pb.get_velocity(NAMES[axis])[struck]))
    return {
        "seconds": seconds,
        "momentum": momentum,
        "displacement": np.array([pb.get_disp(name) for name in names]).T.tolist(),
        "velocity": np.array([pb.get_velocity(name) for name in names]).T.tolist(),
    }


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        from importlib import metadata

        print(metadata.version("fedoo"))
    else:
        found = run(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
        (Path(sys.argv[2]) / "result.json").write_text(json.dumps(found), encoding="utf-8")
