"""Why percuss depends on what, and what it costs: ``python tests/support/dependencies.py`` writes the table anew.

The cost of a library is the processor time of a process that imports it alone, less that of a process that imports
nothing, over the same of NumPy. It is measured in turn with NumPy, as the speed of a machine changes, and the median
is taken.
"""

import re
import resource
import statistics
import subprocess
import sys
import tomllib

import pages
from lowest import declared
from places import ROOT

PAIRS = 9  # processes for each library, and as many for NumPy
# Each distribution: the module that is imported, and what it is for.
REASONS = {
    "annotated-types": ("annotated_types", "bounds of options (`Gt`, `Le`), which pydantic and every plug-in read"),
    "filelock": ("filelock", "the lock on the file of a study, so that two processes do not write to it"),
    "jinja2": ("jinja2", "the words of `percuss check` and `percuss plugins NAME`, by a template each"),
    "llvmlite": (
        "llvmlite.binding",
        "the types of compiled code that calls of kernels by their addresses need; a part of numba",
    ),
    "netCDF4": ("netCDF4", "results in the format that other programs of the field read"),
    "numba": ("numba", "compiles the loop and the kernels of methods, those of plug-ins too"),
    "numpy": ("numpy", "arrays"),
    "pebble": (
        "pebble",
        "worker processes of a study, of which one that dies or takes too long costs its own run alone",
    ),
    "platformdirs": ("platformdirs", "the user's cache folder on every system"),
    "pluggy": ("pluggy", "the hooks by which installed plug-ins are found"),
    "pydantic": ("pydantic.type_adapter", "reports all mistakes of a case at once, and makes its JSON schema"),
    "pyyaml": ("yaml", "YAML with line and column of each value"),
    "rich": ("rich.table", "tables and progress in a terminal"),
    "scipy": ("scipy.linalg", "LAPACK, sparse matrices and root finding of the certificates, sampling of studies"),
    "threadpoolctl": ("threadpoolctl", "one thread of BLAS, so that the digits of a run do not depend on their number"),
    "typer": ("typer", "the command line, from the signatures of its functions"),
    "xarray": ("xarray", "axes, units and files of results"),
    "matplotlib": ("matplotlib.pyplot", "figures (`plot`)"),
    "vl-convert-python": ("vl_convert", "figures of studies, from the descriptions that the page draws (`plot`)"),
    "distributed": ("distributed", "studies on a cluster (`study`)"),
    "pyarrow": ("pyarrow", "parquet files of studies (`study`)"),
    "hypothesis": ("hypothesis", "draws cases for the conformance kit (`kit`)"),
}
EXTRAS = ("plot", "study", "kit")


def names():
    """Return the distributions that percuss declares, those of the extras for users last."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [*declared(project), *(name for extra in EXTRAS for name in declared(project, extra))]


def seconds(code):
    """Return the processor time of a process that executes `code`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def cost(module):
    """Return what it costs to import a module, in units of NumPy."""
    seconds(f"import {module}")  # which compiles to bytecode
    ratios = []
    for _ in range(PAIRS):
        nothing, numpy, library = seconds("pass"), seconds("import numpy"), seconds(f"import {module}")
        ratios.append((library - nothing) / (numpy - nothing))
    return max(statistics.median(ratios), 0.0)


def table(cost):
    """Return the table, with `cost` of each module as a text."""
    lines = ((f"`{name}`", REASONS[name][1], cost(REASONS[name][0])) for name in names())
    return pages.table(("library", "for what", "import, NumPy = 1"), lines)


def written():
    """Return library, reason and cost of each line of the table on the page."""
    return re.findall(r"^\| `([\w-]+)` \| (.*) \| ([\d.]+) \|$", pages.shown("dependencies"), re.MULTILINE)


if __name__ == "__main__":
    pages.write("dependencies", table(lambda module: f"{cost(module):.1f}"))
