"""A study never shows a number that is not that of its plan: keys, files, failures, costs."""

import dataclasses
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import percuss
import places
from percuss import digest
from percuss.errors import InputError
from percuss.studies import columns
from percuss.studies.spec import read_study
from percuss.studies.study import planned
from strategies import hunek

pytestmark = pytest.mark.slow

ROOT = places.ROOT

# ------------------------------------------------------------------------------- what can change a number is in the key

UTIL = "SOFT = {soft}\n"
LAW = """\
from dataclasses import dataclass
from percuss import ContactLaw
from percuss.methods.interfaces import LinearLaw
from {util} import SOFT


@dataclass(frozen=True)
class Mine(ContactLaw):
    '''A law of mine.'''

    name = "mine"
    summary = "Mine"

    def bind(self, points, dt):
        return LinearLaw("explicit", 1.0 / (SOFT * points.stiffness))
"""
HOOKS = """\
from percuss import hookimpl
from theirs.laws.mine import Mine


@hookimpl
def percuss_contacts():
    return [Mine]
"""
RUN = """
import json, sys, percuss
study = percuss.study("study.yaml", "a.sqlite", workers=1)
rows = study.as_records()
print(json.dumps([study.found, [row["status"] for row in rows], [row["impulse"] for row in rows]]))
"""


def editable(folder):
    """Write a package outside the folders of installations, as an editable one is, and a study that uses it."""
    package = folder / "src" / "theirs"
    (package / "laws").mkdir(parents=True)
    (package / "__init__.py").write_text(HOOKS)
    (package / "laws" / "__init__.py").write_text("")
    (package / "laws" / "mine.py").write_text(LAW.format(util="theirs.laws.util"))
    (package / "laws" / "util.py").write_text("from theirs.elsewhere import SOFT\n")
    (package / "elsewhere.py").write_text(UTIL.format(soft=1.0))
    info = folder / "src" / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[percuss]\nmethods = theirs\n")
    case = hunek(4, contact="mine", integrator="central-difference", end=0.4)
    (folder / "pulse.csv").write_text("0,0\n1,0.002\n")
    case["loads"] = {"pulse": {"table": {"file": "pulse.csv"}, "on": "short.left"}}
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    study = {"percuss-study": 1, "cases": ["case.yaml"], "methods": {"contacts": ["mine"]}, "repeats": 1}
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    return package


def run(folder, **environment):
    """Run the study in a process of its own; return how many rows were there, their statuses, and their impulses."""
    path = os.pathsep.join(filter(None, (str(folder / "src"), os.environ.get("PYTHONPATH"))))
    given = {**os.environ, "PYTHONPATH": path, "NUMBA_DISABLE_JIT": "1", **environment}
    done = subprocess.run(
        [sys.executable, "-c", RUN], cwd=folder, capture_output=True, text=True, check=False, env=given
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_an_installed_plug_in_is_in_the_provenance(tmp_path):
    editable(tmp_path)
    run(tmp_path)
    there = percuss.open_study(tmp_path / "a.sqlite").provenance["plugins"]
    assert all((origin["distribution"], origin["version"]) == ("theirs", "1.0") for origin in there.values())
    digests = {name: origin["digest"] for name, origin in there.items()}
    assert set(digests) == {"contacts/mine"}
    assert all(re.fullmatch("[0-9a-f]{32,}", digest) for digest in digests.values())
    (tmp_path / "src" / "theirs" / "elsewhere.py").write_text(UTIL.format(soft=0.5))
    run(tmp_path)
    later = percuss.open_study(tmp_path / "a.sqlite").provenance["plugins"]
    assert later["contacts/mine"]["digest"] != digests["contacts/mine"]


@pytest.mark.deep
def test_an_edit_of_whatever_a_number_hangs_on_makes_the_row_again(tmp_path):
    package = editable(tmp_path)
    found, statuses, first = run(tmp_path)
    assert (found, statuses) == (0, ["done"])
    edits = [
        (package / "elsewhere.py", UTIL.format(soft=0.5)),  # a helper of the law, two modules away
        (tmp_path / "pulse.csv", "0,0\n1,0.005\n"),
    ]
    for file, text in edits:
        file.write_text(text)
        found, statuses, impulses = run(tmp_path)
        assert (found, statuses) == (0, ["done"]), file
        assert impulses[0] != first[0]
        first = impulses
    assert run(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))[0] == 1  # changes no number
    (tmp_path / "a.sqlite").unlink()
    assert run(tmp_path)[2] == first  # a fresh run says the same


def test_versions_and_own_sources_count(monkeypatch):
    """All rooms but those that only show a result."""
    read = []
    real = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read.append(path) or real(path))
    digest.own_digest.__wrapped__()
    package = Path(digest.__file__).parent
    rooms = {path.relative_to(package).parts[0] for path in read}
    assert rooms >= {"case", "certificate", "contact", "march", "mesh", "methods", "results", "step", "studies"}
    assert not rooms & {"cli", "reporting", "testing"}
    assert {"python", "numpy", "numba", "scipy"} <= set(digest.surroundings())


def write_case(folder, name="case.yaml", contact=None, **more):
    case = {**hunek(4, integrator="central-difference", contact=contact, end=0.4), **more}
    if contact == "mine":
        case["plugins"] = []
    path = folder / name
    path.write_text(yaml.safe_dump(case))
    return path


def given(folder, **more):
    if not (folder / "case.yaml").exists():
        write_case(folder)
    return {"percuss-study": 1, "title": "small", "cases": [str(folder / "case.yaml")], "repeats": 1, **more}


def written(folder, name="study.yaml", **more):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(given(folder if folder.exists() else path.parent, **more)))
    return path


# ------------------------------------------------------------------------------------------------ the file of the rows


def test_two_studies_in_one_file_lose_no_row(tmp_path):
    """The keys tell which rows belong to a study: the file shows the last, and keeps the rows of the other."""
    plans = [
        given(tmp_path, title=title, vary={"time.courant": values})
        for title, values in (("1", [0.3, 0.4]), ("2", [0.5]))
    ]
    first = percuss.study(plans[0], tmp_path / "a.sqlite", workers=1).table
    other = percuss.study(plans[1], tmp_path / "a.sqlite", workers=1)
    assert (other.title, other.found, other.counts) == ("2", 0, {"done": 1})
    again = percuss.study(plans[0], tmp_path / "a.sqlite", workers=1)
    assert again.found == 2
    assert again.table.equals(first)


def test_a_study_has_the_units_that_all_its_cases_name(tmp_path):
    write_case(tmp_path, units={"length": "m", "force": "N"})
    write_case(tmp_path, "other.yaml", units={"length": "mm", "force": "N"})
    cases = [str(tmp_path / name) for name in ("case.yaml", "other.yaml")]
    study = percuss.study(given(tmp_path) | {"cases": cases}, tmp_path / "a.sqlite", workers=1)
    assert percuss.open_study(study.path).units == {"force": "N"}


def test_two_at_once_are_refused_and_a_dead_one_is_no_obstacle(tmp_path):
    file, out = written(tmp_path), tmp_path / "a.sqlite"
    holds = (
        "import sys, time, pathlib\nfrom percuss.locks import locked\n"
        "with locked(pathlib.Path(sys.argv[1])):\n    print('held', flush=True)\n    time.sleep(60)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", holds, str(out)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    command = [sys.executable, "-m", "percuss", "study", str(file), "-o", str(out), "--workers", "1"]
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert "is being written by another process" in refused.stderr
    assert "Traceback" not in refused.stderr
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert (tmp_path / "a.sqlite.lock").exists()
    assert percuss.study(file, out, workers=1).counts == {"done": 1}
    assert not (tmp_path / "a.sqlite.lock").exists()


# ------------------------------------------------------------------------------------- failures that are not a method's


@pytest.mark.parametrize("error", [MemoryError("no"), FileNotFoundError("gone"), ImportError("no module")])
def test_what_the_machine_does_is_not_the_methods_fault(tmp_path, monkeypatch, error):
    out = tmp_path / "a.sqlite"
    study = given(tmp_path, vary={"time.courant": [0.3, 0.4]})
    real = columns.timed_run

    def fails(case, **options):
        if case.time.courant == 0.4:
            raise error
        return real(case, **options)

    with monkeypatch.context() as patched:
        patched.setattr(columns, "timed_run", fails)
        first = percuss.study(study, out, workers=1)
    assert first.counts == {"done": 1, "lost": 1}
    assert not first.complete
    assert type(error).__name__ in first.table.reason[1]
    again = percuss.study(study, out, workers=1)
    assert (again.found, again.counts) == (1, {"done": 2})
    assert again.complete


def test_a_plug_ins_own_error_is_kept_and_made_again_when_asked_for(tmp_path):
    law = LAW.replace("from {util} import SOFT\n", "SOFT = 1.0\n")
    file = tmp_path / "mine.py"
    file.write_text(law.replace("return LinearLaw", "{}['nothing']\n        return LinearLaw"))
    study = given(tmp_path, methods={"contacts": ["mine", "penalty"]})
    first = percuss.study(study, tmp_path / "a.sqlite", workers=1, plugins=[file])
    assert first.counts == {"failed": 1, "done": 1}
    assert percuss.study(study, tmp_path / "a.sqlite", workers=1, plugins=[file]).found == 2
    again = percuss.study(study, tmp_path / "a.sqlite", workers=1, plugins=[file], again=["failed"])
    assert (again.found, again.counts) == (1, {"failed": 1, "done": 1})
    with pytest.raises(InputError, match="--again: expected one of failed, unstable, refused, done, found 'faild'"):
        percuss.study(study, tmp_path / "a.sqlite", workers=1, plugins=[file], again=["faild"])


def test_a_plug_in_that_is_another_where_the_run_is_made_is_told(tmp_path):
    jobs, bench = planned(read_study(given(tmp_path)))
    components = {"case": {**bench.components["case"], "contacts/theirs": "0" * 64}}
    record = dataclasses.replace(bench, components=components, cases={}).record(jobs[0])
    assert record.status == "lost"
    assert "expected contacts/theirs as where the study was started" in record.reason
    assert bench.record(jobs[0]).status == "done"


def test_memory_that_another_machine_may_have_is_no_failure_of_a_method(tmp_path, monkeypatch):
    from percuss.mesh import size_limits

    study = given(tmp_path, vary={"time.end": [0.4, 4000.0]})
    with monkeypatch.context() as patched:
        patched.setattr(size_limits, "memory", lambda: 2**21)
        made = percuss.study(study, tmp_path / "a.sqlite", workers=1)
    assert list(made.table.status) == ["done", "lost"]
    assert "expected records that fit into memory" in made.table.reason[1]


# -------------------------------------------------------------------------------------------------- what a row costs


def test_the_cost_of_a_row_is_its_march(tmp_path):
    study = given(tmp_path, vary={"refine": [1, 2]}, measure=["steps", "seconds.total"], repeats=3)
    table = percuss.study(study, tmp_path / "a.sqlite", workers=1).table
    assert list(table.node_steps) == [steps * n for steps, n in zip(table.steps, (14, 26), strict=True)]
    assert (table.seconds < 0.5 * table["seconds.total"]).all()
    processors = percuss.open_study(tmp_path / "a.sqlite").provenance["processors"]
    assert list(processors.values()) == [2]


def test_the_least_of_the_repeats_counts(monkeypatch):
    from percuss.march.march import March
    from percuss.results import runner

    times = iter([0.5, 0.2, 0.3, 0.9])
    real, made = March.run, []

    def run(self, *args, **options):
        outcome = real(self, *args, **options)
        outcome.seconds["march"] = next(times)
        made.append(outcome)
        return outcome

    monkeypatch.setattr(March, "run", run)
    case = percuss.load(hunek(4, end=0.1))
    result = runner.timed_run(case, repeats=4)
    assert result.summary["seconds"]["march"] == 0.2
    assert len(made) == 4
    assert all(np.array_equal(one.record.gap, made[0].record.gap) for one in made)


COMPILES = """
import json, sys, percuss
from percuss.studies.perform import perform
from percuss.studies.tasks import tasks
case = percuss.load(json.loads(sys.argv[1]))
(twin,) = [task for task in tasks({"": case}, {}, {}, [{}], tied=True) if task.tied]
rows = [perform(case, twin)[0] for _ in range(2)]
print(json.dumps([row.result.summary["seconds"] for row in rows]))
"""


@pytest.mark.deep
def test_compiling_is_counted_wherever_it_happens(tmp_path):
    """A tied twin compiles within its certificate."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment.pop("NUMBA_DISABLE_JIT", None)
    case = hunek(4, integrator="central-difference", end=0.3)
    command = [sys.executable, "-c", COMPILES, json.dumps(case)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    cold, warm = json.loads(done.stdout)
    assert cold["compile"] > 1.0
    assert cold["compile"] > 0.5 * cold["total"]
    assert warm["compile"] < 0.2 * cold["compile"]
    for seconds in (cold, warm):
        parts = sum(seconds[name] for name in ("build", "certificate", "march", "exact", "compile"))
        assert parts <= seconds["total"] * 1.001
    assert cold["certificate"] < 0.5 * cold["compile"]


# -------------------------------------------------------------------------------- options that a method does not have


def test_a_law_without_the_varied_option_runs_once(tmp_path):
    study = given(
        tmp_path,
        methods={"contacts": ["penalty", "bipenalty", "lagrange"]},
        vary={"method.contact.beta_s": [0.1, 0.2], "method.contact.ratio": [1, 2, 3], "refine": [1, 2]},
        tied=True,
    )
    table = percuss.study(study, tmp_path / "a.sqlite", workers=1).table
    assert set(table.status) == {"done"}
    assert dict(table.contact.value_counts()) == {"bipenalty": 12, "penalty": 4, "lagrange": 2, "tied": 2}
    lagrange, penalty = (table[table.contact == name] for name in ("lagrange", "penalty"))
    assert lagrange["method.contact.beta_s"].isna().all()
    assert penalty["method.contact.ratio"].isna().all()
    assert sorted(zip(penalty["method.contact.beta_s"], penalty.refine, strict=True)) == [
        (0.1, 1), (0.1, 2), (0.2, 1), (0.2, 2),
    ]  # fmt: skip
    assert len(set(table.key)) == len(table)


def test_options_of_different_laws_are_varied_together(tmp_path):
    """Penalty has no ratio, and lagrange has none of the two: no pair has all that is varied."""
    methods = {"contacts": ["penalty", "lagrange"]}
    study = given(tmp_path, methods=methods, vary={"method.contact.beta_s": [0.1, 0.2]})
    assert len(percuss.study(study, tmp_path / "a.sqlite", workers=1).table) == 3
    with pytest.raises(InputError, match="unknown key 'ratio'"):
        percuss.study({**study, "vary": {"method.contact.ratio": [1, 2]}}, tmp_path / "b.sqlite", workers=1)


def test_a_comparison_runs_such_a_law_once_too(tmp_path):
    case = percuss.load(hunek(4, integrator="central-difference", end=0.3))
    rows = percuss.compare(case, [], ["penalty", "lagrange"], {"method.contact.beta_s": [0.1, 0.2]})
    assert [(row.contact, dict(row.varied), row.status) for row in rows] == [
        ("penalty", {"method.contact.beta_s": 0.1}, "done"),
        ("penalty", {"method.contact.beta_s": 0.2}, "done"),
        ("lagrange", {}, "done"),
    ]
    with pytest.raises(InputError, match="unknown key 'ratoi'"):
        percuss.compare(case, [], ["penalty", "lagrange"], {"method.contact.ratoi": [1]})
