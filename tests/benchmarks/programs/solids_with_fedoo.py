"""Two blocks with fedoo: central difference with lumped masses and penalty contact.

The contact is that of nodes and segments. Its stiffness `eps_n` is a force for each node and length, and is to be
chosen by the rigidity of the bodies. Here it is a quarter of Young's modulus, a quarter of the stiffness of a row of
cells: of 2, 1, 1/2 and 1/4 times the modulus, this gave the smallest peak of the force. The weak form is updated in
each step, as fedoo asks for where there is contact.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

NAMES = ("DispX", "DispY")


def run(problem):
    """Return the result of a problem."""
    import fedoo as fd

    bodies, axis, dt = problem["bodies"], problem["axis"], problem["dt"]
    fd.ModelingSpace("2Dplane")
    nodes = np.concatenate([body["nodes"] for body in bodies])
    mesh = fd.Mesh(nodes, np.concatenate([body["cells"] for body in bodies]), "quad4")
    material = fd.constitutivelaw.ElasticIsotrop(bodies[0]["young"], bodies[0]["poisson"])
    material.set_density(bodies[0]["density"])
    solid = fd.Assembly.create(fd.weakform.StressEquilibrium(material), mesh)
    slave, master = (np.unique(surface) for surface in problem["surfaces"])
    skin = fd.mesh.extract_surface(fd.Mesh(nodes, np.array(bodies[1]["cells"]), "quad4"))
    facing = [facet for facet in skin.elements if set(facet) <= set(master)]
    contact = fd.constraint.Contact(slave, fd.Mesh(nodes, np.array(facing), "lin2"))
    contact.eps_n = 0.25 * bodies[0]["young"]
    contact.max_dist = 0.1
    speed = np.concatenate([np.tile(body["velocity"], (len(body["nodes"]), 1)) for body in bodies])
    mass, struck = np.array(problem["mass"]), slice(bodies[-1]["first_node"], None)
    assembly = fd.Assembly.sum(solid, contact)
    momentum = [float(mass[struck] @ speed[struck, axis])]
    pb = fd.problem.ExplicitDynamic(assembly, time_step=dt)
    for k, name in enumerate(NAMES):
        pb.set_initial_velocity(name, speed[:, k])
    seconds = 0.0
    for _ in range(problem["steps"]):
        started = time.process_time()
        pb.solve_time_increment(update_weakform=True, set_start=True)
        seconds += time.process_time() - started
        momentum.append(float(mass[struck] @ pb.get_velocity(NAMES[axis])[struck]))
    return {
        "seconds": seconds,
        "momentum": momentum,
        "displacement": np.array([pb.get_disp(name) for name in NAMES]).T.tolist(),
        "velocity": np.array([pb.get_velocity(name) for name in NAMES]).T.tolist(),
    }


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        from importlib import metadata

        print(metadata.version("fedoo"))
    else:
        found = run(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
        (Path(sys.argv[2]) / "result.json").write_text(json.dumps(found), encoding="utf-8")
