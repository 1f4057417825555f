"""Two bars in impact with Siconos: the Moreau-Jean scheme, lumped masses, Newton's impact law with e = 0.

The scheme has theta = 1/2 and is implicit in the bars: with theta = 0, where it is explicit, it is unstable without
damping. The masses and stiffnesses are full matrices, because the program ends where sparse ones are passed from Python
(4.4, package of Debian). Contact is a constraint: the stiffness of a spring is not used.
"""

import json
import sys
import time
from importlib import metadata
from pathlib import Path

import numpy as np
from siconos import kernel

THETA = 0.5


def bar_of(spec, fixed):
    """Return the dynamical system of a bar without the node that is fixed, if there is one."""
    n, h = spec["elements"], spec["length"] / spec["elements"]
    mass = np.full(n + 1, spec["density"] * spec["area"] * h)
    mass[[0, n]] /= 2.0
    k = spec["young"] * spec["area"] / h
    stiffness = np.diag(np.full(n + 1, 2.0 * k)) - np.diag(np.full(n, k), 1) - np.diag(np.full(n, k), -1)
    stiffness[0, 0] = stiffness[n, n] = k
    free = n if fixed else n + 1
    start = np.zeros(free), np.full(free, spec["velocity"])
    bar = kernel.LagrangianLinearTIDS(*start, np.ascontiguousarray(np.diag(mass[:free])))
    bar.setKPtr(np.ascontiguousarray(stiffness[:free, :free]))
    return bar


def run(problem):
    """Return the result of a problem."""
    left, right = bar_of(problem["bars"][0], fixed=False), bar_of(problem["bars"][1], fixed=True)
    across = np.zeros((1, left.dimension() + right.dimension()))
    across[0, left.dimension() - 1], across[0, left.dimension()] = -1.0, 1.0
    contact = kernel.Interaction(kernel.NewtonImpactNSL(0.0), kernel.LagrangianLinearTIR(across))
    dt, steps = problem["dt"], problem["steps"]
    system = kernel.NonSmoothDynamicalSystem(0.0, (steps + 1) * dt)
    for bar in (left, right):
        system.insertDynamicalSystem(bar)
    system.link(contact, left, right)
    simulation = kernel.TimeStepping(
        system, kernel.TimeDiscretisation(0.0, dt), kernel.MoreauJeanOSI(THETA), kernel.LCP()
    )
    force = [0.0] * steps
    started = time.process_time()
    for k in range(steps):
        simulation.computeOneStep()
        force[k] = float(contact.lambda_(1)[0]) / dt
        simulation.nextStep()
    seconds = time.process_time() - started
    return {
        "seconds": seconds,
        "time": [(k + 0.5) * dt for k in range(steps)],
        "force": force,
        "displacement": [*map(float, left.q()), *map(float, right.q()), 0.0],
        "velocity": [*map(float, left.velocity()), *map(float, right.velocity()), 0.0],
    }


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        print(metadata.version("siconos"))
    else:
        result = run(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
        Path(sys.argv[2]).write_text(json.dumps(result), encoding="utf-8")
