"""Following a row: its command makes the same run alone, and whether its bits are the same is verified."""

import json
import math
import shlex
import sqlite3
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import percuss
import places
from command_line import percuss_command
from opened_page import Opened
from percuss.case.quantities import METRICS
from percuss.studies.columns import metric

pytestmark = pytest.mark.slow

SMALL = {"bodies.short.bar.elements": 10, "bodies.long.bar.elements": 20}
LAW = """\
from dataclasses import dataclass
from typing import Annotated
from percuss import ContactLaw
from percuss.methods.interfaces import Gt, LinearLaw, Unit


@dataclass(frozen=True)
class Mine(ContactLaw):
    '''A law of mine.'''

    name = "mine"
    summary = "Mine"

    beta_s: Annotated[float, Gt(0), Unit("1")] = 0.25

    def bind(self, points, dt):
        return LinearLaw("explicit", 1.0 / (self.beta_s * points.stiffness))
"""


def hunek():
    return yaml.safe_load((places.ROOT / "cases" / "hunek.yaml").read_text(encoding="utf-8"))


def bench(folder, **more):
    """Write a case with a law of its own, a table and a plug-in in a folder with a difficult name; return the study."""
    cases = folder / "it's here"
    cases.mkdir()
    case = hunek()
    case["contacts"]["tip"]["method"] = {"name": "lagrange"}
    case["loads"] = {"push": {"table": {"file": "pulse.csv"}, "on": "short.left"}}
    (cases / "pulse.csv").write_text("0, 0\n0.1, 0.01\n")
    (cases / "my case.yaml").write_text(yaml.safe_dump(case))
    (folder / "mine.py").write_text(LAW)
    study = {"percuss-study": 1, "cases": ["../it's here/my case.yaml"], "set": SMALL, "measure": [*METRICS], **more}
    (folder / "plans").mkdir(exist_ok=True)
    (folder / "plans" / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False))
    return Path("plans", "study.yaml")


def numbers(values):
    """Return the metrics of a row or of the summary of a run as texts, which tell numbers apart by their bits."""
    return {name: repr(values[name]) for name in METRICS}


def run_alone(command, folder):
    """Return the summary of the run that a command makes."""
    program, *words = shlex.split(command)
    assert program == "percuss"
    done = percuss_command(*words, "--json", cwd=folder)
    summary = json.loads(done.stdout)
    assert summary["status"] in {"done", "unstable", "failed", "bad input"}, done.stderr
    # a summary has no displacements, by whose size overlaps of round-off count as none
    return SimpleNamespace(summary=summary, arrays={"displacement": np.ones(1)})


def expect_same_runs(study, folder):
    for row in study.as_records():
        command = study.command(row["key"])
        alone = run_alone(command, folder)
        assert alone.summary["status"] == row["status"], command
        if row["status"] == "done":
            assert numbers({name: metric(alone, name) for name in METRICS}) == numbers(row), command


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A study with a plug-in, a law with options, its own law of a contact, a table, list values, tied and nudged."""
    folder = tmp_path_factory.mktemp("bench")
    plan = bench(
        folder,
        methods={"contacts": ["penalty", "mine", {"name": "bipenalty", "beta_s": 0.3, "ratio": 2}, "lagrange"]},
        vary={"method.contact.beta_s": [1e-05, 0.1 + 0.2, 50.0], "bodies.short.velocity": [[0.1], 1]},
        tied=True,
        nudge=True,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        study = percuss.study(plan, folder / "rows.sqlite", workers=1, plugins=["mine.py"])
    return SimpleNamespace(study=study, folder=folder)


def test_the_command_of_a_row_makes_its_run(whole):
    table = whole.study.table
    assert set(table["contact"]) == {"penalty", "mine", "bipenalty", "lagrange", "tied"}
    assert {"done", "unstable"} <= set(table["status"])
    key = table["key"][0]
    assert whole.study.command(key) == f"percuss run {whole.study.path} --row {key}"
    assert whole.study.command("of no run") is None
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
    law = whole.folder / "mine.py"
    mine = done.query("contact == 'mine'")["key"].iloc[0]
    law.write_text(LAW.replace("1.0 /", "1.5 /"))
    try:
        refused = percuss_command("verify", file, "--row", mine, cwd=whole.folder)
        assert refused.returncode == 2
        assert "it has changed since" in refused.stderr
        told = percuss_command("verify", file, "--row", mine, "--plugin", "mine.py", cwd=whole.folder)
        assert told.returncode == 1
        assert "changed since: plug-in contacts/mine: a file, sources " in told.stdout
    finally:
        law.write_text(LAW)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("run", "rows.sqlite", "--row", "nothing"),
            "--row nothing: expected the key of one row of rows.sqlite, found 0",
        ),
        (("run", "rows.sqlite", "--row", ""), "rows.sqlite"),
        (("verify", "rows.sqlite", "--row", "nothing"), "expected the key of one row of rows.sqlite, found 0"),
        (("verify", "mine.py", "--row", "a"), "mine.py: expected the file of a study, found "),
    ],
)
def test_a_row_that_there_is_not_is_told(whole, words, said):
    done = percuss_command(*words, cwd=whole.folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr


def test_options_that_a_later_change_drops_do_not_return(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    penalty = {"name": "penalty", "beta_s": 0.4}
    plan = bench(tmp_path, set={**SMALL, "method.contact": penalty}, methods={"contacts": ["lagrange", "bipenalty"]})
    expect_same_runs(percuss.study(plan, workers=1), tmp_path)


# ---------------------------------------------------------------------------------------------- in the page


@pytest.fixture(scope="module")
def page_of_rows(whole):
    path = whole.folder / "rows.html"
    assert percuss_command("report", whole.study.path, "-o", path).returncode == 0
    return path


def test_the_page_has_the_command_of_each_row(browser, page_of_rows, whole):
    with Opened(browser, page_of_rows) as opened:
        for row, key in enumerate(whole.study.table["key"]):
            opened.page.evaluate("(row) => pick(row)", row)
            assert opened.page.inner_text("#command") == whole.study.command(key)
        assert opened.complaints == []
