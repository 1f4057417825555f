"""Two bars in impact with Akantu: its explicit scheme with lumped masses, the contact spring as an external force.

The contact models of Akantu are for two and three dimensions. In one dimension the force of the spring is computed in
Python, at the place where the scheme asks for the forces of a step.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import akantu


def write_mesh(problem, path):
    """Write the nodes and elements of both bars as a mesh of Gmsh; return the number of nodes of each."""
    nodes, elements, counts = [], [], []
    for bar in problem["bars"]:
        n = bar["elements"]
        first = len(nodes) + 1
        nodes += [bar["at"] + bar["length"] * k / n for k in range(n + 1)]
        elements += [(first + k, first + k + 1) for k in range(n)]
        counts.append(n + 1)
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(nodes))]
    lines += [f"{k} {x!r} 0 0" for k, x in enumerate(nodes, 1)]
    lines += ["$EndNodes", "$Elements", str(len(elements))]
    lines += [f"{k} 1 2 1 1 {a} {b}" for k, (a, b) in enumerate(elements, 1)]
    path.write_text("\n".join([*lines, "$EndElements", ""]), encoding="ascii")
    return counts


def run(problem, folder):
    """Return the result of a problem, whose bars have one material and the area 1."""
    first, second = problem["bars"]
    if (first["young"], first["density"]) != (second["young"], second["density"]) or first["area"] != second["area"]:
        raise SystemExit("the mesh for Akantu has one material")
    area = first["area"]  # that of an element is 1: modulus and density are those of the whole section
    material = Path(folder) / "material.dat"
    young, density = first["young"] * area, first["density"] * area
    material.write_text(f"material elastic [\n name = bar\n rho = {density!r}\n E = {young!r}\n]\n", encoding="ascii")
    mesh_file = Path(folder) / "bars.msh"
    left, _ = write_mesh(problem, mesh_file)
    akantu.parseInput(str(material))
    mesh = akantu.Mesh(1)
    mesh.read(str(mesh_file))
    model = akantu.SolidMechanicsModel(mesh)
    model.initFull(_analysis_method=akantu._explicit_lumped_mass)
    model.setTimeStep(problem["dt"])
    u, velocity, external = model.getDisplacement(), model.getVelocity(), model.getExternalForce()
    velocity[:left, 0], velocity[left:, 0] = first["velocity"], second["velocity"]
    model.getBlockedDOFs()[-1, 0] = True
    stiffness = problem["penalty"]

    class Contact(akantu.InterceptSolverCallback):
        force = 0.0

        def assembleResidual(self):
            gap = u.item(left) - u.item(left - 1)
            self.force = -stiffness * gap if gap < 0.0 else 0.0
            external[left - 1, 0], external[left, 0] = -self.force, self.force
            super().assembleResidual()

    contact = Contact(model)
    steps = problem["steps"]
    force = [0.0] * (steps + 1)
    before = u.copy()
    started = time.process_time()
    for k in range(steps):
        if k == steps - 1:
            before = u.copy()
        model.solveStep(contact)
        force[k + 1] = contact.force
    seconds = time.process_time() - started
    return {
        "seconds": seconds,
        "time": [k * problem["dt"] for k in range(steps + 1)],
        "force": force,
        "displacement": u[:, 0].tolist(),
        "before": before[:, 0].tolist(),
    }


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        print(akantu.__version__)
    else:
        with tempfile.TemporaryDirectory() as folder:
            result = run(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), folder)
        Path(sys.argv[2]).write_text(json.dumps(result), encoding="utf-8")
