"""Code that nothing names never runs: files that happen to lie where a command is typed, or beside a plug-in."""

import subprocess
import sys

import numba
import numpy as np
import pytest
import yaml

import percuss
import places
from fake_studies import TWO_BARS

# A file instead of each of these modules tells that it was imported, and fails.
THIRD_PARTY = {"matplotlib", "numba", "numpy", "rich", "scipy", "typer", "xarray", "yaml"}
STRAY = """with open({sentinel!r}, "a") as file:
    file.write({name!r} + chr(10))
raise ImportError({name!r} + " is imported from the current folder")
"""
# The script that an installer writes, for several commands; it lies in the folder too, which Python puts on the path.
SCRIPT = """import sys
from percuss.__main__ import main
for words in sys.argv[1:]:
    sys.argv = [__file__, *words.split()]
    try:
        main()
    except SystemExit as done:
        if done.code:
            raise SystemExit(f"{words}: {done.code}")
"""
STUDY = {
    "percuss-study": 1,
    "cases": ["case.yaml"],
    "methods": {"integrators": ["wu-predictor-corrector"], "contacts": ["bipenalty"]},
    "vary": {"method.contact.beta_s": [0.1, 0.2]},
}
COMMANDS = ("check case.yaml", "study study.yaml --workers 2")


@pytest.mark.deep
def test_commands_import_nothing_from_a_folder_full_of_shadows(tmp_path):
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(TWO_BARS), encoding="utf-8")
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(STUDY), encoding="utf-8")
    sentinel = tmp_path / "sentinel"
    for name in sorted({*sys.stdlib_module_names, *THIRD_PARTY, "sitecustomize", "usercustomize"} - {"__main__"}):
        (tmp_path / f"{name}.py").write_text(STRAY.format(sentinel=str(sentinel), name=name), encoding="utf-8")
    (tmp_path / "script").write_text(SCRIPT, encoding="utf-8")
    command = [sys.executable, "script", *COMMANDS]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=500, check=False)
    assert not sentinel.exists(), sentinel.read_text(encoding="utf-8")
    assert done.returncode == 0, done.stderr


def test_a_plug_in_takes_no_place(tmp_path, monkeypatch):
    """A plug-in may be called like a module of Python."""
    monkeypatch.chdir(tmp_path)
    law = (places.SUPPORT / "bodies" / "laws.py").read_text(encoding="utf-8")
    (tmp_path / "random.py").write_text(law, encoding="utf-8")
    before = sys.path.copy(), sys.modules["random"]
    percuss.load(TWO_BARS, {"method.contact": "row"}, plugins=["random.py"])
    assert (sys.path, sys.modules["random"]) == before


def test_machine_code_is_loaded_from_no_folder_that_a_file_in_the_current_folder_names(tmp_path, monkeypatch):
    """numba reads `.numba_config.yaml` in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: here", encoding="utf-8")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "here")  # as it is once numba has read that file
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    assert percuss.compiled_function(twice)(np.ones(2)).sum() == 4.0
    assert list((tmp_path / "cache").rglob("*.nbi"))
    assert not (tmp_path / "here").exists()


def twice(values):
    return values + values
