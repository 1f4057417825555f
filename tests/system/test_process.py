"""The process of a command: letters a stream lacks, readers that leave, Ctrl-C, and workers that start late."""

import os
import subprocess
import sys

import pytest

from marks import deep
from places import CASES

pytestmark = pytest.mark.skipif(os.name != "posix", reason="descriptors and signals of Unix")

HUNEK = str(CASES / "hunek.yaml")
PERCUSS = [sys.executable, "-m", "percuss"]


def run(words, **options):
    return subprocess.run(words, check=False, capture_output=True, text=True, timeout=300, **options)


def test_a_letter_that_a_stream_lacks_is_written_as_its_code():
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = run([*PERCUSS, "check", HUNEK], env=environment, errors="strict", encoding="ascii")
    assert done.returncode == 0, done.stderr
    assert r"\u011b" in done.stdout


@pytest.mark.parametrize("words", [deep(["check", HUNEK], id="short"), pytest.param(["schema"], id="long")])
def test_a_reader_that_leaves_is_told_nothing(words):
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [*PERCUSS, *words], stdout=writer, stderr=subprocess.PIPE, text=True, check=False, timeout=300
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


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


@pytest.mark.parametrize("place", ["typer", "numpy", deep("percuss.results.runner")])
def test_ctrl_c_while_percuss_is_imported(place, tmp_path):
    done = run([sys.executable, "-c", INTERRUPTED_IMPORT, place, "run", HUNEK, "-o", "out.nc"], cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
    assert not list(tmp_path.iterdir())


WORKER = """
import os, signal
from multiprocessing import resource_tracker
from percuss.studies.pool import _Context

resource_tracker.ensure_running()  # which lets signals through at its end
process = _Context().Process(target=os.getpid)
process.start()
os.kill(process.pid, signal.SIGINT)  # which is at its very beginning
process.join()
print(process.exitcode, signal.pthread_sigmask(signal.SIG_BLOCK, []))
"""


def test_ctrl_c_while_the_workers_of_a_study_start():
    done = run([sys.executable, "-c", WORKER])
    assert (done.returncode, done.stdout, done.stderr) == (0, "0 set()\n", "")
