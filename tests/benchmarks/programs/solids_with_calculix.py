"""Two blocks, and a ball on a wall, with CalculiX (`ccx`): the input file is written from the template below.

A square becomes a hexahedron (C3D8) of thickness 1 that is held across the plane, as elements of plane strain are;
nodes in contact are left free, as massless contact asks for, and Poisson's ratio is 0. Penalty contact has the
stiffness 10 E, for the ball 50 E, for each length of overlap, within the 5 E to 50 E that the manual advises. The
implicit method has no numerical damping. A step of it takes long on the ball, of tetrahedra (C3D4): there it is 16
steps of percuss long, and momentum is taken as linear within it. With 10 E and steps of four times that length the peak
was lower and the contact longer. Massless contact is hard and has no parameter. The time is that of the whole run.
"""

import json
import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

METHODS = {
    "implicit-penalty": ("*DYNAMIC, DIRECT, ALPHA=0", "SURFACE TO SURFACE", "LINEAR\n{stiffness!r}, 0., 0."),
    "explicit-penalty": ("*DYNAMIC, EXPLICIT", "NODE TO SURFACE", "LINEAR\n{stiffness!r}, 1e-9, 1e-3"),
    "explicit-massless": ("*DYNAMIC, EXPLICIT", "MASSLESS", "HARD"),
}
INPUT = """*HEADING
Impact of two blocks
*NODE, NSET=ALL
{nodes}
{cells}
*SURFACE, NAME=SLAVE, TYPE=ELEMENT
{slave}
*SURFACE, NAME=MASTER, TYPE=ELEMENT
{master}
*BOUNDARY
{fixed}
*INITIAL CONDITIONS, TYPE=VELOCITY
{velocities}
*SURFACE INTERACTION, NAME=SEAM
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE={behaviour}
*CONTACT PAIR, INTERACTION=SEAM, TYPE={contact}
SLAVE, MASTER
*STEP, INC={most}
{dynamic}
{dt!r}, {end!r}, , {dt!r}
*NODE PRINT, NSET=FRONT, FREQUENCY=1
U, V
*END STEP
"""
BODY = """*ELEMENT, TYPE={kind}, ELSET={name}
{cells}
*MATERIAL, NAME={name}
*ELASTIC
{young!r}, {poisson!r}
*DENSITY
{density!r}
*SOLID SECTION, ELSET={name}, MATERIAL={name}"""
KINDS = {2: "C3D8", 3: "C3D4"}
STIFF = {2: 10.0, 3: 50.0}  # of the penalty over the modulus, for each length of overlap
LONGER = 16  # steps of the ball in one of the implicit method
FACES = {
    2: {(0, 1): 3, (1, 2): 4, (2, 3): 5, (3, 0): 6},  # of a hexahedron, over the sides of its square
    3: {(0, 1, 2): 1, (0, 3, 1): 2, (1, 3, 2): 3, (2, 3, 0): 4},  # of a tetrahedron
}


def write(problem, folder, method):
    """Write the input file; in the plane, the nodes of the layer behind follow those in front."""
    dynamic, contact, behaviour = METHODS[method]
    nodes = [place for body in problem["bodies"] for place in body["nodes"]]
    n, dim = len(nodes), len(nodes[0])
    layers = range(4 - dim)
    bodies, sides, count = [], {}, 0
    for body in problem["bodies"]:
        lines = []
        for cell in body["cells"]:
            count += 1
            lines.append(", ".join(map(str, [count, *(k + 1 + n * layer for layer in layers for k in cell)])))
            sides |= {frozenset(cell[k] for k in at): f"{count}, S{face}" for at, face in FACES[dim].items()}
        bodies.append(BODY.format(**{**body, "kind": KINDS[dim], "cells": "\n".join(lines)}))
    slave, master = ("\n".join(sides[frozenset(facet)] for facet in surface) for surface in problem["surfaces"])
    places = [
        f"{k + 1 + n * layer}, " + ", ".join(f"{x:.12g}" for x in [*place, float(layer)][:3])
        for layer in layers for k, place in enumerate(nodes)
    ]  # fmt: skip
    front = "*NSET, NSET=FRONT, GENERATE\n" + f"1, {n}, 1"
    moving = [
        f"{body['first_node'] + k + 1 + n * layer}, {axis + 1}, {value!r}"
        for body in problem["bodies"] for axis, value in enumerate(body["velocity"]) if value
        for layer in layers for k in range(len(body["nodes"]))
    ]  # fmt: skip
    touching = {k for surface in problem["surfaces"] for facet in surface for k in facet}
    fixed = [f"{node + 1 + n * layer}, {k + 1}, {k + 1}, 0." for layer in layers for node, k in problem["fixed"]]
    if dim == 2:
        fixed += [f"{k + 1 + n * layer}, 3, 3, 0." for layer in layers for k in range(n) if k not in touching]
    dt = problem["dt"] * (1 if dim == 2 else LONGER)
    text = INPUT.format(fixed="\n".join(fixed),
        nodes="\n".join([*places, front]), cells="\n".join(bodies), slave=slave, master=master,
        velocities="\n".join(moving), contact=contact, dynamic=dynamic, dt=dt,
        behaviour=behaviour.format(stiffness=STIFF[dim] * problem["bodies"][0]["young"]),
        end=problem["dt"] * problem["steps"], most=problem["steps"] + 10,
    )  # fmt: skip
    (folder / "blocks.inp").write_text(text, encoding="ascii")


def read(problem, folder):
    """Return momentum and final motion from the file of results."""
    struck = range(*problem["struck"])
    tables, at = {}, None
    for line in (folder / "blocks.dat").read_text(encoding="ascii").splitlines():
        head = re.match(r" (displacements|velocities) .* time +(\S+)", line)
        if head:
            at = tables.setdefault(head[1], {}).setdefault(float(head[2]), [])
        elif line.strip():
            at.append([float(word) for word in line.split()[1 : 1 + len(problem["bodies"][0]["velocity"])]])
    (own,) = (body for body in problem["bodies"] if body["first_node"] == struck[0])
    times = [0.0, *tables["velocities"]]
    momentum = [
        sum(problem["mass"][k] * velocity[k][problem["axis"]] for k in struck)
        for velocity in [[own["velocity"]] * (struck[-1] + 1), *tables["velocities"].values()]
    ]
    last = {name: list(values.values())[-1] for name, values in tables.items()}
    steps = problem["dt"] * np.arange(problem["steps"] + 1)
    return {
        "momentum": np.interp(steps, times, momentum).tolist(), "steps": len(times) - 1,
        "displacement": last["displacements"], "velocity": last["velocities"],
    }  # fmt: skip


if __name__ == "__main__":
    ccx = shutil.which("ccx")
    if ccx is None:
        raise SystemExit("ccx is not on the PATH")
    if sys.argv[1] == "--version":
        print(subprocess.run([ccx, "-v"], capture_output=True, text=True, check=False).stdout.split()[-1])
    else:
        problem, folder = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2])
        write(problem, folder, sys.argv[3])
        done = subprocess.run([ccx, "blocks"], cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode or "*ERROR" in done.stdout:
            raise SystemExit(f"{done.stdout[-1000:]}{done.stderr[-500:]}\nccx ended with exit code {done.returncode}")
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        found = {"seconds": used.ru_utime + used.ru_stime, **read(problem, folder)}
        (folder / "result.json").write_text(json.dumps(found), encoding="utf-8")
