"""A run that is killed goes on from its saved state, to the last bit as if nothing had stopped it."""

import functools
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml
from benchmarks import digest_cases

import percuss
import places
from command_line import percuss_command
from marks import deep
from percuss.certificate import verdict
from percuss.errors import PercussError
from percuss.march import arrays, march
from percuss.methods.registry import Registry
from percuss.results import runner, saved_state
from percuss.results.saved_state import SavedState
from percuss.threads import most
from strategies import hunek


@functools.cache
def runs():
    """The quick runs of the digests by their names, which take a second to make."""
    return {run.name: run for run in digest_cases.Runs(Registry.load()).every() if run.quick}


MATERIAL = {"young": 1.0, "density": 1.0, "poisson": 0.0}
BARS = "laws with kernels at one end | central-difference | penalty"


class Killed(BaseException):
    """What ends a run where SIGKILL would."""


@pytest.fixture(autouse=True)
def short_chunks(monkeypatch, tmp_path_factory):
    """Save after every chunk of a few steps, in a folder of the test, and ask for no certificate: it holds no state."""
    monkeypatch.setattr(runner, "_run", functools.partial(runner._run, certify=verdict.unasked))
    folder = tmp_path_factory.mktemp("states")
    monkeypatch.setattr(march, "CHUNK_STEPS", 7)
    monkeypatch.setattr(saved_state, "SAVE_SECONDS", -1.0)
    monkeypatch.setattr(saved_state, "MOST_OF_TIME", np.inf)
    monkeypatch.setattr(saved_state, "cache_folder", lambda: folder)


def kill_after(monkeypatch, chunks):
    """Have a run end as soon as it has saved its state so often."""
    saved = []

    def offer(self, *arguments, **keywords):
        SavedState.offer.original(self, *arguments, **keywords)
        saved.append(arguments[0])
        if len(saved) == chunks:
            raise Killed

    offer.original = SavedState.offer
    monkeypatch.setattr(SavedState, "offer", offer)
    return saved


def outcome(case, **how):
    """Return the result of a run, also of one that is stopped, or the words of its refusal."""
    try:
        return percuss.run(percuss.load(case), **how)
    except percuss.RunError as error:
        return error.result
    except PercussError as error:
        return str(error)


def content(result):
    """Return all that a result holds but for times and the clock."""
    if isinstance(result, str):
        return result
    summary = {name: value for name, value in result.summary.items() if name not in {"seconds", "threads"}}
    provenance = {name: value for name, value in result.provenance.items() if name != "time"}
    arrays = {name: values.tobytes() for name, values in result.arrays.items()}
    fields = {name: np.asarray(values).tobytes() for name, values in result.field_arrays.items()}
    return json.dumps([summary, provenance], default=str), arrays, fields


def killed(case, chunks, **how):
    """Return whether a run was killed after so many chunks, before it ended."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        kill_after(monkeypatch, chunks)
        try:
            outcome(case, **how)
        except Killed:
            return True
    return False


def differs(case, chunks):
    """Return whether a run that was killed after so many chunks and goes on has other bits than a whole one."""
    return killed(case, chunks) and content(outcome(case, resume=True)) != content(outcome(case))


SEAM = {"between": ["left.right", "right.left"]}


def solid(size, cells, **more):
    speeds = [0.1] + [0.0] * (len(size) - 1)
    body = {"block": {"size": size, "elements": [2] * len(size), "cells": cells}, "material": MATERIAL}
    bodies = {
        "left": {**body, "at": [0.0] * len(size), "velocity": speeds},
        "right": {**body, "at": [size[0], *[0.0] * (len(size) - 1)], "fixed": ["right"]},
    }
    contacts = {"seam": SEAM}
    time_of_run = {"steps": 40, "courant": 0.4}
    return {"percuss": 1, "bodies": bodies, "contacts": contacts, "time": time_of_run, "record": {"fields": 5}, **more}


PUSH = {"ramp": {"value": 1e-3, "duration": 1.0}, "on": "left.left", "direction": [1.0, 0.0]}
ALONG = {"ramp": {"value": 3e-2, "duration": 1.0}, "on": "left.left", "direction": [0.0, 1.0]}
DECAY = {"name": "exponential-decay", "mu_static": 0.4, "mu_kinetic": 0.1, "decay": 9.0, "stiffness": 3.0}
ROUND = {"circle": {"centre": [-1.02, 0.5], "radius": 1.0}, "moving": "tool"}
FLOWS = {"block": {"size": [1.0, 1.0], "elements": [2, 2]}, "at": [0.0, 0.0], "velocity": [0.1, 0.0]}
FLOWS |= {"material": {"name": "j2-plastic", **MATERIAL, "yield_stress": 0.01}}
HELD = {"block": {"size": [1.0, 1.0], "elements": [2, 2]}, "at": [1.0, 0.0], "fixed": ["right"], "material": MATERIAL}
SOLIDS = {
    "quad4": solid([1.0, 1.0], "quad4", loads={"push": PUSH}),
    "tri3 by Gauss points": solid([1.0, 1.0], "tri3", method={"pairing": "gauss-points", "contact": "penalty"}),
    "quad4 with friction": solid(
        [1.0, 1.0], "quad4", loads={"along": ALONG}, method={"contact": "penalty", "friction": DECAY}
    ),
    "quad4 that slides far": solid(
        [1.0, 1.0],
        "quad4",
        loads={"along": ALONG},
        contacts={"seam": SEAM | {"sliding": "large"}},
        method={"contact": "regularised-lagrange", "friction": DECAY, "pairing": "gauss-points"},
    ),
    "quad4 at a wall that moves": solid(
        [1.0, 1.0],
        "quad4",
        loads={"tool": {"ramp": {"value": 0.3, "duration": 1.0}, "as": "velocity", "direction": [1.0, 0.2]}},
        contacts={"seam": SEAM, "die": {"body": "left.left", "wall": ROUND}},
        method={"contact": "regularised-lagrange", "friction": DECAY},
    ),
    "quad4-mean that flows": solid([1.0, 1.0], "quad4", bodies={"left": FLOWS, "right": HELD}),
    "hex8": solid([1.0, 1.0, 1.0], "hex8", method={"contact": "hunt-crossley"}),
    "tet4 in stages": solid([1.0, 1.0, 1.0], "tet4", method={"integrator": "noh-bathe", "contact": "penalty"}),
}


@pytest.mark.parametrize("name", [name if name == "quad4" else deep(name) for name in (*SOLIDS, BARS)])
def test_a_killed_run_goes_on_bit_for_bit(name):
    case = SOLIDS[name] if name in SOLIDS else runs()[name].case
    assert outcome(case).status == "done"
    assert not any(differs(case, chunks) for chunks in (1, 4))


@pytest.mark.skipif(most() < 2, reason="one core")
@pytest.mark.deep
@pytest.mark.parametrize(("before", "after"), [(1, 2), (2, 1)])
def test_a_killed_run_goes_on_with_other_threads(monkeypatch, before, after):
    monkeypatch.setattr(arrays, "FEW_NUMBERS", 0)
    assert killed(SOLIDS["quad4"], 3, threads=before)
    resumed = outcome(SOLIDS["quad4"], resume=True, threads=after)
    assert resumed.summary["threads"] == after
    assert content(resumed) == content(outcome(SOLIDS["quad4"], threads=before))


@pytest.mark.deep
@pytest.mark.parametrize("integrator", Registry.load().names("integrators"))
def test_every_method_and_feature_goes_on_bit_for_bit(integrator):
    """Every law, feature, element, material and load once with each integrator with which it is listed.

    A few of these runs are refused or stopped.
    """
    chosen = {}
    for run in filter(lambda run: run.compiled, runs().values()):
        method, body = run.case["method"], next(iter(run.case["bodies"].values()))
        if method["integrator"]["name"] == integrator:
            methods = method["contact"]["name"], method["mass"]["name"], str(body["element"]), str(body["material"])
            chosen.setdefault((run.name.partition(" | ")[0], *methods), run)
    for run in chosen.values():
        assert not differs(run.case, 3), run.name


def test_ctrl_c_saves_the_state_whatever_the_time(monkeypatch):
    monkeypatch.setattr(saved_state, "SAVE_SECONDS", 1e9)
    case = SOLIDS["quad4"]

    def press(done, total):
        if done == 21:
            os.kill(os.getpid(), signal.SIGINT)

    assert outcome(case, progress=press).status == "interrupted"
    left = []
    assert content(outcome(case, resume=True, progress=lambda *steps: left.append(steps))) == content(outcome(case))
    assert left[0] == (7, 19)


LAW = (places.SUPPORT / "bodies" / "spring.py").read_text(encoding="utf-8")


@pytest.fixture
def bench(tmp_path):
    """A folder with a case of a plug-in, whose run has saved its state."""
    (tmp_path / "law.py").write_text(LAW)
    case = {**hunek(4, end=0.2), "plugins": ["law.py"], "method": {"contact": "spring"}}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(case))
    with pytest.MonkeyPatch.context() as monkeypatch:
        kill_after(monkeypatch, 1)
        with pytest.raises(Killed):
            percuss_command("run", "case.yaml", cwd=tmp_path, plain=True)
    return tmp_path


def resumed(folder, *options):
    return percuss_command("run", "case.yaml", "--resume", *options, cwd=folder, plain=True)


def refused(folder, *options):
    """Return the message by which a run is refused that is to go on."""
    done = resumed(folder, *options)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith("1 mistake; nothing was run\n")
    return done.stderr


def test_the_command_goes_on_with_the_state_of_its_case_alone(bench):
    none = "--resume: expected the saved state of a run of this case, found none\n"
    assert refused(bench, "--set", "time.end=0.3").startswith(none)
    (bench / "law.py").write_text(LAW.replace("0.25", "0.5"))
    assert refused(bench).startswith(none)
    (bench / "law.py").write_text(LAW)
    assert "expected --resume or --exact-only, found both" in refused(bench, "--exact-only")
    done = resumed(bench, "-o", "run.nc")
    assert done.returncode == 0, done.stderr
    assert percuss_command("verify", "run.nc", cwd=bench, plain=True).returncode == 0
    assert refused(bench).startswith(none)  # the state is gone with the end of its run


@pytest.mark.parametrize("damage", ["a bit", "its end", "everything", "other arrays"])
def test_a_damaged_state_is_not_used(bench, damage):
    keeper = SavedState(percuss.load(bench / "case.yaml"), compiled=True, resume=False)
    sound = keeper.path.read_bytes()
    middle = len(sound) // 2
    flipped = sound[:middle] + bytes([sound[middle] ^ 1]) + sound[middle + 1 :]
    if damage == "other arrays":
        keeper.offer(7, 1.0, [np.zeros(3)], at_once=True)
    else:
        keeper.path.write_bytes({"a bit": flipped, "its end": sound[:-1], "everything": b""}[damage])
    assert refused(bench).startswith(f"--resume: the saved state {keeper.path} is damaged\n")


def test_a_disk_that_is_full_keeps_no_state_and_ends_no_run(monkeypatch):
    def full(path, suffix):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(saved_state, "replacing", full)
    assert outcome(SOLIDS["quad4"]).status == "done"


@pytest.mark.deep
def test_sigkill(tmp_path):
    """A process of its own is killed by the system twice."""
    case = {**hunek(400, end=30.0), "record": {"every": 50, "fields": 20}}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(case))
    code = (
        "import sys; from percuss.results import saved_state; saved_state.SAVE_SECONDS = 0.1\n"
        "from percuss.__main__ import main; sys.exit(main())"
    )
    folder = tmp_path / "cache"
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder)}
    command = [sys.executable, "-P", "-c", code]
    for options in ([], ["--resume"]):
        before = {path: path.stat().st_mtime_ns for path in folder.rglob("[!.]*.state")}
        process = subprocess.Popen([*command, "run", "case.yaml", *options], cwd=tmp_path, env=environment)
        while {path: path.stat().st_mtime_ns for path in folder.rglob("[!.]*.state")} == before:
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
    for words in (("run", "case.yaml", "--resume", "-o", "run.nc"), ("verify", "run.nc")):
        subprocess.run([*command, *words], cwd=tmp_path, env=environment, check=True, timeout=300)
    assert list(folder.rglob("[!.]*.state")) == []
