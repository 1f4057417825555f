"""Following a row: its command makes the same run alone, and whether its bits are the same is verified."""

import hashlib
import json
import math
import shlex
import sqlite3
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import pages
import percuss
import places
from command_line import percuss_command
from opened_page import Opened
from percuss.case.quantities import METRICS
from percuss.studies import study_files
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
        (("verify", "mine.py", "--row", "a"), "expected the file of a study with --row"),
    ],
)
def test_a_row_that_there_is_not_is_told(whole, words, said):
    done = percuss_command(*words, cwd=whole.folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr


def test_options_that_a_later_change_drops_do_not_return(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = bench(
        tmp_path,
        set={**SMALL, "method.contact": {"name": "penalty", "beta_s": 0.4}},
        methods={"contacts": ["lagrange", "bipenalty"]},
    )
    expect_same_runs(percuss.study(plan, workers=1), tmp_path)


@pytest.mark.deep
def test_a_study_may_set_a_plug_in_and_vary_numbers_and_words(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = bench(
        tmp_path,
        set={**SMALL, "plugins": ["../mine.py"]},
        methods={"contacts": ["penalty", "mine"]},
        vary={"method.contact.beta_s": [0.3], "method.mass": ["lumped", {"name": "lumped"}], "refine": [1, 2]},
    )
    expect_same_runs(percuss.study(plan, workers=1), tmp_path)


def test_the_files_of_a_study_are_kept_with_their_digests(whole):
    files = {file.path: file for file in whole.study.files}
    assert {path: file.role for path, file in files.items()} == {
        "plans/study.yaml": "study",
        "it's here/my case.yaml": "case",
        "it's here/pulse.csv": "data",
        "mine.py": "plug-in",
    }
    for path, file in files.items():
        content = (whole.folder / path).read_bytes()
        assert (file.sha256, file.size, file.text) == (
            hashlib.sha256(content).hexdigest(),
            len(content),
            content.decode(),
        )
    with sqlite3.connect(whole.study.path) as db:
        assert db.execute("SELECT text FROM files WHERE role = 'plug-in'").fetchone() == (LAW,)
    db.close()


def test_of_files_that_are_large_or_no_text_there_is_the_digest_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plan = bench(tmp_path, vary={"time.courant": [0.5]})
    case = Path("it's here", "my case.yaml")
    case.write_bytes(b"\xef\xbb\xbf" + case.read_bytes())  # a mark that belongs to the file and not to its text
    table = Path("it's here", "pulse.csv")
    table.write_text("0, 0\n0.1, 0.01\n" + "\n" * study_files.LONGEST_TEXT)
    found = {file.role: file for file in percuss.study(plan, workers=1).files}
    assert (found["data"].text, found["data"].size) == (None, table.stat().st_size)
    assert found["data"].sha256 == hashlib.sha256(table.read_bytes()).hexdigest()
    assert found["case"].sha256 == hashlib.sha256(case.read_bytes()).hexdigest()
    assert found["case"].text == case.read_text(encoding="utf-8-sig")
    assert percuss_command("report", "study.sqlite").returncode == 0
    assert "Its text was not kept" in Path("study.html").read_text(encoding="utf-8")


# ---------------------------------------------------------------------------------------------- in the page


@pytest.fixture(scope="module")
def page_of_rows(whole):
    path = whole.folder / "rows.html"
    assert percuss_command("report", whole.study.path, "-o", path).returncode == 0
    return path


def state_of(page):
    return page.evaluate(
        """() => ({
          rows: table.getRows("active").map((row) => row.getData().i),
          columns: table.getColumns().filter((shown) => shown.isVisible()).map((shown) => shown.getField()),
          boxes: [...document.querySelectorAll("#columns input")].map((box) => box.checked),
          choices: [...document.querySelectorAll("select")].map((chosen) => chosen.value),
          forces: picked, marked, lines: charts.vary.chart.getOption().series.length,
          methods: [...document.querySelectorAll(".legend.methods button")].map((b) => b.getAttribute("aria-pressed")),
        })"""
    )


def test_the_page_has_the_command_of_each_row(browser, page_of_rows, whole):
    with Opened(browser, page_of_rows) as opened:
        page = opened.page
        shown = page.evaluate("Array.from({ length: page.rows }, (_, row) => commandOf(row))")
        for key, command in zip(whole.study.table["key"], shown, strict=True):
            assert command == whole.study.command(key)
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        before = page.url
        opened.click_in_table(".copy >> nth=3")
        page.wait_for_function('() => document.getElementById("copied").textContent !== ""')
        assert page.inner_text("#copied") == "Copied."
        assert page.evaluate("navigator.clipboard.readText()") == shown[3] == page.inner_text("#command")
        assert page.url == before
        opened.click_in_table(".tabulator-row >> nth=1")
        assert page.inner_text("#command") == shown[1]
        page.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(); }")
        page.click("#copy")
        page.wait_for_function('() => document.getElementById("copied").textContent !== ""')
        assert page.evaluate("getSelection().toString()") == shown[1]
        assert opened.complaints == []


def test_names_stay_in_sight_and_columns_are_chosen(browser, page_of_rows):
    with Opened(browser, page_of_rows) as opened:
        page = opened.page
        place = """(name) => {
          const field = name === "command" ? name : `c${columns.findIndex((one) => one.name === name)}`;
          const cell = document.querySelector(`.tabulator-row .tabulator-cell[tabulator-field="${field}"]`);
          return cell.getBoundingClientRect().x;
        }"""
        names = ["case", "integrator", "contact", "command"]
        before = [page.evaluate(place, name) for name in names]
        page.evaluate('document.querySelector(".tabulator-tableholder").scrollLeft = 250')
        after = [page.evaluate(place, name) for name in names]
        assert after[:3] == before[:3]
        assert after[3] == before[3] - 250
        page.click("#columns summary")
        page.uncheck('#columns input[data-field="command"]')
        page.uncheck("#columns input >> nth=1")
        assert page.locator("#table .copy:visible").count() == 0
        assert page.locator('#table .tabulator-cell[tabulator-field="c1"]:visible').count() == 0
        page.click("#columns button")
        assert page.locator("#table .copy:visible").count() > 5
        assert page.evaluate('[...document.querySelectorAll("#columns input")].every((box) => box.checked)')
        assert opened.complaints == []


@pytest.mark.deep
def test_the_address_holds_what_was_chosen(browser, page_of_rows):
    with Opened(browser, page_of_rows) as opened:
        page = opened.page
        states, addresses = [state_of(page)], [page.url]

        def changed():
            # The page follows a click in its own time, state and address one after the other.
            page.wait_for_function("(address) => location.href !== address", arg=addresses[-1])
            states.append(state_of(page))
            addresses.append(page.url)
            assert states[-1] != states[-2]

        page.click("#columns summary")
        page.uncheck("#columns input >> nth=6")
        changed()
        opened.filter("contact", "penalty")
        changed()
        page.locator("#table .tabulator-col-title", has_text="noise of the").click()
        changed()
        page.select_option("#measure", "impulse")
        changed()
        page.select_option("#statistic", "median")
        changed()
        page.click(".legend.methods button >> nth=1")
        changed()
        page.wait_for_timeout(1000)  # a click on a table that is still being drawn is lost
        opened.click_in_table(".tabulator-row >> nth=2")
        changed()
        page.click("nav a >> nth=1")
        assert "at=runs" in page.url
        assert state_of(page) == states[-1]
        with Opened(browser, page_of_rows) as other:
            other.page.goto(page.url)
            other.page.reload()
            other.page.wait_for_selector("html[data-ready]")
            other.paint_all()
            assert state_of(other.page) == states[-1]
            assert other.page.evaluate("scrollY") > 500
            assert other.complaints == []
        page.go_back()
        for state, address in zip(states[-2::-1], addresses[-2::-1], strict=True):
            page.go_back()
            page.wait_for_function("(address) => location.href === address", arg=address)
            assert state_of(page) == state
        for state in states[1:]:
            page.go_forward()
            page.wait_for_function("(rows) => document.readyState === 'complete'", arg=0)
            page.wait_for_timeout(100)
            assert state_of(page) == state
        assert opened.complaints == []


ADDRESSES = (
    "runs",
    "nothing-here",
    "at=nothing&work-x=nothing&log=work-logx+nothing&log=__proto__&without=nobody&only=nothing%3D1&only=&only=contact",
    "sort=up+contact&sort=asc+nothing&sort=&sort=asc+__proto__&fold=nothing&run=nobody&run=&row=nobody&__proto__=1",
    "only=command%3D1&sort=asc+command&run=%00&row=%E2%80%A8&at=%3Cimg+src%3Dx+onerror%3D%22window.hacked%3D1%22%3E",
)


@pytest.mark.parametrize(
    "address",
    [
        *(pytest.param(one, marks=pytest.mark.deep) for one in ADDRESSES),
        "%%%=&=&&=1&only=reason%3D%3Cimg+src%3Dx+onerror%3D%22window.hacked%3D1%22%3E",
    ],
)
def test_an_address_of_another_page_does_no_harm(browser, page_of_rows, address):
    with Opened(browser, page_of_rows) as opened:
        opened.page.goto(f"{page_of_rows.as_uri()}#{address}")
        opened.page.reload()
        opened.page.wait_for_selector("html[data-ready]")
        assert opened.page.evaluate("window.hacked") is None
        assert opened.page.locator("img").count() == 0
        assert "rows" in opened.page.inner_text("#count")
        assert opened.complaints == []


@pytest.mark.deep
def test_the_files_are_folded_into_the_page(browser, page_of_rows, whole):
    with Opened(browser, page_of_rows) as opened:
        files = opened.page.locator("#files details")
        assert files.count() == len(whole.study.files)
        for place, file in enumerate(whole.study.files):
            assert not files.nth(place).locator("pre").is_visible()
            files.nth(place).locator("summary").click()
            assert files.nth(place).locator("pre").text_content() == file.text
            assert file.sha256 in files.nth(place).inner_text()


def test_the_page_says_how_much_is_kept():
    words = pages.everything()
    assert f"above {study_files.LONGEST_TEXT // 1000} kB" in words
