"""Studies: every run is a row, no finished batch is ever lost, and what did not change is not run again."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest
import yaml

import percuss
import places
from command_line import percuss_command, refused
from fake_studies import law
from marks import deep
from percuss.errors import InputError
from percuss.methods.registry import Registry
from percuss.reporting.tables import show
from percuss.reporting.terminal import study_lines
from percuss.studies.columns import metric
from percuss.studies.layout import RangeSection, SampleSection, study_schema
from percuss.studies.spec import read_study

pytestmark = pytest.mark.slow

ROOT = places.ROOT
HUNEK = str(ROOT / "cases" / "hunek.yaml")
SMALL = {"bodies.short.bar.elements": 20, "bodies.long.bar.elements": 40}
TIMES = ["seconds"]
SHIPPED = sorted((ROOT / "cases" / "studies").glob("*.yaml"))
SHORT = ({"path": "refine", "op": "==", "value": 1},)
FEW = 4


def given(**more):
    return {"percuss-study": 1, "title": "small", "cases": [HUNEK], "set": SMALL, **more}


def write(folder, text="", name="study.yaml", **more):
    path = folder / name
    path.write_text(text or yaml.safe_dump(given(**more)))
    return path


def command(*args):
    return [sys.executable, "-m", "percuss", "study", *map(str, args)]


def same(one, two):
    """Whether two tables are equal bit for bit in all but times."""
    assert list(one.columns) == list(two.columns)
    for name in one.columns.difference(TIMES):
        assert [repr(value) for value in one[name]] == [repr(value) for value in two[name]], name
    return True


# ---------------------------------------------------------------------------------------------- what is run


def test_every_pair_case_and_point_is_a_row(tmp_path):
    cases = [str(tmp_path / name) for name in ("metres.yaml", "other.yaml")]
    for file, length in zip(cases, ("m", "mm"), strict=True):
        case = {**yaml.safe_load(Path(HUNEK).read_text()), "title": file, "units": {"length": length, "force": "N"}}
        Path(file).write_text(yaml.safe_dump(case))
    pairs = {"integrators": ["central-difference", "wu-predictor-corrector"], "contacts": ["penalty", "lagrange"]}
    points = {"time.courant": [0.5, 0.9], "method.contact.beta_s": "0.5:50:log:2"}
    plan = given(tied=True, nudge=True, keep={"histories": 40}, methods=pairs, vary=points, cases=cases)
    study = percuss.study(plan, tmp_path / "a.sqlite", workers=1)
    table = study.table
    assert len(table) == 2 * (2 * (4 + 2) + 2 * 2)
    assert list(table.columns[:5]) == ["case", "integrator", "contact", *points]
    assert study.complete
    stiff = table[(table["method.contact.beta_s"] > 49) & (table.contact == "penalty")]
    assert set(stiff.status) == {"unstable"}
    assert stiff.reason.str.contains("certificate says unstable").all()
    assert stiff.impulse.isna().all()
    for name, count in (("lagrange", 8), ("tied", 8)):  # neither has a stiffness that could be varied
        rows = table[table.contact == name]
        assert (len(rows), set(rows.status)) == (count, {"done"})
        assert rows["method.contact.beta_s"].isna().all()
    done = table[table.status == "done"]
    assert {False} <= set(done.fragile)
    kept = study.histories(done.key.iloc[0])
    assert kept["contact_force"].shape == (len(kept["time"]), 1)
    assert len(kept["time"]) <= 40
    assert kept["contact_force"].dtype == kept["contact_force_exact"].dtype == np.float32
    assert study.histories(stiff.key.iloc[0]) is None
    assert study.provenance["versions"]["percuss"] == percuss.__version__
    assert study.spec["title"] == "small"
    assert study.units == {"force": "N"}  # which all cases name
    assert "norm" in study.columns["force_error_l2"]


def test_a_row_is_what_the_run_says(tmp_path):
    plateau = {"name": "plateau", "quantity": "contact_force", "contact": "tip", "during": [0.02, 0.18], "take": "mean"}
    tip = {"name": "tip", "quantity": "displacement", "probe": "short.right", "take": "final"}
    paths = ["impulse", "energy.final", "contacts.*.peak_force", "exact.contacts.*.force_error_l2"]
    held = {"name": "held", "quantity": "support_force", "support": "long.right", "take": "min"}
    of_support = [held, "supports.long.right.impulse_x", "supports.*.impulse_x"]
    plan = given(vary={"method.contact.beta_s": [0.5]}, measure=[*paths, plateau, tip, *of_support])
    study = percuss.study(plan, tmp_path / "a.sqlite", workers=1)
    (row,) = study.as_records()
    result = percuss.run(percuss.load(HUNEK), {**SMALL, "method.contact.beta_s": 0.5})
    force = result.histories["contact_force"].sel(contact="tip", time=slice(0.02, 0.18))
    assert [row[path] for path in paths] == [
        metric(result, "impulse"),
        result.summary["energy"]["final"],
        result.summary["contacts"]["tip"]["peak_force"],
        result.summary["exact"]["contacts"]["tip"]["force_error_l2"],
    ]
    assert row["plateau"] == pytest.approx(float(force.mean()), rel=1e-12)
    assert row["tip"] == float(result.arrays["displacement"][-1, result.coordinates["probe"].index("short.right"), 0])
    assert study.columns["plateau"] == "mean of contact_force of tip during 0.02 to 0.18"
    assert row["held"] == result.arrays["support_force"].min() < 0.0
    assert study.columns["held"] == "min of support_force of long.right, component 0"
    assert {row[path] for path in of_support[1:]} == {result.summary["supports"]["long.right"]["impulse_x"]}


def test_values_go_together_under_conditions_and_a_run_that_is_not_valid_says_so(tmp_path):
    pairs = [(0.5, 0.3), (100.0, 0.4)]
    paired = [{"method.contact.beta_s": stiffness, "time.end": end} for stiffness, end in pairs]
    where = [{"path": "time.courant", "op": "<", "value": 0.6}]
    warned = {**SMALL, "method.integrator": "central-difference", "time.on_unstable": "warn"}
    more = {"vary": {"time.courant": [0.3, 0.5, 0.7]}, "paired": paired, "where": where, "set": warned}
    plan = given(methods={"contacts": ["penalty"]}, **more)
    table = percuss.study(plan, tmp_path / "a.sqlite", workers=1).table
    found = list(table[["time.courant", *paired[0]]].itertuples(index=False))
    assert found == [(courant, *pair) for courant in (0.3, 0.5) for pair in pairs]
    assert set(table.status) == {"done"}
    doubtful = table["method.contact.beta_s"] > 1
    assert list(table.reason.str.contains("the certificate says unstable")) == list(doubtful)
    assert (table[doubtful].energy_kept > 2).all()


def test_a_comparison_is_the_same_runs(tmp_path):
    laws, change = ["penalty", "bipenalty", "lagrange"], {**SMALL, "method.contact.beta_s": 100}
    runs = percuss.compare(percuss.load(HUNEK, change), ["central-difference"], laws, {"refine": [1, 2]}, tied=True)
    methods = {"integrators": ["central-difference"], "contacts": laws}
    plan = given(set=change, methods=methods, vary={"refine": [1, 2]}, tied=True)
    table = percuss.study(plan, tmp_path / "a.sqlite", workers=1).table
    told = [(run.integrator, run.contact, run.varied["refine"], run.status, run.reason) for run in runs]
    assert told == list(table[["integrator", "contact", "refine", "status", "reason"]].itertuples(index=False))
    done = [(metric(run.result, "impulse"), metric(run.result, "noise")) for run in runs if run.status == "done"]
    assert done == list(table[table.status == "done"][["impulse", "noise"]].itertuples(index=False))


@pytest.mark.parametrize("method", ["random", "latin-hypercube", "sobol", "halton"])
def test_a_sample_is_reproducible_and_within_its_box(method):
    axes = {"a": RangeSection(1.0, 3.0), "b": RangeSection(0.01, 100.0, "log")}
    points = SampleSection(64, axes, method, 7).points()
    assert points == SampleSection(64, axes, method, 7).points()
    assert points != SampleSection(64, axes, method, 8).points()
    a, b = (np.array([one[name] for one in points]) for name in "ab")
    assert ((a >= 1) & (a <= 3)).all()
    assert ((b >= 0.01) & (b <= 100)).all()
    assert 16 < np.sum(b < 1) < 48  # half of them in half of the decades
    if method == "latin-hypercube":
        assert sorted(np.floor((a - 1) * 32).astype(int)) == list(range(64))


@pytest.mark.parametrize(
    "path",
    [deep(path) if path.stem in {"sensitivity", "family", "solids"} else path for path in SHIPPED],
    ids=lambda path: path.stem,
)
def test_a_shipped_study_is_one(path, tmp_path):
    validator = jsonschema.Draft202012Validator(study_schema(Registry.load()))
    full = {**yaml.safe_load(path.read_text()), "sample": {"count": 4, "of": {"a.b": {"from": 0.1, "to": 1}}}}
    assert [error.message for error in validator.iter_errors(full)] == []
    for wrong in ({"vari": {}}, {"percuss-study": 2}, {"methods": {"contacts": ["penalti"]}}, {"sample": {"count": 0}}):
        assert not validator.is_valid({**full, **wrong})
    spec = read_study(path)
    assert spec.data["title"]
    assert spec.data["question"]
    # its first points on the first case are made, with the first methods of each kind
    boundary = {
        **spec.data,
        "methods": {kind: names[:FEW] for kind, names in spec.data.get("methods", {}).items()},
        "cases": [str(path.parent / spec.data["cases"][0])],
        "where": [*SHORT] if spec.vary else [],
    }
    study = percuss.study(boundary, tmp_path / "a.sqlite", workers=1)
    assert study.complete
    assert study.counts["done"] >= 3


# ------------------------------------------------------------------------------------- running and resuming

RUNS = 100
MANY = {"vary": {"method.contact.beta_s": f"0.05:2:log:{RUNS}"}}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The table of a study that nothing interrupts, made in one process."""
    folder = tmp_path_factory.mktemp("whole")
    return percuss.study(given(**MANY), folder / "a.sqlite", workers=1).table


@pytest.mark.deep
def test_workers_give_what_one_process_gives_and_nothing_is_run_twice(whole, tmp_path, monkeypatch):
    seen = []
    study = percuss.study(given(**MANY), tmp_path / "a.sqlite", workers=2, progress=lambda *at: seen.append(at))
    assert same(study.table, whole)
    assert (study.found, seen[0], seen[-1]) == (0, (0, RUNS), (RUNS, RUNS))
    assert seen == sorted(seen)
    monkeypatch.setattr("percuss.studies.columns.timed_run", None)
    seen.clear()
    again = percuss.study(given(**MANY), tmp_path / "a.sqlite", progress=lambda *at: seen.append(at))
    assert (again.found, seen) == (RUNS, [(RUNS, RUNS)])
    assert same(again.table, whole)


@pytest.mark.deep
def test_killed_at_any_moment_it_goes_on_and_ends_the_same(whole, tmp_path):
    file, out = write(tmp_path, **MANY), tmp_path / "a.sqlite"
    draw = np.random.default_rng(int(os.environ.get("PERCUSS_SEED", "3")))
    counts = []
    for _ in range(6):
        process = subprocess.Popen(command(file, "-o", out, "--workers", 2), stderr=subprocess.DEVNULL)
        begun = time.monotonic()
        while not out.exists() and time.monotonic() - begun < 60:
            time.sleep(0.02)
        time.sleep(draw.uniform(0.0, 2.0))
        below = [pid for child in children(process.pid) for pid in (child, *children(child))]
        process.kill()
        process.wait()
        assert ended(below)
        table = percuss.open_study(out).table if out.exists() else ()
        if len(table):
            done = table[table.status != "waiting"]
            counts.append(len(done))
            before = whole[whole.key.isin(done.key)]
            assert [repr(v) for v in done.impulse] == [repr(v) for v in before.impulse]  # no row is torn
    assert counts == sorted(counts)  # none is lost
    last = subprocess.run(command(file, "-o", out, "--json"), capture_output=True, text=True, check=True)
    told = json.loads(last.stdout)
    assert told["found"] == (counts[-1] if counts else 0)
    assert same(percuss.open_study(out).table, whole)
    done = subprocess.run(command(file, "-o", out), capture_output=True, text=True, check=True)
    assert f"{RUNS} found done" in done.stdout


def children(pid):
    """Return the processes that a process started; workers are children of a child."""
    try:
        return [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except (OSError, ProcessLookupError):
        return []


def ended(pids, within=20.0):
    """Whether processes end by themselves."""
    begun = time.monotonic()
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        if time.monotonic() - begun > within:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.deep
def test_a_run_that_ends_its_worker_once_is_made_again_and_one_that_always_does_is_lost(tmp_path):
    fate = """if dt < 0.01 and (0.9 < self.beta_s < 1.1 or self.beta_s < 0.15 and not os.path.exists("died")):
            open("died", "w").close()
            os._exit(7)"""
    file, out = law(tmp_path, fate=fate), tmp_path / "a.sqlite"
    text = write(tmp_path, methods={"contacts": ["mine"]}, vary={"method.contact.beta_s": [0.1, 0.2, 1.0, 0.4]})
    done = percuss_command("study", text, "-o", out, "--workers", 2, "--plugin", file, cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    reason = "its worker process ended with exit code 7, twice, while it made this run"
    assert f"1 of 4 runs lost; the same command makes them again. The first: {reason}\n" in done.stderr
    assert [row["status"] for row in percuss.open_study(out).as_records()] == ["done", "done", "lost", "done"]


@pytest.mark.deep
def test_ctrl_c_keeps_what_is_finished(tmp_path):
    slow = law(tmp_path, fate="time.sleep(float(os.environ.get('SECONDS_TO_BIND', '0')))")
    given_study = {"methods": {"contacts": ["mine"]}, "vary": {"method.contact.beta_s": "0.05:2:log:60"}}
    file, out = write(tmp_path, **given_study), tmp_path / "a.sqlite"
    before = 0
    for workers in (1, 2):
        process = subprocess.Popen(
            command(file, "-o", out, "--workers", workers, "--plugin", slow),
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env=os.environ | {"SECONDS_TO_BIND": "0.05"},  # no machine ends 60 such runs before the key is pressed
        )
        begun = time.monotonic()
        while process.poll() is None and time.monotonic() - begun < 60:
            time.sleep(0.05)
            if out.exists() and percuss.open_study(out).counts.get("done", 0) > before:
                break
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        said = process.communicate(timeout=60)[1]
        assert process.returncode == 130
        assert "the same command continues from here" in said
        assert "Traceback" not in said
        assert before < percuss.open_study(out).counts["done"] < 60
        before = percuss.open_study(out).counts["done"]
    uninterrupted = percuss.study(given(**given_study), tmp_path / "whole.sqlite", workers=1, plugins=[slow])
    assert same(percuss.study(file, out, plugins=[slow]).table, uninterrupted.table)


def test_what_changed_is_run_again_and_only_that(tmp_path):
    out = tmp_path / "a.sqlite"
    study = given(methods={"contacts": ["mine", "penalty"]}, vary={"method.contact.beta_s": [0.2, 0.4]})
    first = percuss.study(study, out, workers=1, plugins=[law(tmp_path)]).table
    assert percuss.study(study, out, workers=1, plugins=[law(tmp_path)]).found == 4
    again = percuss.study(study, out, workers=1, plugins=[law(tmp_path, soft=0.5)])
    assert again.found == 2  # those of the other law
    changed = again.table.peak_force != first.peak_force
    assert list(changed) == [True, True, False, False]
    file = tmp_path / "mine.py"
    changes = [
        ({"question": "another"}, 4),
        ({"vary": {"method.contact.beta_s": [0.3, 0.4]}}, 2),
        ({"set": {**SMALL, "time.courant": 0.4}}, 0),
        ({"nudge": True}, 0),
        ({"measure": ["impulse"]}, 0),
        ({}, 4),  # what is not asked for any more is not forgotten
    ]
    assert [percuss.study({**study, **one}, out, workers=1, plugins=[file]).found for one, _ in changes] == [
        found for _, found in changes
    ]
    assert same(percuss.study(study, out, workers=1, plugins=[file]).table, again.table)


MEASURE = """\
from dataclasses import dataclass
from percuss import Measure


@dataclass(frozen=True)
class Steps(Measure):
    '''Twice the steps.'''

    name = "doubled"
    summary = "Doubled"
    what = "FACTOR times the number of steps"

    def of(self, result):
        return FACTOR * result.summary["steps"]
"""


@pytest.mark.parametrize("most", [1, deep(2)])
def test_a_measure_may_be_a_plug_in(tmp_path, most):
    study = given(measure=["steps", "ripple", "doubled"], vary={"refine": [1, 2]})

    def made(factor, plan=study, workers=1):
        file = tmp_path / "doubled.py"
        file.write_text(MEASURE.replace("FACTOR * result", f"{factor} * result").replace("FACTOR", str(factor)))
        return percuss.study(plan, tmp_path / "a.sqlite", workers=workers, plugins=[file])

    first = made(2, workers=most)
    assert list(first.table.doubled) == [2 * steps for steps in first.table.steps]
    assert first.columns["doubled"] == "2 times the number of steps"
    assert 0 < first.table.ripple.iloc[1] < first.table.ripple.iloc[0] < 0.5
    again = made(3)
    assert again.found == 0
    assert list(again.table.doubled) == [3 * steps for steps in again.table.steps]
    broken = made("1 / 0").table
    assert set(broken.status) == {"failed"}
    assert re.search(r"measure doubled: .*doubled.py:\d+: ZeroDivisionError", broken.reason[0])
    with pytest.raises(InputError, match="Did you mean 'doubled'"):
        made(2, {**study, "measure": ["doubld"]})


@pytest.mark.deep
def test_a_script_without_a_guard_may_run_a_study(tmp_path):
    file = write(tmp_path, vary={"method.contact.beta_s": "0.1:1:20"})
    script = tmp_path / "script.py"
    script.write_text(f"import percuss\nprint(percuss.study({str(file)!r}, 'a.sqlite', workers=2).counts)\n")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "{'done': 20}\n"


# ------------------------------------------------------------------------------------ workers somewhere else


@pytest.fixture
def scheduler():
    """The address of a Dask scheduler with two workers, each a process of its own."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        yield cluster.scheduler_address


@pytest.mark.deep
def test_cases_and_tables_travel_to_the_workers(scheduler, tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    law(home)
    (home / "pulse.csv").write_text("0, 0\n0.1, 0.01\n")
    case = yaml.safe_load(Path(HUNEK).read_text())
    case |= {"plugins": ["mine.py"], "loads": {"push": {"table": {"file": "pulse.csv"}, "on": "short.left"}}}
    (home / "case.yaml").write_text(yaml.safe_dump(case))
    made = given(cases=[str(home / "case.yaml")], methods={"contacts": ["mine"]}, vary={"time.courant": [0.4, 0.5]})
    here = percuss.study(made, tmp_path / "here.sqlite", workers=1).table

    def gone(done, total):  # as on another machine: the file is not there
        (home / "pulse.csv").unlink(missing_ok=True)

    there = percuss.study(made, tmp_path / "there.sqlite", scheduler=scheduler, progress=gone)
    assert list(there.table.status) == ["done", "done"]
    assert same(there.table, here)


# -------------------------------------------------------------------------------------------- the wrong input

HEAD = "percuss-study: 1\ncases: [hunek.yaml]\n"
WRONG = {  # studies with some mistakes each, which are told at once: of form, then of content, then in values
    "cases: [hunek.yaml]\n": ["1:1: percuss-study: expected version 1 of the format, found null"],
    "percuss: 1\n": ["1:1: percuss: is a case, not a study"],
    HEAD + "vari: {refine: [1]}\nvary: [1]\nkeep: 3\ntied: maybe\n"
    "sample: {count: 4, of: {time.courant: {from: 1, to: 0.5}}}\n": [
        "3:1: vari: unknown key 'vari' of the study",
        "4:7: vary: expected a mapping of paths to values, found [1]",
        "5:7: keep: expected a mapping, found 3",
        "6:7: tied: expected true or false, found 'maybe'",
        "7:25: sample.of.time.courant: has no width: `to` 0.5 is not above `from` 1",
    ],
    "percuss-study: 1\ncases: [hunek.yaml, hunec.yaml]\nset: {refine: 0}\nmethods: {contacts: [penalti, 3]}\n"
    "vary: {refine: '1:2', time.end: 1, dt: 1:1:2000000}\npaired: [{time.end: 1}, {time.courant: 1}]\n"
    "measure: [impuls, energy.finl, {name: status, quantity: impulse, take: value}]\n"
    "where: [{path: a, op: <, value: 2}]\n": [
        "2:21: cases.1: no such file: hunec.yaml",
        "3:15: set.refine: expected a number greater than 0 and less than 1e18, found 0",
        "4:22: methods.contacts.0: unknown contact law 'penalti'",
        "4:31: methods.contacts.1: expected the name of a contact law, found 3",
        "5:16: vary.refine: expected a range, found '1:2'",
        "5:40: vary.dt: expected numbers and a count of 1 to 1000000, found '1:1:2000000'",
        "6:9: paired: time.end is varied twice",
        "6:25: paired.1: has time.courant, and the first has time.end",
        "7:11: measure.0: unknown measure 'impuls'",
        "7:19: measure.1: the summary of a run has no 'energy.finl'",
        "7:32: measure.2: the name 'status' is the name of another column",
        "8:16: where.0.path: 'a' is not varied",
    ],
    HEAD + "vary: {refine: [1]}\nmeasure:\n  - supports.long.rigth.impulse_x\n"
    "  - {name: held, quantity: support_force, support: long.rigth, component: 1, take: max}\n": [
        "5:5: measure.0: the summary of a run has no 'supports.long.rigth'",
        "6:52: measure.1.support: there is no support 'long.rigth'",
        "6:75: measure.1.component: expected 0 only, found 1",
    ],
    HEAD + "methods: {contacts: [lagrange, {name: penalty, beta_s: [1, 2]}]}\nvary: {refine: [1, 0]}\n"
    "paired: [{time.courant: -1}, {time.courant: 1}]\n": [
        "3:56: methods.contacts.1.beta_s: expected a number greater than 0 or 'auto', found [1, 2]",
        "4:20: vary.refine.1: expected a number greater than 0 and less than 1e18, found 0",
        "5:25: paired.0.time.courant: expected a number greater than 0",
    ],
    HEAD + "vary:\n  method.contact.beta: [1, 2]\n": [
        "4:3: vary.method.contact.beta: unknown key 'beta' of the contact law bipenalty"
    ],
    HEAD + "vary: {refine: [1, 2]}\nwhere: [{path: refine, op: <, value: '4'}]\n": [
        "4:8: where: leaves no run to be made"
    ],
    HEAD + "sample: {count: 1000000, of: {refine: {from: 1, to: 2}}}\nvary: {time.courant: [0.4, 0.5]}\n": [
        "4:1: vary: expected at most 1000000 combinations of values, found 2000000"
    ],
}


@pytest.mark.parametrize("text", WRONG)
def test_every_mistake_in_a_study_is_told_at_its_place(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("hunek.yaml").write_text(Path(HUNEK).read_text())
    Path("study.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        percuss.study("study.yaml")
    told = [f"{problem.place}: {problem.path}: {problem.message}" for problem in caught.value.problems]
    assert len(told) == len(WRONG[text]), told
    for message, said in zip(told, WRONG[text], strict=True):
        assert message.startswith(f"study.yaml:{said}"), told
    assert sorted(one.name for one in tmp_path.iterdir()) == ["hunek.yaml", "study.yaml"]


def test_a_measure_of_a_time_that_some_runs_do_not_reach_is_told(tmp_path, capsys):
    later = {"name": "later", "during": [0.05, 6], "quantity": "contact_force", "contact": "tip", "take": "mean"}
    last = {"name": "last", "quantity": "gap", "contact": "tip", "at": 3}
    plan = given(vary={"time.end": [0.03, 0.08]}, measure=[later, last])
    made = percuss.study(plan, tmp_path / "a.sqlite", workers=1)
    assert made.table.later.isna().tolist() == [True, False]
    show(study_lines(made))
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("no value")]
    assert told == [
        "no value of later in 1 of 2 done: mean of contact_force of tip during 0.05 to 6",
        "no value of last in 2 of 2 done: gap of tip at 3",
    ]


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["nowhere.yaml"], "no such file"),
        (["study.yaml", "--workers", "0"], "--workers: expected a number of at least 1, found 0"),
        (["study.yaml", "--again", "faild"], "--again: expected one of failed, unstable, refused, done, found 'faild'"),
        (["study.yaml", "--export", "a.xls"], "expected a table ending in .csv, found .xls"),
        (["study.yaml", "--scheduler", "tcp://127.0.0.1:9"], "nobody answers"),
        (["study.yaml", "-o", "nowhere/a.sqlite"], "expected a folder nowhere"),
        (["study.yaml", "-o", "study.yaml"], "study.yaml: expected a file to write, found the study study.yaml"),
    ],
    ids=str,
)
def test_wrong_use_of_the_command_is_one_clear_message(args, said, tmp_path, monkeypatch):
    monkeypatch.setattr("percuss.studies.pool.CONNECT_SECONDS", 0.5)
    write(tmp_path)
    assert said in refused("study", *args, cwd=tmp_path)
    assert [one.name for one in tmp_path.iterdir()] == ["study.yaml"]


def test_a_dry_run_counts_the_runs_and_an_export_has_them(tmp_path):
    methods = {"integrators": ["central-difference", "wu-predictor-corrector"], "contacts": ["lagrange", "penalty"]}
    path = write(tmp_path, methods=methods, vary={"time.courant": [0.4, 0.5]})
    told = percuss_command("study", path, "--dry-run", cwd=tmp_path)
    assert (told.returncode, told.stdout) == (0, "small: 8 runs; none was made\n"), told.stderr
    assert json.loads(percuss_command("study", path, "--dry-run", "--json").stdout) == {"title": "small", "runs": 8}
    assert list(tmp_path.iterdir()) == [path]
    done = percuss_command("study", path, "--workers", 1, "--export", "a.csv", cwd=tmp_path)
    assert "8 runs: 8 done" in done.stdout
    table, whole = pd.read_csv(tmp_path / "a.csv"), percuss.open_study(tmp_path / "study.sqlite").table
    assert list(table.columns) == list(whole.columns)
    assert (table.impulse == whole.impulse).all()
