"""What each command imports: nothing slow that it does not use, and no compiler where it makes no step."""

import json
import os
import subprocess
import sys

import pytest

from command_line import percuss_command
from places import CASES

# Libraries that take long to import, and those of them that may be there once a command has been executed. The commands
# follow one another in one process. The environment limits the threads of BLAS, without threadpoolctl.
SLOW = {"dask", "jinja2", "llvmlite", "matplotlib", "netCDF4", "numba", "numpy", "pandas", "pydantic", "rich", "scipy"}
SLOW |= {"threadpoolctl", "tornado", "xarray", "yaml"}
DESCRIBE = {"numpy", "pydantic", "yaml", "jinja2"}
MAY_IMPORT = {
    "": set(),  # import percuss
    "--help": set(),
    "schema": DESCRIBE,
    "check {case}": DESCRIBE | {"scipy"},
    "run {case} --exact-only --json": DESCRIBE | {"scipy"},
    "run {case}": {*DESCRIBE, "scipy", "llvmlite", "numba", "rich"},
    "run {case} -o {out}": {*DESCRIBE, "scipy", "llvmlite", "numba", "rich", "netCDF4"},
}

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


def test_a_command_imports_only_what_it_uses(tmp_path):
    files = {"case": CASES / "hunek.yaml", "out": tmp_path / "hunek.nc"}
    commands = {command.format(**files): allowed for command, allowed in MAY_IMPORT.items()}
    assert percuss_command("run", CASES / "hunek.yaml").returncode == 0  # whose code is then stored
    asked = json.dumps([list(commands), sorted(SLOW)])
    done = subprocess.run([sys.executable, "-c", SCRIPT, asked], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for command, names in json.loads(done.stdout).items():
        assert set(names) <= commands[command], command


@pytest.mark.deep
def test_python_without_docstrings_runs_cases():
    """As packagers and containers do by PYTHONOPTIMIZE=2."""
    command = [sys.executable, "-OO", "-m", "percuss", "run", CASES / "hunek.yaml", "--set", "time.end=0.001"]
    done = subprocess.run(command, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
