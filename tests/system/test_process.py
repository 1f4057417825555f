"""The process of a command: closed streams, letters a stream lacks, readers that leave, Ctrl-C, and busy plug-ins."""

import json
import os
import signal
import subprocess
import sys

import pytest

from places import CASES

pytestmark = pytest.mark.skipif(os.name != "posix", reason="descriptors and signals of Unix")

HUNEK = str(CASES / "hunek.yaml")
PERCUSS = [sys.executable, "-m", "percuss"]


def run(words, **options):
    return subprocess.run(words, check=False, capture_output=True, text=True, timeout=300, **options)


def shell(line, *words, **options):
    """Run percuss with some words, and with what a shell does to its streams."""
    return run(["sh", "-c", f'exec "$@" {line}', "sh", *PERCUSS, *words], **options)


# --------------------------------------------------------------------------------------------------- streams


@pytest.mark.parametrize(
    "closed", ["<&- >&- 2>&-", *(pytest.param(one, marks=pytest.mark.deep) for one in (">&-", "2>&-", "<&-"))]
)
def test_a_closed_stream_changes_nothing_of_the_work(closed, tmp_path):
    done = shell(closed, "run", HUNEK, "-o", "out.nc", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert ("exact solution known" in done.stdout) == (" >&-" not in f" {closed}")
    assert (tmp_path / "out.nc").stat().st_size > 1000


def test_an_error_without_a_stream_of_its_own_is_not_told_on_another(tmp_path):
    done = shell("2>&-", "check", "no-file.yaml", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", "")


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param({"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}, marks=pytest.mark.deep),
        {"PYTHONIOENCODING": "ascii"},
        pytest.param({"PYTHONIOENCODING": "latin-1"}, marks=pytest.mark.deep),
    ],
    ids=["locale", "ascii", "latin-1"],
)
def test_a_letter_that_a_stream_lacks_is_written_as_its_code(settings):
    done = run([*PERCUSS, "check", HUNEK], env={**os.environ, **settings}, errors="strict", encoding="latin-1")
    assert done.returncode == 0, done.stderr
    assert r"\u011b" in done.stdout


@pytest.mark.parametrize("stream", ["stdout", pytest.param("stderr", marks=pytest.mark.deep)])
def test_a_reader_that_leaves_ends_no_work(stream, tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, stream: writer}
    command = [*PERCUSS, "run", HUNEK, "--set", "method.contact=penalty", "--json", "-o", "out.nc"]
    done = subprocess.run(command, cwd=tmp_path, text=True, check=False, timeout=300, **streams)
    os.close(writer)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in (done.stderr or "")
    assert "Broken" not in (done.stderr or "")
    assert (tmp_path / "out.nc").stat().st_size > 1000


# ---------------------------------------------------------------------------------------------------- Ctrl-C

INTERRUPTED_IMPORT = """
import os, runpy, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run in the background
place, *sys.argv[1:] = sys.argv[1:]

class PressCtrlC:
    @staticmethod
    def find_spec(name, *_):
        if name == place:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, PressCtrlC())
runpy.run_module("percuss", run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize(
    "place", ["percuss.process", "typer", "percuss.cli.main", "numpy", "pydantic", "percuss.results.runner"]
)
def test_ctrl_c_while_percuss_is_imported(place, tmp_path):
    done = run([sys.executable, "-c", INTERRUPTED_IMPORT, place, "run", HUNEK, "-o", "out.nc"], cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
    assert not list(tmp_path.iterdir())


SERVER = """
import multiprocessing, os, signal
from multiprocessing import forkserver
from percuss.studies import workers

context = multiprocessing.get_context("forkserver")
context.set_forkserver_preload([workers.__name__])
workers._start_server()
os.kill(forkserver._forkserver._forkserver_pid, signal.SIGINT)  # which is at its very beginning
with workers._starting():
    process = context.Process(target=os.getpid)
    process.start()
process.join()
print(process.exitcode, signal.pthread_sigmask(signal.SIG_BLOCK, []))
"""


def test_ctrl_c_while_the_workers_of_a_study_start():
    done = run([sys.executable, "-c", SERVER])
    assert (done.returncode, done.stdout, done.stderr) == (0, "0 set()\n", "")


# -------------------------------------------------------------------------------------------------- plug-ins

PLUGIN = """
import os, sys, threading, time
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw
{deed}


@dataclass(frozen=True)
class Busy(ContactLaw):
    '''A penalty.'''

    name = "busy"
    summary = "A penalty"

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)
"""
DEEDS = {
    "writes to the descriptor": "os.write(1, b'HELLO')",
    "takes the streams away": "sys.stdout = None; sys.stderr = None",
    "closes the streams": "sys.stdout.close(); sys.stderr.close(); sys.__stdout__.close()",
    "allows few calls": "sys.setrecursionlimit(60)",
    "starts a thread": "threading.Thread(target=time.sleep, args=(10_000,), name='busy one').start()",
}


@pytest.mark.parametrize(
    "deed",
    [deed if deed == "closes the streams" else pytest.param(deed, marks=pytest.mark.deep) for deed in DEEDS],
)
def test_what_a_plug_in_does_to_the_process_is_undone(deed, tmp_path):
    (tmp_path / "busy.py").write_text(PLUGIN.format(deed=DEEDS[deed]))
    command = ["run", HUNEK, "--plugin", "busy.py", "--set", "method.contact=busy", "--json"]
    done = run([*PERCUSS, *command], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["status"] == "done"
    assert "note: method.contact: busy has no option beta_s" in done.stderr
    assert ("what still runs ends with it: busy one" in done.stderr) == (deed == "starts a thread")


WORKER = """
import contextlib, multiprocessing, sys
from pathlib import Path
from percuss.studies import workers

workers.STANDSTILL = 0.1
ours, other = multiprocessing.Pipe()
guards = contextlib.ExitStack()
workers._Desk(other, Path(sys.argv[1])).prepare(guards, 1000.0)
exec(compile("while True: pass", "endless.py", "exec"), {"__name__": "percuss_file_endless"})
"""


def test_a_worker_that_starts_when_the_work_has_ended_says_nothing(tmp_path):
    done = run([sys.executable, "-c", WORKER, str(tmp_path / "removed")])
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "")
    assert not list(tmp_path.iterdir())


def test_a_worker_says_where_it_stands_still(tmp_path):
    (tmp_path / "crash").touch()
    words = [sys.executable, "-c", WORKER, str(tmp_path / "crash")]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as worker:
        said = worker.stderr.readline()
        worker.send_signal(signal.SIGKILL)
    assert "the work is in endless.py:1; Ctrl-C ends it" in said
