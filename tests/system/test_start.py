"""What each command imports: nothing that it does not use, and no compiler where it makes no step."""

import json
import os
import re
import subprocess
import sys
from importlib import metadata

import pytest

from command_line import percuss_command
from places import CASES

NOTHING = set()
WORDS = {"typer"}
INPUT = WORDS | {"annotated_types", "numpy", "pydantic", "yaml", "pluggy"}
DESCRIBE = INPUT | {"jinja2"}
CERTIFY = DESCRIBE | {"scipy"}
SOLVE = CERTIFY | {"llvmlite", "numba", "platformdirs"}
# Each command, and the libraries that may be imported once it has been executed. The commands follow one another in one
# process, so that each set contains the one before. The environment limits the threads of BLAS, without threadpoolctl.
MAY_IMPORT = {
    "": NOTHING,  # import percuss
    "--help": WORDS,
    "plugins bipenalty": DESCRIBE,
    "schema": DESCRIBE,
    "check {case}": CERTIFY,
    "run {case} --exact-only --json": CERTIFY | {"platformdirs"},
    "run {case} --json": SOLVE,
    "compare {case} --contact penalty,bipenalty --json": SOLVE,
    "plugins": SOLVE | {"rich"},
    "stability {case}": SOLVE | {"rich"},
    "run {case}": SOLVE | {"rich"},
}
# Libraries that no distribution below declares as its own dependency, but that take long to import.
OTHERS = {"dask", "distributed", "llvmlite", "matplotlib", "pandas", "tornado"}

SCRIPT = """
import json, sys
commands, watched = json.loads(sys.argv[1])
imported = {}

def execute(words):
    import contextlib, io
    from percuss.cli.main import main
    out = io.StringIO()
    sys.argv = ["percuss", *words]
    with contextlib.redirect_stdout(out):
        try:
            main()
        except SystemExit as done:
            assert not done.code, (words, done.code, out.getvalue())

for command in commands:
    if command:
        execute(command.split())
    else:
        import percuss
    imported[command] = [name for name in watched if name in sys.modules]
print(json.dumps(imported))
"""


def modules_of_dependencies():
    """Return the modules of all distributions that percuss declares, by what they are imported as."""
    declared = {re.match(r"[\w.-]+", line)[0].lower() for line in metadata.requires("percuss")}
    provided = {
        module
        for module, distributions in metadata.packages_distributions().items()
        if module.isidentifier() and declared & {name.lower() for name in distributions}
    }
    assert {"numba", "scipy", "numpy", "xarray", "netCDF4", "pydantic", "yaml", "rich", "matplotlib"} <= provided
    return sorted((provided | OTHERS) - {"percuss"})


@pytest.fixture(scope="module")
def imported_after():
    """What is imported after each command, in a process of its own with stored code."""
    case = str(CASES / "hunek.yaml")
    commands = [command.format(case=case) for command in MAY_IMPORT]
    for command in commands:
        if command.startswith(("run", "compare")):
            assert percuss_command(*command.split()).returncode == 0
    asked = json.dumps([commands, modules_of_dependencies()])
    done = subprocess.run([sys.executable, "-c", SCRIPT, asked], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return dict(zip(MAY_IMPORT, json.loads(done.stdout).values(), strict=True))


def test_a_command_imports_only_what_it_uses(imported_after):
    too_much = {command: sorted(set(names) - MAY_IMPORT[command]) for command, names in imported_after.items()}
    assert not {command: names for command, names in too_much.items() if names}


def test_python_without_docstrings_runs_cases():
    """As packagers and containers do by PYTHONOPTIMIZE=2."""
    command = [sys.executable, "-OO", "-m", "percuss", "run", CASES / "hunek.yaml", "--set", "time.end=0.001"]
    done = subprocess.run(command, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
