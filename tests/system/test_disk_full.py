"""A full disk: one clear message, what was there stays as it was, and what was computed is printed all the same."""

import contextlib
import resource
import subprocess
import sys

import pytest
import yaml

import percuss
from command_line import percuss_command
from marks import deep
from strategies import hunek

ROW = {"percuss-study": 1, "cases": ["case.yaml"], "vary": {"method.contact.ratio": [1.0, 2.0]}}


@contextlib.contextmanager
def full_disk(most):
    """Let no file grow beyond so many bytes."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A folder with a case and a study of it."""
    folder = tmp_path_factory.mktemp("full")
    (folder / "case.yaml").write_text(yaml.safe_dump(hunek(4, end=0.2)))
    (folder / "study.yaml").write_text(yaml.safe_dump(ROW))
    return folder


@pytest.mark.parametrize("there", [pytest.param(True, id="over a file"), deep(False, id="anew")])
def test_an_output_that_does_not_fit(study, there):
    for file in ("out.nc", "out.svg"):
        (study / file).unlink(missing_ok=True)
        if there:
            (study / file).write_text("before")
    before = sorted(study.iterdir())
    with full_disk(1000):
        done = percuss_command("run", "case.yaml", "-o", "out.nc", "--plot", "out.svg", cwd=study, plain=True)
    assert done.returncode == 2, done.stderr
    for file, reason in (("out.nc", "NetCDF: HDF error"), ("out.svg", "File too large")):
        state = "what was there is as it was" if there else "nothing is left behind"
        assert f"error: {file}: cannot be written: {reason}; {state}. Make room" in done.stderr
        assert not there or (study / file).read_text() == "before"
    assert "Traceback" not in done.stderr
    assert "impulse" in done.stdout
    assert sorted(study.iterdir()) == before


@pytest.mark.deep
def test_rows_that_do_not_fit_leave_those_before(study, tmp_path):
    """The file of a study grows while it runs: what does not fit any more is made by the next call."""
    rows = tmp_path / "rows.sqlite"
    with full_disk(1000):
        done = percuss_command("study", "study.yaml", "-o", rows, "--workers", "1", cwd=study)
    assert done.returncode == 2
    assert f"{rows}: cannot be written to: " in done.stderr
    words = ["study", "long.yaml", "-o", rows, "--workers", "1"]
    (study / "long.yaml").write_text(yaml.safe_dump({**ROW, "set": {"time.end": 40}, "keep": {"histories": 10_000}}))
    with full_disk(50_000):  # enough to begin with, and for what SQLite needs for itself
        done = percuss_command(*words, cwd=study)
    assert done.returncode == 2, done.stderr
    assert f"{rows}: cannot be written to: " in done.stderr
    assert "all rows stored before are kept" in done.stderr
    made = percuss.open_study(rows).counts.get("done", 0)
    assert made < 2
    done = percuss_command(*words, cwd=study)
    assert done.returncode == 0, done.stderr
    assert percuss.open_study(rows).counts == {"done": 2}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/dev/full is of Linux")
def test_an_output_that_is_full():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "percuss", "schema"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "error: the output cannot be written: No space left on device\n"
