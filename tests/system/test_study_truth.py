"""A study never shows a number that is not that of its plan: keys, files, failures, costs, and rows made again."""

import dataclasses
import json
import math
import shlex
import sqlite3
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import percuss
from command_line import percuss_command
from fake_studies import law
from percuss import digest
from percuss.case.quantities import METRICS
from percuss.errors import InputError
from percuss.files import locked
from percuss.studies import columns
from percuss.studies.spec import read_study
from percuss.studies.study import planned
from strategies import hunek

pytestmark = pytest.mark.slow

# ------------------------------------------------------------------------------- what can change a number is in the key


def test_an_edit_of_a_table_makes_the_row_again(tmp_path):
    study, case = given(tmp_path), tmp_path / "case.yaml"
    loads = {"pulse": {"table": {"file": "pulse.csv"}, "on": "short.left"}}
    case.write_text(yaml.safe_dump({**yaml.safe_load(case.read_text()), "loads": loads}))
    impulses = []
    for push in (0.002, 0.005):
        (tmp_path / "pulse.csv").write_text(f"0,0\n1,{push}\n")
        made = percuss.study(study, tmp_path / "a.sqlite", workers=1)
        assert (made.found, made.counts) == (0, {"done": 1})
        impulses.append(made.table.impulse[0])
    assert impulses[0] != impulses[1]
    assert percuss.study(study, tmp_path / "a.sqlite", workers=1).found == 1
    assert percuss.study(study, tmp_path / "fresh.sqlite", workers=1).table.impulse[0] == impulses[1]


def test_versions_and_own_sources_count(monkeypatch):
    """All rooms but those that only show a result."""
    rooms = set()
    monkeypatch.setattr(digest, "_digest", lambda _, parts: rooms.update(part.name for part in parts))
    digest.own_digest.__wrapped__()
    assert rooms >= {"case", "certificate", "contact", "march", "mesh", "methods", "results", "step", "studies"}
    assert not rooms & {"cli", "reporting", "testing"}
    assert {"python", "numpy", "numba", "scipy"} <= set(digest.surroundings())


def given(folder, **more):
    """Return a study of a case of some elements."""
    case = hunek(4, integrator="central-difference", end=0.4)
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    return {"percuss-study": 1, "title": "small", "cases": [str(folder / "case.yaml")], "repeats": 1, **more}


# ------------------------------------------------------------------------------------------------ the file of the rows


def test_two_at_once_are_refused_and_a_dead_one_is_no_obstacle(tmp_path):
    """The operating system takes the lock of a process that has died; its file stays."""
    plan, out = given(tmp_path), tmp_path / "a.sqlite"
    with locked(out), pytest.raises(InputError, match="is being written by another process"):
        percuss.study(plan, out, workers=1)
    (tmp_path / "a.sqlite.lock").touch()
    assert percuss.study(plan, out, workers=1).counts == {"done": 1}
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
    file = law(tmp_path, fate="{}['nothing']")
    study = given(tmp_path, methods={"contacts": ["mine", "penalty"]})
    first = percuss.study(study, tmp_path / "a.sqlite", workers=1, plugins=[file])
    assert first.counts == {"failed": 1, "done": 1}
    assert percuss.study(study, tmp_path / "a.sqlite", workers=1, plugins=[file]).found == 2
    again = percuss.study(study, tmp_path / "a.sqlite", workers=1, plugins=[file], again=["failed"])
    assert (again.found, again.counts) == (1, {"failed": 1, "done": 1})
    with pytest.raises(InputError, match="--again: expected one of failed, unstable, refused, done, found 'faild'"):
        percuss.study(study, tmp_path / "a.sqlite", workers=1, plugins=[file], again=["faild"])


def test_a_plug_in_that_is_another_where_the_run_is_made_is_told(tmp_path):
    (task,), bench = planned(read_study(given(tmp_path)))
    components = {"case": {**bench.components["case"], "contacts/theirs": "0" * 64}}
    record = dataclasses.replace(bench, components=components, cases={}).record(task)
    assert record.status == "lost"
    assert "expected contacts/theirs as where the study was started" in record.reason
    assert bench.record(task).status == "done"


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
    laws, values = ["penalty", "lagrange"], {"method.contact.beta_s": [0.1, 0.2]}
    study = given(tmp_path, methods={"contacts": laws}, vary=values)
    assert len(percuss.study(study, tmp_path / "a.sqlite", workers=1).table) == 3
    wrong = {"method.contact.ratio": [1, 2]}
    with pytest.raises(InputError, match="unknown key 'ratio'"):
        percuss.study({**study, "vary": wrong}, tmp_path / "b.sqlite", workers=1)
    case = percuss.load(tmp_path / "case.yaml")
    rows = percuss.compare(case, [], laws, values)
    told = [(row.contact, *row.varied.values(), row.status) for row in rows]
    assert told == [("penalty", 0.1, "done"), ("penalty", 0.2, "done"), ("lagrange", "done")]
    with pytest.raises(InputError, match="unknown key 'ratio'"):
        percuss.compare(case, [], laws, wrong)


# ------------------------------------------------------------------------------------------------- a row made again


def expect_same_runs(study, folder):
    """Run the command of each row, and compare the numbers of its summary with those of the row, to the last bit."""
    for row in study.as_records():
        program, *words = shlex.split(study.command(row["key"]))
        assert program == "percuss"
        summary = json.loads(percuss_command(*words, "--json", cwd=folder).stdout)
        assert summary["status"] == row["status"], words
        if row["status"] == "done":
            # a summary has no displacements, by whose size overlaps of round-off count as none
            alone = SimpleNamespace(summary=summary, arrays={"displacement": np.ones(1)})
            assert [repr(columns.metric(alone, name)) for name in METRICS] == [repr(row[name]) for name in METRICS]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A study with a plug-in, a law with options, its own law of a contact, a table, list values, tied and nudged."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "it's here").mkdir()
    case = hunek(10, contact={"name": "penalty", "beta_s": 0.3})
    case["contacts"]["tip"]["method"] = {"name": "lagrange"}
    case["loads"] = {"push": {"table": {"file": "pulse.csv"}, "on": "short.left"}}
    (folder / "it's here" / "pulse.csv").write_text("0, 0\n0.1, 0.01\n")
    (folder / "it's here" / "my case.yaml").write_text(yaml.safe_dump(case))
    law(folder)
    plan = {
        "percuss-study": 1,
        "cases": ["it's here/my case.yaml"],
        "methods": {"contacts": ["penalty", "mine", {"name": "bipenalty", "beta_s": 0.3, "ratio": 2}, "lagrange"]},
        "vary": {"method.contact.beta_s": [1e-05, 0.1 + 0.2, 50.0], "bodies.short.velocity": [[0.1], 1]},
        "tied": True,
        "nudge": True,
        "measure": [*METRICS],
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        study = percuss.study(plan, folder / "rows.sqlite", workers=1, plugins=["mine.py"])
    return SimpleNamespace(study=study, folder=folder)


def test_the_command_of_a_row_makes_its_run(whole):
    table = whole.study.table
    assert set(table["contact"]) == {"penalty", "mine", "bipenalty", "lagrange", "tied"}
    assert {"done", "unstable"} <= set(table["status"])
    assert whole.study.command(table["key"][0]) == f"percuss run {whole.study.path} --row {table['key'][0]}"
    expect_same_runs(whole.study, whole.folder)


def test_rows_are_verified_to_the_last_bit(whole, tmp_path):
    """One digit of one row is changed, and the plug-in afterwards: both are named."""
    file, done = tmp_path / "rows.sqlite", whole.study.table.query("status == 'done'")
    file.write_bytes(whole.study.path.read_bytes())
    told = percuss_command("verify", file, cwd=whole.folder)
    assert told.returncode == 0, told.stdout
    assert told.stdout.endswith(f"{len(done)} of {len(done)} made again to the last bit\n")
    key, impulse = done["key"].iloc[1], done["impulse"].iloc[1]
    with sqlite3.connect(file) as db:
        ((row,),) = db.execute("SELECT row FROM runs WHERE key = ?", (key,))
        row = json.loads(row)
        row["measures"]["impulse"] = math.nextafter(impulse, math.inf)
        db.execute("UPDATE runs SET row = ? WHERE key = ?", (json.dumps(row), key))
    db.close()
    told = percuss_command("verify", file, "--row", key[:10], cwd=whole.folder)
    assert told.returncode == 1
    assert f"DIFFERS {file} --row {key[:12]}" in told.stdout
    assert f"  impulse: {math.nextafter(impulse, math.inf)}, now {impulse}" in told.stdout
    assert "nothing that percuss records has changed" in told.stdout
    mine = done.query("contact == 'mine'")["key"].iloc[0]
    law(whole.folder, soft=0.5)
    refused = percuss_command("verify", file, "--row", mine, cwd=whole.folder)
    told = percuss_command("verify", file, "--row", mine, "--plugin", "mine.py", cwd=whole.folder)
    law(whole.folder)
    assert (refused.returncode, told.returncode) == (2, 1)
    assert "it has changed since" in refused.stderr
    assert "changed since: plug-in contacts/mine: a file, sources " in told.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("run rows.sqlite --row nothing", "--row nothing: expected the key of one row of rows.sqlite, found 0"),
        ("verify rows.sqlite --row nothing", "expected the key of one row of rows.sqlite, found 0"),
        ("verify mine.py --row a", "mine.py: expected the file of a study, found "),
    ],
)
def test_a_row_that_there_is_not_is_told(whole, words, said):
    done = percuss_command(*words.split(), cwd=whole.folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr


def test_options_that_a_later_change_drops_do_not_return(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    penalty = {"name": "penalty", "beta_s": 0.4}
    plan = given(tmp_path, set={"method.contact": penalty}, methods={"contacts": ["lagrange", "bipenalty"]})
    expect_same_runs(percuss.study(plan, workers=1), tmp_path)
