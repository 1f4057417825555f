"""Two blocks, and a ball on a wall, with Kratos: its applications for structures and for their contact, by mortar.

Mesh, materials and parameters are written into the folder of the run. What the parameters do not name has the default
of Kratos: the implicit scheme is that of Bossak with a factor -0.3, which damps waves that a step does not resolve.
Without that damping, by the scheme of Newmark, the energy grew in both implicit methods. The penalty of the implicit
method is 10 000 times the mean modulus over the mean side of a cell; that of the augmented Lagrangian and of the
explicit method has no factor 10 000.

By default, the explicit method halves its step during contact; here it keeps the step of all programs. Its penalty
multiplies gaps times areas, which is soft for small cells. Here it is 20 times the default, the modulus over the square
of the side: of 1, 5, 20, 40 and 80 times, this had the smallest error of the force.

On the ball:

- The explicit method takes its default, the modulus over a side, from the coarse wall, and multiplies gaps by the small
  areas of the ball. With 1e5 times this default, the impulse of the first 300 steps was 63% of that of percuss. With
  1e6, 2e6 and 4e6 times it, the peak was .00343, .00346 and .00349, and the contact time 11.57, 11.51 and 11.46. With
  2e7 times it, the motion grew without bound. 1e6 is kept: it has the smallest sum of the relative errors of both.
- The implicit methods, with their default search in a radius, found no contact with the two facets of the wall. Here
  they have the octree, which is the default of the explicit method.
- In steps of 16 of percuss, up to time 1.85, the impulse of the implicit penalty with its default was 27% of that of
  percuss, and that of the augmented Lagrangian 100%. The augmented Lagrangian is kept. With steps of 16, the peak was
  .00345, the contact time 11.39 and the kept energy 99.97%; with steps of 32, .00345, 11.49 and 99.90%, in two thirds
  of the time. 32 are kept. Momentum is taken as linear within a step.
"""

import json
import sys
import time
from math import ceil
from pathlib import Path

import numpy as np

METHODS = {
    "implicit-alm": ("alm_contact_process", "ALMContactFrictionless"),
    "implicit-penalty": ("penalty_contact_process", "PenaltyContactFrictionless"),
    "explicit-penalty": ("explicit_penalty_contact_process", "PenaltyContactFrictionless"),
}
KINDS = {
    2: ("SmallDisplacementElement2D4N", "LineCondition2D2N", "LinearElasticPlaneStrain2DLaw"),
    3: ("SmallDisplacementElement3D4N", "SurfaceCondition3D3N", "LinearElastic3DLaw"),
}
STIFFER = {2: 20.0, 3: 1e6}  # penalty of the explicit method over its default
SEARCH = {2: "in_radius_with_obb", 3: "octree_with_obb"}  # of implicit methods
LONGER = 32  # steps of the ball in one of an implicit method


def mesh_of(problem):
    """Return the mesh in the format of Kratos; a part of it is a body, a side of the contact, or both sides."""
    bodies = problem["bodies"]
    nodes = [place for body in bodies for place in body["nodes"]]
    lines = ["Begin ModelPartData", "End ModelPartData", "Begin Properties 0", "End Properties", "Begin Nodes"]
    lines += [f"{k} {' '.join(repr(x) for x in [*place, 0.0][:3])}" for k, place in enumerate(nodes, 1)]
    lines.append("End Nodes")
    parts = {}
    element, condition, _ = KINDS[len(nodes[0])]
    kinds = {
        "Elements": (element, {body["name"]: body["cells"] for body in bodies}),
        "Conditions": (condition, dict(zip(("slave", "master"), problem["surfaces"], strict=True))),
    }
    for block, (kind, groups) in kinds.items():
        lines.append(f"Begin {block} {kind}")
        count = 0
        for name, group in groups.items():
            own = range(count + 1, count + len(group) + 1)
            lines += [f"{k} 0 {' '.join(str(n + 1) for n in cell)}" for k, cell in zip(own, group, strict=True)]
            parts[name] = {"Nodes": sorted({n + 1 for cell in group for n in cell}), block: own}
            count += len(group)
        lines.append(f"End {block}")
    both = (parts["slave"], parts["master"])
    parts["contact"] = {kind: [k for part in both for k in part[kind]] for kind in ("Nodes", "Conditions")}
    for name, part in parts.items():
        lines.append(f"Begin SubModelPart {name}")
        for kind, ids in part.items():
            lines += [f"Begin SubModelPart{kind}", *map(str, ids), f"End SubModelPart{kind}"]
        lines.append("End SubModelPart")
    return "\n".join([*lines, ""])


def materials_of(problem):
    """Return the materials of the bodies; in the plane, the strain is plane."""
    *_, law = KINDS[len(problem["bodies"][0]["velocity"])]
    materials = [
        {
            "constitutive_law": {"name": law},
            "Variables": {
                "YOUNG_MODULUS": body["young"], "POISSON_RATIO": body["poisson"], "DENSITY": body["density"],
                "THICKNESS": 1.0,
            },
            "Tables": {},
        }
        for body in problem["bodies"]
    ]  # fmt: skip
    names = [f"Structure.{body['name']}" for body in problem["bodies"]]
    return {
        "properties": [
            {"model_part_name": name, "properties_id": k, "Material": material}
            for k, (name, material) in enumerate(zip(names, materials, strict=True), 1)
        ]
    }


def longer_of(problem, method):
    """Return how many steps of percuss one step of a method is long."""
    return LONGER if len(problem["bodies"][0]["velocity"]) == 3 and method.startswith("implicit") else 1


def parameters_of(problem, folder, method):
    """Return the parameters of a method."""
    process, mortar = METHODS[method]
    dim = len(problem["bodies"][0]["velocity"])
    longer = longer_of(problem, method)
    dt = longer * problem["dt"]
    contact = {
        "model_part_name": "Structure", "contact_model_part": {"0": ["contact"]},
        "assume_master_slave": {"0": ["slave"]}, "contact_type": "Frictionless",
    }  # fmt: skip
    solver = {
        "model_part_name": "Structure", "domain_size": dim, "solver_type": "dynamic", "analysis_type": "non_linear",
        "model_import_settings": {"input_type": "mdpa", "input_filename": str(folder / "blocks")},
        "material_import_settings": {"materials_filename": str(folder / "materials.json")},
        "time_stepping": {"time_step": dt}, "contact_settings": {"mortar_type": mortar},
    }  # fmt: skip
    if method.startswith("explicit"):
        solver |= {"time_integration_method": "explicit", "scheme_type": "central_differences"}
        solver |= {"time_step_prediction_level": 0, "max_delta_time": dt}
        solver["contact_settings"]["delta_time_factor_for_contact"] = 1.0
        contact["advance_ALM_parameters"] = {"stiffness_factor": STIFFER[dim]}
    else:
        solver |= {"time_integration_method": "implicit", "scheme_type": "bossak", "max_iteration": 20}
        solver |= {"convergence_criterion": "contact_residual_criterion"}
        solver |= {"residual_relative_tolerance": 1e-6, "residual_absolute_tolerance": 1e-12}
        solver |= {"linear_solver_settings": {"solver_type": "LinearSolversApplication.sparse_lu"}}
        contact["search_parameters"] = {"type_search": SEARCH[dim]}
    return {
        "problem_data": {
            "problem_name": "blocks", "parallel_type": "OpenMP", "echo_level": 0, "start_time": 0.0,
            "end_time": dt * (ceil(problem["steps"] / longer) - 0.5),
        },
        "solver_settings": solver,
        "processes": {
            "contact_process_list": [
                {
                    "python_module": process, "kratos_module": "ContactStructuralMechanicsApplication",
                    "Parameters": contact,
                }
            ]
        },
    }  # fmt: skip


def write(problem, folder, method):
    """Write mesh, materials and parameters."""
    (folder / "blocks.mdpa").write_text(mesh_of(problem), encoding="ascii")
    (folder / "materials.json").write_text(json.dumps(materials_of(problem), indent=1), encoding="ascii")
    parameters = parameters_of(problem, folder, method)
    (folder / "parameters.json").write_text(json.dumps(parameters, indent=1), encoding="ascii")


def run(problem, folder, method):
    """Return the result of a problem whose input is in a folder."""
    import KratosMultiphysics as Kratos
    from KratosMultiphysics import ContactStructuralMechanicsApplication  # noqa: F401 - it registers its parts
    from KratosMultiphysics import StructuralMechanicsApplication as Structures
    from KratosMultiphysics.StructuralMechanicsApplication.structural_mechanics_analysis import (
        StructuralMechanicsAnalysis,
    )

    mass, struck = np.array(problem["mass"]), slice(*problem["struck"])
    dim = len(problem["bodies"][0]["velocity"])
    parameters = Kratos.Parameters((folder / "parameters.json").read_text(encoding="ascii"))
    model = Kratos.Model()
    momentum, aside = [], []

    def nodal(variable):
        part = model["Structure"]
        return np.array([part.GetNode(k + 1).GetSolutionStepValue(variable) for k in range(mass.size)])[:, :dim]

    def note():
        started = time.process_time()
        momentum.append(float(mass[struck] @ nodal(Kratos.VELOCITY)[struck, problem["axis"]]))
        aside.append(time.process_time() - started)

    class Analysis(StructuralMechanicsAnalysis):
        def FinalizeSolutionStep(self):
            super().FinalizeSolutionStep()
            note()

    analysis = Analysis(model, parameters)
    analysis.Initialize()
    for body in problem["bodies"]:
        for k in range(body["first_node"], body["first_node"] + len(body["nodes"])):
            for variable in [Kratos.VELOCITY, *([Structures.MIDDLE_VELOCITY] if method.startswith("explicit") else [])]:
                model["Structure"].GetNode(k + 1).SetSolutionStepValue(variable, 0, [*body["velocity"], 0.0][:3])
    for node, axis in problem["fixed"]:
        held = (Kratos.DISPLACEMENT_X, Kratos.DISPLACEMENT_Y, Kratos.DISPLACEMENT_Z)[axis]
        model["Structure"].GetNode(node + 1).Fix(held)
    note()
    started = time.process_time()
    analysis.RunSolutionLoop()
    seconds = time.process_time() - started - sum(aside[1:])
    displacement, velocity = nodal(Kratos.DISPLACEMENT), nodal(Kratos.VELOCITY)
    steps, longer = len(momentum) - 1, longer_of(problem, method)
    momentum = np.interp(np.arange(problem["steps"] + 1), longer * np.arange(steps + 1), momentum)
    return {
        "seconds": seconds,
        "steps": steps,
        "momentum": momentum.tolist(),
        "displacement": displacement.tolist(),
        "velocity": velocity.tolist(),
    }


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        from importlib import metadata

        print(metadata.version("KratosContactStructuralMechanicsApplication"))
    else:
        problem, folder = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2])
        write(problem, folder, sys.argv[3])
        found = run(problem, folder, sys.argv[3])
        (folder / "result.json").write_text(json.dumps(found), encoding="utf-8")
