"""Two bars in impact with OpenSees: trusses with lumped masses, ExplicitDifference, a spring without tension."""

import ctypes
import importlib.util
import json
import sys
import tempfile
import time
from pathlib import Path


def opensees():
    """Return the interpreter of OpenSees.

    Some of its wheels bring BLAS and LAPACK, and do not tell the linker where: they are loaded first.
    """
    package = importlib.util.find_spec("openseespylinux")
    if package is not None:
        folder = Path(package.submodule_search_locations[0]) / "lib"
        for name in ("libquadmath", "libgfortran", "libblas", "liblapack"):
            for library in folder.glob(f"{name}.so*"):
                ctypes.CDLL(str(library), ctypes.RTLD_GLOBAL)
    import openseespy.opensees

    return openseespy.opensees


def run(problem, folder):
    """Return the result of a problem."""
    ops = opensees()
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    ops.uniaxialMaterial("ENT", 1, problem["penalty"])
    node = element = 0
    ends = []
    for number, bar in enumerate(problem["bars"]):
        n, h = bar["elements"], bar["length"] / bar["elements"]
        ops.uniaxialMaterial("Elastic", 2 + number, bar["young"])
        first = node + 1
        for k in range(n + 1):
            node += 1
            ops.node(node, bar["at"] + k * h)
            ops.mass(node, bar["density"] * bar["area"] * h * (0.5 if k in {0, n} else 1.0))
            ops.setNodeVel(node, 1, bar["velocity"], "-commit")
        for k in range(n):
            element += 1
            ops.element("Truss", element, first + k, first + k + 1, bar["area"], 2 + number)
        ends.append((first, node))
    ops.fix(node, 1)
    spring = element + 1
    ops.element("zeroLength", spring, ends[0][1], ends[1][0], "-mat", 1, "-dir", 1)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("Diagonal")
    ops.algorithm("Linear")
    ops.integrator("ExplicitDifference")  # CentralDifference starts from rest, whatever the velocities
    ops.analysis("Transient")
    written = Path(folder) / "force.txt"
    ops.recorder("Element", "-file", str(written), "-precision", 17, "-time", "-ele", spring, "force")

    def displacement():
        return [ops.nodeDisp(k, 1) for k in range(1, node + 1)]

    dt, steps = problem["dt"], problem["steps"]
    started = time.process_time()
    failed = ops.analyze(steps - 1, dt)
    before = displacement()
    failed = failed or ops.analyze(1, dt)
    seconds = time.process_time() - started
    if failed:
        raise SystemExit(f"OpenSees: analyze returned {failed}")
    after = displacement()
    ops.wipe()  # closes the file
    rows = [[float(word) for word in line.split()] for line in written.read_text(encoding="ascii").splitlines()]
    return {
        "seconds": seconds,
        "time": [0.0, *(row[0] for row in rows)],
        "force": [0.0, *(row[1] for row in rows)],
        "displacement": after,
        "before": before,
    }


if __name__ == "__main__":
    if sys.argv[1] == "--version":
        print(opensees().version())
    else:
        with tempfile.TemporaryDirectory() as folder:
            result = run(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), folder)
        Path(sys.argv[2]).write_text(json.dumps(result), encoding="utf-8")
