"""A study as one page: it loads nothing, runs no text of the study, tells the same twice, and works in a browser."""

import base64
import copy
import hashlib
import itertools
import json
import re
from html.parser import HTMLParser
from importlib import resources
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from typer.testing import CliRunner

import percuss
from fake_studies import TWO_BARS, FakeStudy, drawn_study, run_study, several_cases
from opened_page import Opened
from percuss.cli.main import app
from percuss.reporting import page_rows, study_charts, study_data
from percuss.reporting.study_answer import answer
from percuss.reporting.study_figures import figures, study_figures
from percuss.reporting.study_page import report_html, study_report
from percuss.studies.columns import metric
from percuss.studies.study_files import StudyFile

pytestmark = pytest.mark.slow

EVIL = """</script><script>window.hacked = 1</script><img src=x onerror="window.hacked = 1">{{js}} 'it' & "that" """
CHARTS = ("work", "vary", "map", "force")


@pytest.fixture(scope="module")
def small():
    return run_study()


@pytest.fixture(scope="module")
def large():
    return drawn_study(20_000)


def hostile():
    """A study all of whose text tries to be markup."""
    study = copy.deepcopy(drawn_study(40))
    table = study.table.rename(columns={"time.courant": f"time.{EVIL}"})
    for name in ("case", "integrator", "contact", "said_by", "reason"):
        table[name] = [f"{value} {EVIL}" for value in table[name]]
    table.loc[:4, "status"] = EVIL
    table["key"] = [f"{key} {EVIL}" for key in table["key"]]
    table["odd " + EVIL] = np.arange(40.0)
    study.table, study.title = table, EVIL
    study.spec |= {
        "question": EVIL,
        "vary": {"method.contact.beta_s": [], f"time.{EVIL}": []},
        EVIL: [EVIL, {EVIL: EVIL}],
    }
    study.provenance |= {EVIL: {EVIL: [EVIL]}, "command": [EVIL]}
    line = {"time": np.linspace(0, 1, 9), "contact_force": np.arange(9.0), "contact_force_exact": np.arange(9.0)}
    study.kept = dict.fromkeys(table["key"], line)
    study.files = [StudyFile(EVIL, EVIL, EVIL, 1, EVIL)]
    study.path = Path(EVIL)
    return study


def data_of(html):
    return json.loads(re.search(r'<script id="data" type="application/json">(.*?)</script>', html, re.DOTALL)[1])


class Tags(HTMLParser):
    """What a page has of elements that run or load, and all its text."""

    def __init__(self, html):
        super().__init__()
        self.loads, self.tags, self.words, self.links = [], [], [], []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        given = dict(attrs)
        if tag == "a":
            self.links.append(given.get("href", ""))
        else:
            self.loads += [
                given[name] for name in ("src", "href", "data", "action", "poster", "srcset") if name in given
            ]
        assert not [name for name in given if name.startswith("on")]

    def handle_data(self, data):
        self.words.append(data)


# --------------------------------------------------------------------------------------------------- the file


def test_the_page_loads_nothing(small):
    html = report_html(small)
    tags = Tags(html)
    assert tags.loads == ["data:,"]
    assert all(link.startswith(("#", "https://doi.org/10.")) for link in tags.links)
    assert "default-src 'none'" in html
    assert "sourceMappingURL" not in html
    assert not re.search(r"@import|url\(\s*['\"]?(?!data:)[\w/]", html.split("<body>")[0])
    assert len(html) < 2_500_000


def test_the_vendored_files_are_those_that_are_named():
    folder = resources.files("percuss") / "web" / "vendor"
    named = re.findall(r"^\| `(\S+)` .*`([0-9a-f]{64})` \|$", (folder / "README.md").read_text(), re.MULTILINE)
    assert len(named) == 3
    for name, digest in named:
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
        assert (folder / name).parent.joinpath("LICENSE").is_file()


def test_the_page_says_what_was_asked_run_and_lost(small):
    words = " ".join(" ".join(Tags(report_html(small)).words).split())
    assert small.spec["question"] in words
    assert "percuss study 'two bars.yaml' -o two-bars.db" in words
    assert "0f" * 32 in words
    assert "lambda / eps_s = -g - (eps_m / eps_s) g''" in words
    assert "doi 10.1002/nme.5712" in words
    assert "5 values" not in words
    assert "0.05, 0.2, 0.5, 1, 3" in words
    assert f"{(small.table['status'] == 'unstable').sum()} unstable" in words
    assert "the certificate says unstable" in words
    assert "random sample" not in words


@pytest.mark.deep
def test_the_same_study_gives_the_same_page(small, large, tmp_path):
    assert report_html(small) == report_html(copy.deepcopy(small))
    assert report_html(large, "all.csv") == report_html(drawn_study(20_000), "all.csv")


def test_text_of_a_study_is_never_markup():
    plain, evil = Tags(report_html(drawn_study(40))), Tags(report_html(hostile()))
    assert evil.tags.count("script") == plain.tags.count("script")
    assert "img" not in evil.tags
    assert "window.hacked = 1" in "".join(evil.words)
    assert "{{js}}" in "".join(evil.words)


@pytest.mark.deep
def test_a_table_larger_than_a_page_is_sampled_and_says_so(large, tmp_path):
    paths = study_report(large, tmp_path / "large.html")
    assert [path.name for path in paths] == ["large.html", "large.csv"]
    assert len(pd.read_csv(paths[1])) == 20_000
    html = paths[0].read_text(encoding="utf-8")
    data = data_of(html)
    assert (data["total"], data["seed"]) == (20_000, 0)
    assert data["rows"] - len(data["added"]) == page_rows.MOST_ROWS
    assert f"{data['rows']:,} of the 20,000 rows: a random sample of 5,000 (seed 0), and all" in html
    assert "large.csv" in html
    assert len(html) < 3_500_000
    lost = sum(group["count"] for group in study_data.lost(large.table))
    assert lost == (large.table["status"] != "done").sum()


def test_a_method_that_nobody_knows_is_named_all_the_same(small):
    study = copy.deepcopy(small)
    study.table["contact"] = study.table["contact"].replace("penalty", "of-my-own")
    assert "Not registered where this page was made" in report_html(study)


def test_an_empty_or_bare_study_still_makes_a_page():
    about = {"case": ["a"], "integrator": ["i"], "contact": ["c"], "status": ["refused"], "reason": [""]}
    bare = pd.DataFrame({**about, "said_by": ["i"], "fragile": [None], "key": ["k"]})
    assert "no reason given" in report_html(FakeStudy(bare))
    assert "0 runs" in report_html(FakeStudy(bare.iloc[:0]))


# ------------------------------------------------------------------------------------------------------ data


def test_a_study_may_say_what_its_columns_are(small):
    study = copy.deepcopy(small)
    study.table["exact.contacts.*.noise"] = study.table["noise"]
    study.table["offset"] = 1.0
    study.table["contact"] = study.table["contact"].replace("penalty", "{name: penalty, beta_s: 2}")
    study.table.loc[:2, "status"] = "waiting"
    study.columns = {
        name: f"words of {name}" for name in ("force_error_l1", "noise", "exact.contacts.*.noise", "steps")
    }
    known = study_data.columns(study)
    assert "offset" in known.varied
    assert "exact.contacts.*.noise" in known.measures
    words = " ".join(Tags(report_html(study)).words)
    assert "words of noise" in words
    assert "3 still to be made" in words
    assert "{name: penalty, beta_s: 2}" in words
    assert "lambda = eps_s <-g>" in words
    assert sum(group["count"] for group in study_data.lost(study.table)) == study.table["reason"].ne("").sum()


def test_columns_are_told_apart(small):
    known = study_data.columns(small)
    assert known.varied == ("method.contact.beta_s", "time.courant", "refine")
    assert list(known.measures)[:3] == ["force_error_l1", "force_error_l2", "impulse_error"]
    assert known.measures["noise"] == "noise of the force (exact: 1)"
    assert known.measures["penetration"] == "largest penetration"
    named = copy.deepcopy(small)
    named.units = {"length": "mm"}
    assert study_data.columns(named).measures["penetration"] == "largest penetration [mm]"
    assert "fragile" not in known.measures


@pytest.mark.parametrize(
    ("values", "log"),
    [([1, 2, 4], True), ([0.3, 0.5, 0.9], False), ([0.01, 0.03, 0.1], True), ([-1, 100], False), ([0, 1, 2, 3], False)],
)
def test_a_logarithmic_axis_is_for_multiples_and_for_what_is_spread_far(values, log):
    assert study_data.is_log(np.array([*values, np.nan], dtype=float)) is log


def test_the_line_of_the_best_has_no_run_that_another_beats():
    rng = np.random.default_rng(3)
    cost, error = rng.random(200), rng.random(200)
    cost[:3], error[3:6] = np.nan, np.nan
    found = study_data.front(cost, error)
    assert np.all(np.diff(found[0]) > 0)
    assert np.all(np.diff(found[1]) < 0)
    good = np.isfinite(error) & np.isfinite(cost)
    for x, y in found.T:
        assert not ((cost[good] < x) & (error[good] <= y)).any()


def test_bands_are_quantiles_of_all_done_runs(large):
    table = large.table
    method = "central-difference + penalty"
    found = study_data.bands(table, "noise", "refine")[method]
    assert found[0].tolist() == [1, 2, 4, 8, 16, 32]
    own = table[(table["status"] == "done") & (np.array(study_data.methods(table)) == method) & (table["refine"] == 4)]
    assert found[2:5, 2] == pytest.approx(own["noise"].quantile([0.1, 0.5, 0.9]).to_numpy())
    made = table[(np.array(study_data.methods(table)) == method) & (table["refine"] == 4)]
    assert found[5:, 2].tolist() == [len(own), len(made)]
    assert found[1, 2] == own["noise"].min()
    assert len(own) < len(made)


@pytest.mark.deep
@pytest.mark.parametrize("most", [7, 8])
def test_bands_of_many_pairs_are_not_drawn(browser, several, tmp_path, monkeypatch, most):
    """Eight pairs, of which four have several runs: at most seven have bands, in the page and in the files alike."""
    monkeypatch.setattr(study_charts, "MOST_BANDS", most)
    drawn = dict(figures(several, "median"))["against-refine"]
    in_files = sum(
        type(one).__name__ in {"PolyCollection", "FillBetweenPolyCollection"} for one in drawn.axes[0].collections
    )
    study_report(several, tmp_path / "several.html")
    with Opened(browser, tmp_path / "several.html") as opened:
        opened.page.select_option("#vary-x", "refine")
        opened.page.select_option("#statistic", "median")
        series = opened.page.evaluate(
            """charts.vary.chart.getOption().series.filter((one) => one.xAxisIndex === 0)
                 .map((one) => [one.type, Boolean(one.areaStyle)])"""
        )
    assert in_files == sum(filled for _, filled in series) == (4 if most == 8 else 0)
    assert sum(kind == "line" and not filled for kind, filled in series) >= 8


def test_bins_hold_every_number_and_few_values_are_their_own():
    places, where = study_data.binned(np.array([3.0, 1.0, np.nan, 3.0]))
    assert (places.tolist(), where.tolist()) == ([1, 3], [1, 0, -1, 1])
    values = 10.0 ** np.random.default_rng(0).uniform(-3, 2, 1000)
    places, where = study_data.binned(values)
    assert where.min() == 0
    assert where.max() == study_data.BINS - 1
    assert np.abs(np.log10(values / places[where])).max() <= 0.5 * 5 / study_data.BINS + 1e-9


def test_reasons_that_differ_by_numbers_are_one():
    table = drawn_study(300).table
    groups = study_data.lost(table)
    assert 1 <= len(groups) <= 6
    assert [group["count"] for group in groups] == sorted((group["count"] for group in groups), reverse=True)


def test_values_that_are_words_keep_their_order():
    column = pd.Series([1, "matched", None, 0.25, True], dtype=object)
    assert study_data.numbers(column) is None
    assert study_data.texts(column) == ["1", "matched", "", "0.25", "yes"]
    assert study_data.in_order(study_data.texts(column)) == ["0.25", "1", "matched", "yes", ""]


def test_histories_are_few_and_thin_and_the_best_of_each_pair_and_case(small):
    study = copy.deepcopy(small)
    long = {"time": np.linspace(0, 1, 50_000), "contact_force": np.zeros((50_000, 6)), "contact_force_exact": None}
    study.kept = dict.fromkeys(study.table["key"], long)
    kept = page_rows.kept_histories(study, study.table, ["force_error_l1"])
    assert 60 < len(kept) <= page_rows.MOST_HISTORIES < len(study.table)
    assert len(json.dumps(kept)) < 1.05 * page_rows.MOST_LETTERS
    for _, own in study.table.groupby(np.array(study_data.methods(study.table))):
        errors = own["force_error_l1"].where(own["status"] == "done").fillna(np.inf)
        here = [row in kept for row in own.index]
        assert any(here)
        assert max(errors[here]) <= min(errors[~np.array(here)], default=np.inf)
    one = next(iter(kept.values()))
    assert len(one["force"]) == page_rows.MOST_CONTACTS
    assert one["exact"] == []
    assert len(one["force"][0][0]) < 4 * page_rows.POINTS * 2
    data = data_of(report_html(study))
    assert sorted([*data["not_in_page"], *map(int, data["histories"])]) == list(range(len(study.table)))


def test_a_page_ends_in_html(tmp_path):
    told = CliRunner().invoke(app, ["report", str(tmp_path / "s.db"), "-o", str(tmp_path / "s.pdf")])
    assert told.exit_code == 2


@pytest.mark.deep
def test_pictures_for_print(small, tmp_path):
    pytest.importorskip("matplotlib", reason="pictures need the extra percuss[plot]")
    paths = study_figures(small, tmp_path / "figures")
    names = {path.name for path in paths}
    assert names >= {
        "work-precision.svg",
        "work-precision.pdf",
        "against-method-contact-beta_s.svg",
        "against-refine.pdf",
    }
    assert all(path.stat().st_size > 10_000 for path in paths)


# ------------------------------------------------------------------------------------------- what is ranked, and how


@pytest.fixture(scope="module")
def several():
    return several_cases()


def beaten(cost, error):
    """Return which runs another one beats: cheaper or as cheap, better or as good, and not equal in both."""
    cheaper, better = cost[:, None] >= cost[None, :], error[:, None] >= error[None, :]
    equal = (cost[:, None] == cost[None, :]) & (error[:, None] == error[None, :])
    return (cheaper & better & ~equal).any(axis=1)


@pytest.mark.deep
def test_the_best_runs_are_always_in_the_page(large):
    data = data_of(report_html(large))
    keys = next(one for one in data["columns"] if one["name"] == "key")
    kept = {keys["levels"][code] for code in np.frombuffer(base64.b64decode(keys["data"]), "<u2")}
    done = large.table[large.table["status"] == "done"]
    for _, own in done.groupby(["case", "integrator", "contact"]):
        for error in ("force_error_l1", "impulse_error", "penetration"):
            assert own["key"][own[error].idxmin()] in kept
            for cost in ("node_steps", "seconds.march"):
                front = own["key"][~beaten(own[cost].to_numpy(), own[error].to_numpy())]
                assert set(front) <= kept


def test_the_sample_of_a_page_stays_random(large):
    known = study_data.columns(large)
    carried = page_rows.carried(large.table, known)
    drawn = np.random.default_rng(page_rows.SEED).choice(20_000, page_rows.MOST_ROWS, replace=False)
    assert carried.table["key"][carried.drawn].tolist() == large.table["key"].iloc[np.sort(drawn)].tolist()


COSTS_AND_ERRORS = st.lists(
    st.tuples(
        st.sampled_from(["a", "b"]),
        st.sampled_from(["i", "j"]),
        st.sampled_from(["done", "done", "done", "unstable", "failed"]),
        st.none() | st.sampled_from([0.0, 0.5, 1.0, 2.0]),
        st.sampled_from([1.0, 2.0, 3.0]),
    ),
    min_size=1,
    max_size=30,
)


def drawn_table(lines):
    names = ("case", "integrator", "status", "force_error_l1", "node_steps")
    table = pd.DataFrame([dict(zip(names, line, strict=True)) for line in lines])
    table["force_error_l1"] = table["force_error_l1"].astype(float)
    lost = table["status"] != "done"
    table.loc[lost, ["force_error_l1", "node_steps"]] = np.nan
    return table.assign(contact="c", reason="", said_by="", fragile=None, key=[str(n) for n in range(len(table))])


@given(COSTS_AND_ERRORS)
def test_a_run_without_a_true_error_is_never_ranked(lines):
    table = drawn_table(lines)
    study = FakeStudy(table)
    known = study_data.columns(study)
    best = page_rows.best_runs(table, known)
    assert table.loc[best, "status"].eq("done").all()
    assert table.loc[best, "force_error_l1"].notna().all()
    for _, own in table[table["force_error_l1"].notna()].groupby(["case", "integrator"]):
        front = ~beaten(own["node_steps"].to_numpy(), own["force_error_l1"].to_numpy())
        wanted = set(zip(own["node_steps"][front], own["force_error_l1"][front], strict=True))
        found = own.loc[best[own.index]]
        # of runs that are equal in both one is enough
        assert wanted <= set(zip(found["node_steps"], found["force_error_l1"], strict=True))
    if "force_error_l1" in known.measures:
        for row in study_data.cells(table, "force_error_l1").values():
            for cell in row.values():
                assert cell.made == cell.measured + sum(cell.lost.values())


@given(
    st.lists(
        st.lists(st.sampled_from([0.5, 1.0, 1.5, 4.0, None, "unstable", "refused"]), min_size=3, max_size=3), min_size=1
    )
)
def test_a_performance_profile_is_that_of_its_definition(problems):
    """Fraction of problems on which the ratio of a solver to the best one is at most tau; infinite where it failed."""
    lines = []
    for case, values in enumerate(problems):
        for solver, value in enumerate(values):
            status = value if isinstance(value, str) else "done"
            error = value if isinstance(value, float) else np.nan
            lines.append(
                {"case": f"case {case}", "integrator": "i", "contact": f"c{solver}", "status": status, "e": error}
            )
    # the references are no solvers, however small their errors are
    lines += [{**line, "contact": "tied", "status": "done", "e": 1e-9} for line in lines if line["contact"] == "c0"]
    table = pd.DataFrame(lines)
    found = study_data.profile(table, "e", study_data.problems(table, ()))
    judged = [values for values in problems if None not in values and any(isinstance(v, float) for v in values)]
    assert found.counted == len(judged)
    assert found.unknown == len(problems) - len(judged)
    assert set(found.ratios) == {"i + c0", "i + c1", "i + c2"}
    for solver in range(3):
        for tau in (1.0, 1.5, 2.0, 3.0, 8.0, 100.0):
            within = 0
            for values in judged:
                best = min(value for value in values if isinstance(value, float))
                own = values[solver]
                within += isinstance(own, float) and own / best <= tau
            assert np.count_nonzero(found.ratios[f"i + c{solver}"] <= tau) == within


def test_options_of_a_method_are_no_problems(several):
    """A law without stiffness and one with four values of it are set the same problems: a case with one mesh."""
    asked = study_data.problems(several.table, ("method.contact.beta_s", "refine"))
    assert (len(asked.rows), len(asked.solvers), asked.left_out) == (4 * 3, 6, 0)
    table = several.table
    for of_problem in asked.rows:
        assert [len(rows) for rows in of_problem] == [1 if "lagrange" in pair else 4 for pair in asked.solvers]
        own = table.iloc[list(itertools.chain(*of_problem))]
        assert own["case"].nunique() == own["refine"].nunique() == 1
    lone = table.index[(table["contact"] == "lagrange") & (table["case"] == "hunek") & (table["refine"] == 1)][0]
    less = table.drop(index=lone).reset_index(drop=True)
    assert study_data.problems(less, ("method.contact.beta_s", "refine")).left_out == 1


def test_of_several_runs_of_a_problem_the_best_or_the_median_counts():
    lines = [("a", "p", 1.0), ("a", "p", 4.0), ("a", "p", np.nan), ("a", "q", 2.0), ("a", "q", 3.0), ("a", "q", 3.0)]
    table = pd.DataFrame(lines, columns=["case", "contact", "e"]).assign(integrator="i")
    table["status"] = np.where(table["e"].isna(), "unstable", "done")
    asked = study_data.problems(table, ())
    assert study_data.profile(table, "e", asked).ratios == {"i + p": [1.0], "i + q": [2.0]}
    median = study_data.profile(table, "e", asked, "median")
    assert median.ratios == {"i + p": [4 / 3], "i + q": [1.0]}


def test_the_best_and_the_median_of_a_pair_in_a_case(several):
    cell = study_data.cells(several.table, "force_error_l1")["hunek"]["central-difference + penalty"]
    own = several.table.query("case == 'hunek' and integrator == 'central-difference' and contact == 'penalty'")
    assert (cell.best, cell.median) == (own["force_error_l1"].min(), own["force_error_l1"].median())
    assert (cell.measured, cell.made, cell.lost_words) == (8, 12, "4 of 12 runs unstable")
    refused = study_data.cells(several.table, "force_error_l1")["cradle"]["wu-predictor-corrector + bipenalty"]
    assert (refused.measured, refused.lost_words) == (0, "12 of 12 runs refused")


def answer_of(study):
    known = study_data.columns(study)
    return answer(study.table, known)


def test_the_answer_is_that_of_the_rows(several, small):
    """The tied twins have the least errors by far, and are no answer."""
    table = several.table[several.table["case"].isin(["hunek", "doyen-impact"])].reset_index(drop=True)
    table.loc[table["status"] == "done", "fragile"] = False
    table.loc[table.index[table["status"] == "done"][3], "fragile"] = True
    equal, *told = answer_of(FakeStudy(table))
    assert equal.startswith("At equal mesh ")
    assert len(told) == 4
    for case, sentence in zip(("hunek", "doyen-impact"), told, strict=False):
        own = table[(table["case"] == case) & (table["status"] == "done") & (table["contact"] != "tied")]
        best = own.loc[own["force_error_l1"].astype(float).idxmin()]
        value = f"{100 * best['force_error_l1']:.3g} %"
        pair = f"{best['integrator']} + {best['contact']}"
        assert sentence.startswith(f"{case}: {pair} ")
        assert f"has the smallest force error, L1 ({value}); " in sentence
        assert f"refine={best['refine']}" in sentence
        assert f"the median of {len(own)} runs is {100 * own['force_error_l1'].median():.3g} %." in sentence
    failed = table[table["status"] != "done"]
    assert told[2].startswith(f"{len(failed)} of {len(table)} runs failed ({len(failed)} unstable); {len(failed)} of")
    assert "The result of 1 of" in told[3]
    page = "".join(Tags(report_html(FakeStudy(table))).words).replace("\u00a0", " ")
    assert all(page.count(sentence) == 1 for sentence in told)
    _, *many = answer_of(several)
    best = several.table[several.table["contact"] != "tied"].dropna(subset="force_error_l1")
    best = best.loc[best.groupby("case")["force_error_l1"].idxmin()]
    wins = (best["integrator"] + " + " + best["contact"]).value_counts()
    assert f"in {wins.max()} of 4 cases" in many[0]
    assert len(many) == 4
    assert 2 <= len(answer_of(small)) <= 5


def test_the_answer_names_all_that_share_the_best_and_what_the_error_depends_on():
    lines = [("p", 1, 0.02), ("p", 2, 0.01), ("q", 1, 0.01), ("q", 2, 0.08), ("r", 1, np.nan), ("r", 2, 0.5)]
    table = pd.DataFrame(lines, columns=["contact", "refine", "force_error_l1"]).assign(
        case="c", integrator="i", reason="", said_by="", fragile=None, key=[str(k) for k in range(6)]
    )
    table["status"] = np.where(table["force_error_l1"].isna(), "failed", "done")
    equal, *told = answer_of(FakeStudy(table))
    assert equal == "At equal mesh i + q has the smallest force error, L1 on 1 of 2 meshes, i + p on 1."
    assert (
        told[0]
        == "c: i + p refine=2 and i + q refine=1 have the smallest force error, L1 (1 %); the median of 5 runs is 2 %."
    )
    assert told[1] == "1 of 6 runs failed (1 failed); 1 of them used i + r."
    assert told[2] == "The error of a pair in a case changes by a factor of 5 with refine (medians)."


def test_cost_is_that_of_the_method_alone(small):
    data = data_of(report_html(small))
    assert data["charts"]["costs"] == ["node_steps", "seconds.march", "steps"]
    study = copy.deepcopy(small)
    study.table["seconds"] = 1.0
    study.columns = dict.fromkeys(("node_steps", "seconds", "force_error_l1"), "what it is")
    known = study_data.columns(study)
    assert known.costs == ("node_steps", "seconds")
    assert known.measures["seconds"] == "seconds of the time steps"
    result = percuss.run(percuss.load(TWO_BARS))
    assert metric(result, "node_steps") == result.summary["steps"] * (20 + 1 + 40 + 1)
    staged = percuss.run(percuss.load(TWO_BARS, {"method": {"integrator": "noh-bathe", "contact": "penalty"}}))
    assert metric(staged, "node_steps") == 2 * staged.summary["steps"] * (20 + 1 + 40 + 1)


def test_a_method_without_the_varied_value_has_its_median_beside_the_axis(several):
    found = study_data.bands(several.table, "noise", "method.contact.beta_s")
    band = found["central-difference + lagrange"]
    assert band.shape == (7, 1)
    assert np.isnan(band[0, 0])
    assert band[5:, 0].tolist() == [12, 12]
    lost = found["central-difference + penalty"]
    assert lost[5:].tolist() == [[12, 12, 8, 0], [12, 12, 12, 12]]
    assert np.isnan(lost[1:5, 3]).all()


def test_numbers_among_words_keep_all_their_digits():
    value = 0.1 + 0.2
    column = pd.Series([value, "matched", 2.0], dtype=object)
    assert [text for text in study_data.texts(column) if text != "matched"] == [repr(value), "2"]
    assert study_data.as_label(repr(value)) == "0.3"
    assert study_data.as_label("matched") == "matched"


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False) | st.sampled_from([0.0, 1.0, 9.0, 1e4]), min_size=1))
@example([0.0, 1.0, 9.0])
def test_an_axis_is_logarithmic_only_where_every_number_is_above_zero(values):
    assert not study_data.is_log(np.array(values)) or min(values) > 0


@pytest.mark.deep
def test_pictures_of_several_cases_join_no_runs_of_different_cases(several):
    pytest.importorskip("matplotlib", reason="pictures need the extra percuss[plot]")
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    made = dict(figures(several))
    assert {"best-and-median", "work-precision", "work-precision-seconds-march", "performance-profile"} <= set(made)
    done = several.table[several.table["status"] == "done"]
    cases = ["hunek", "carpenter", "doyen-impact", "cradle"]
    for name in ("best-and-median", "work-precision", "against-refine"):
        assert [axes.get_title(loc="left") for axes in made[name].axes] == cases, name
    for axes in made["work-precision"].axes:
        own = done[done["case"] == axes.get_title(loc="left")]
        errors = 100.0 * own["force_error_l1"].astype(float)
        there = set(zip(own["node_steps"].astype(float), errors, strict=True))
        for line in axes.get_lines():
            assert set(zip(*map(np.asarray, line.get_data()), strict=True)) <= there
        assert len(axes.get_lines()) >= 8
        lines = study_charts.work_lines(own.assign(e=errors), "node_steps", "e")[1]
        names = {text.get_text() for text in axes.texts}
        assert names == {pair for pair, line in lines.items() if line.shape[1] == 1}
    best = made["best-and-median"]
    texts = [text.get_text() for axes in best.axes for text in axes.texts]
    best.set_dpi(180)  # as it is saved
    renderer = FigureCanvasAgg(best).get_renderer()
    ends = [text.get_window_extent(renderer).x1 / 180 for axes in best.axes for text in axes.texts]
    assert max(ends) <= 12.7, max(ends)  # of 12.8 inches
    assert any("4 of 12 runs unstable" in text for text in texts)
    labels = [label.get_text() for label in best.axes[0].get_yticklabels()]
    cells = study_data.cells(several.table, "force_error_l1")["hunek"]
    assert labels == sorted(cells, key=lambda pair: cells[pair].best)
    words = " ".join(text.get_text() for text in made["against-method-contact-beta_s"].texts)
    assert "28 of 240 runs failed" in words


@pytest.mark.deep
def test_no_axis_of_a_picture_has_two_equal_labels(several, small):
    pytest.importorskip("matplotlib", reason="pictures need the extra percuss[plot]")
    for study in (several, small):
        for name, figure in figures(study):
            for axes in figure.axes:
                for side in (axes.xaxis, axes.yaxis):
                    labels = [text for label in side.get_ticklabels() if (text := label.get_text())]
                    assert len(set(labels)) == len(labels), (name, labels)


# ------------------------------------------------------------------------------------------ the charts as data


def axis_of(values, name="x", *, is_measure=False):
    return study_charts.axis(pd.DataFrame({name: values}), name, "label", is_measure=is_measure)


def test_an_axis_says_whether_it_is_logarithmic_and_where_it_ends():
    far = axis_of([1e-3, 1e-14, 0.2, 5.0, np.nan])
    assert far.log
    assert far.edge == pytest.approx(5e-10)  # what is lower is round-off
    assert axis_of([0.5, 0.25, 0.125]).edge == 0.125
    assert not axis_of([0.3, 0.5, 0.9]).log
    assert axis_of([0.3, 0.5, 0.9], is_measure=True).log  # a measure wherever it can be
    assert axis_of([3.0, 4.0, 6.0], "refine").log  # the mesh always
    for values in ([0.0, 1.0, 100.0, -1.0, np.nan], [0.0, 1.0], [np.nan, np.nan]):
        assert not axis_of(values, is_measure=True).log
    words = axis_of(["matched", 0.5, None])
    assert (words.words, words.log) == (("0.5", "matched", ""), False)


def test_an_axis_has_ticks_at_its_values_where_they_are_few():
    assert axis_of([4.0, 1.0, 4.0, np.nan]).ticks == (1.0, 4.0)
    assert len(axis_of(np.arange(8.0)).ticks) == 8
    assert axis_of(np.arange(9.0)).ticks == ()


def test_the_charts_offer_each_column_in_its_place(several):
    charts = study_charts.study_charts(several.table, study_data.columns(several))
    assert charts.costs == ["node_steps", "seconds.march"]
    assert charts.results == ["force_error_l1", "noise", "penetration"]
    assert charts.varied == ["method.contact.beta_s", "refine", "case", "integrator", "contact"]
    assert charts.mapped == ["method.contact.beta_s", "refine", "case"]
    assert charts.ranked == ["force_error_l1", "penetration"]
    logs = [name for name, axis in charts.axes.items() if axis.log]
    assert logs == ["force_error_l1", "noise", "node_steps", "seconds.march", "method.contact.beta_s", "refine"]
    assert charts.axes["force_error_l1"].label == "force error, L1 [%]"
    mixed = odd(several)
    charts = study_charts.study_charts(mixed.table, study_data.columns(mixed))
    assert charts.varied[:3] == ["method.contact.beta_s", "refine", "method.contact.ratio"]


def test_lines_that_share_a_colour_differ_in_mark_and_dashes():
    styles = [study_charts.line_style(k) for k in range(64)]
    for look in ("mark", "dash"):
        assert len({(style.colour, getattr(style, look)) for style in styles}) == 64
        assert len({getattr(style, look) for style in styles[:8]}) == 8


def test_every_status_has_one_outcome():
    statuses = ("done", "unstable", "waiting", "refused", "failed", "interrupted", "lost", "of a later version")
    lost = "refused, failed or lost"
    assert [study_charts.outcome(status) for status in statuses] == ["done", "unstable", "", *[lost] * 5]


def test_the_line_of_all_runs_leaves_the_references_out(several):
    rows = several.table.query("case == 'hunek' and status == 'done'")
    best, lines = study_charts.work_lines(rows, "node_steps", "force_error_l1")
    for pair, own in rows.groupby(rows["integrator"] + " + " + rows["contact"]):
        cost, error = zip_sorted(own["node_steps"].to_numpy(float), own["force_error_l1"].to_numpy(float))
        assert lines[pair].tolist() == np.array([cost, error])[:, ~beaten(cost, error)].tolist()
    compete = rows[rows["contact"] != "tied"]
    assert best[1].min() == compete["force_error_l1"].min() > rows["force_error_l1"].min()


RATIOS = st.lists(st.sampled_from([1.0, 1.0, 1.5, 2.0, 7.0, np.inf]), min_size=1, max_size=12)


@given(RATIOS)
def test_the_steps_of_a_profile_are_the_shares_of_its_definition(ratios):
    ratios = np.sort(ratios)
    factors, shares = study_charts.profile_steps(ratios, 10.0)
    assert (factors[0], factors[-1]) == (1.0, 10.0)
    assert np.all(np.diff(factors) > 0)
    assert shares.tolist() == [np.count_nonzero(ratios <= factor) / ratios.size for factor in factors]


def test_a_ring_marks_a_value_at_which_all_runs_failed(several):
    """It stands on the lower edge, as there is no number to draw it at."""
    figure = dict(figures(several))["against-method-contact-beta_s"]
    found = {}
    for axes in figure.axes:
        lines = [line for line in axes.lines if line.get_fillstyle() == "none" and line.get_markersize() == 10]
        on_edge = [line.get_xdata().tolist() for line in lines if line.get_transform() == axes.get_xaxis_transform()]
        found[axes.get_title(loc="left")] = sorted(filter(None, on_edge))
    refused = [[0.1, 0.3, 1.0, 3.0]]  # of one pair in one case at each value
    assert found == {"hunek": [[3.0]], "carpenter": [[3.0]], "doyen-impact": [[3.0]], "cradle": [*refused, [3.0]]}


def test_words_have_bands_too(several):
    mixed = odd(several)
    bare = "central-difference + tied"
    mixed.table.loc[np.array(study_data.methods(mixed.table)) == bare, "method.contact.ratio"] = None
    path, pair = "method.contact.ratio", "central-difference + lagrange"
    bands = study_data.bands(mixed.table, "noise", path)
    words = study_data.in_order(study_data.texts(mixed.table[path]))
    own = mixed.table[np.array(study_data.methods(mixed.table)) == pair]
    medians = own.groupby(study_data.texts(own[path]))["noise"].median()
    assert words[-2:] == ["matched", ""]
    assert bands[pair][0].tolist() == [0, 1, 2]
    assert bands[pair][3] == pytest.approx([medians[word] for word in words[:3]])
    assert bands[bare][0].tolist() == [3]  # a pair without a word has the place of none


def test_a_report_reads_the_table_of_a_study_once(several, tmp_path, monkeypatch):
    reads = []

    class Counted(FakeStudy):
        table = property(lambda self: reads.append(1) or self.rows, lambda self, rows: setattr(self, "rows", rows))

    study = Counted(several.table)
    monkeypatch.setattr(page_rows, "MOST_ROWS", 100)
    assert len(study_report(study, tmp_path / "page.html")) == 2
    assert len(reads) == 1


# --------------------------------------------------------------------------------------------------- a browser


@pytest.fixture(scope="module")
def pages(small, large, several, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    for name, study in {
        "small": small,
        "large": large,
        "hostile": hostile(),
        "several": several,
        "odd": odd(several),
    }.items():
        study_report(study, folder / f"{name}.html")
    return folder


def odd(several):
    """Return a study of several cases with words among its varied numbers, digits to the last, and errors unknown."""
    study = copy.deepcopy(several)
    table = study.table
    table["method.contact.ratio"] = [("matched", 0.1 + 0.2, 1 / 3)[k % 3] for k in range(len(table))]
    table["note, with \r a return"] = 1.0 / np.arange(1, len(table) + 1)
    study.columns["note, with \r a return"] = "a note"
    table.loc[table["case"] == "cradle", "force_error_l1"] = None  # its exact solution ends early
    first = table.index[(table["case"] == "hunek") & (table["status"] == "done")][0]
    table.loc[first, ["force_error_l1", "node_steps"]] = [None, 1.0]
    line = {"time": np.linspace(0, 1, 9), "contact_force": np.arange(9.0), "contact_force_exact": np.arange(9.0)}
    study.kept = dict.fromkeys(table["key"][::2], line)
    study.table = table
    return study


@pytest.mark.parametrize(
    ("name", "scheme", "width"),
    [
        pytest.param(name, scheme, width, marks=() if pick == 2 else pytest.mark.deep)
        for pick, (name, scheme, width) in enumerate(
            itertools.product(["small", "large"], ["light", "dark"], [390, 1280])
        )
    ],
)
def test_the_page_is_drawn_and_asks_for_nothing(browser, pages, name, width, scheme):
    with Opened(browser, pages / f"{name}.html", width, scheme) as opened:
        assert len(opened.requests) == 1
        assert opened.complaints == []
        assert opened.page.evaluate("document.documentElement.scrollWidth") <= width
        for chart in CHARTS[: 4 if name == "small" else 3]:
            drawn, colours = opened.colours(chart)
            assert drawn > 5000, chart
            assert colours > 20, chart
        paper = opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (paper == "rgb(255, 255, 255)") == (scheme == "light")
        row = opened.page.evaluate('getComputedStyle(document.querySelector(".tabulator-row")).backgroundColor')
        assert row == paper


def test_sorting_and_filtering(browser, pages, small):
    with Opened(browser, pages / "small.html") as opened:
        page = opened.page
        error = page.evaluate('columns.findIndex((one) => one.name === "force_error_l1")')
        heading = page.locator(f'#table .tabulator-col[tabulator-field="c{error}"] .tabulator-col-title')
        heading.click()
        shown = [float(text) for text in opened.cells("force_error_l1")]
        assert shown == sorted(shown)
        errors = 100.0 * small.table["force_error_l1"]  # the page shows per cent
        assert shown[0] == pytest.approx(errors.min(), rel=1e-3)
        heading.click()
        assert float(opened.cells("force_error_l1")[0]) == pytest.approx(errors.max(), rel=1e-3)
        before = opened.colours("work")
        opened.filter("contact", "lagrange")
        assert set(opened.cells("contact")) == {"lagrange"}
        assert page.inner_text("#count") == "12 of 132 rows"
        assert opened.colours("work") != before
        opened.filter("time.courant", "0.4..0.6")
        assert page.inner_text("#count") == "4 of 132 rows"
        opened.filter("time.courant", ">=0.5")
        assert set(opened.cells("time.courant")) == {"0.5", "0.9"}
        page.click("#clear")
        page.wait_for_function('() => document.getElementById("count").textContent === "132 rows"')
        page.select_option("#filters select >> nth=2", "2")
        page.wait_for_function('() => document.getElementById("count").textContent === "66 of 132 rows"')
        assert opened.complaints == []


@pytest.mark.deep
def test_every_choice_is_drawn(browser, pages):
    charts = {"measure": ("work", "vary"), "statistic": ("vary",), "work-x": ("work",), "vary-x": ("vary",)}
    with Opened(browser, pages / "small.html") as opened:
        page = opened.page
        for choice, drawn in {**charts, "map-v": ("map",)}.items():
            for value in page.evaluate(f'[...document.querySelectorAll("#{choice} option")].map((one) => one.value)'):
                page.select_option(f"#{choice}", value)
                for chart in drawn:
                    assert opened.colours(chart)[0] > 2000, (choice, value)
        page.click(".legend.methods button >> nth=0")
        assert page.get_attribute(".legend.methods button >> nth=0", "aria-pressed") == "false"
        assert opened.complaints == []


def test_a_click_on_a_row_or_a_point_shows_its_force(browser, pages):
    with Opened(browser, pages / "small.html") as opened:
        page = opened.page
        page.click("#unpick")
        assert page.locator("#force-legend .entry").count() == 0
        page.wait_for_timeout(500)  # the table is drawn anew, and a click on a row that goes is lost
        page.locator("#table .tabulator-row").nth(0).click()
        page.wait_for_timeout(500)
        if page.locator("#force-legend .entry").count() == 0:
            page.locator("#table .tabulator-row").nth(0).click()
        page.wait_for_function("() => document.querySelectorAll('#force-legend .entry').length === 2")
        assert "exact" in page.inner_text("#force-legend .entry >> nth=0")
        assert page.locator("#table .tabulator-row.picked").count() == 1
        place = page.evaluate(
            """() => {
              const { chart } = charts.work;
              const series = chart.getOption().series.find((one) => one.type === "scatter" && one.data.length);
              const [x, y] = chart.convertToPixel("grid", series.data[0]);
              return [x, y];
            }"""
        )
        page.locator("#work").scroll_into_view_if_needed()
        page.locator("#work").click(position={"x": place[0], "y": place[1]})
        page.wait_for_function('() => picked.length === 2 || document.querySelectorAll(".picked").length === 1')
        assert opened.complaints == []


def test_no_text_of_a_study_runs_in_the_browser(browser, pages):
    with Opened(browser, pages / "hostile.html") as opened:
        page = opened.page
        page.locator("#table .tabulator-row").nth(0).click()
        page.evaluate(
            """() => {
              for (const id of ["work", "vary", "map", "force"]) {
                charts[id].chart.dispatchAction({ type: "showTip", seriesIndex: 0, dataIndex: 0 });
              }
              dispatchEvent(new Event("beforeprint"));
            }"""
        )
        page.wait_for_timeout(300)
        assert page.evaluate("window.hacked") is None
        assert page.locator("img").count() == 0
        assert len(opened.requests) == 1
        assert opened.complaints == []


@pytest.mark.deep
def test_observed_orders_are_told_over_the_mesh(browser, pages, small):
    with Opened(browser, pages / "small.html") as opened:
        opened.filter("method.contact.beta_s", "0.2")
        opened.page.select_option("#vary-x", "refine")
        opened.page.select_option("#statistic", "median")
        done = small.table[(small.table["status"] == "done") & (small.table["method.contact.beta_s"] == 0.2)]
        rows = done[np.array(study_data.methods(done)) == "wu-predictor-corrector + penalty"]
        medians = rows.groupby("refine")["force_error_l1"].median()
        order = f"{np.log2(medians[1] / medians[2]):.2g}"
        assert f"wu-predictor-corrector + penalty {order}" in opened.page.inner_text("#vary-note")


@pytest.mark.parametrize(
    "path",
    [
        "method.contact.beta_s",
        *(pytest.param(path, marks=pytest.mark.deep) for path in ("refine", "method.contact.ratio")),
    ],
)
def test_the_page_and_the_files_draw_the_same_medians(browser, pages, several, path):
    with Opened(browser, pages / "odd.html") as opened:
        drawn = opened.page.evaluate(
            """(path) => page.methods.map((_, k) => {
              const [x, y] = [column[path], column.noise];
              const rows = active.filter((row) => isMade(row) && methodOf[row] === k);
              return bandOf(x, y, rows, 0, x.kind !== "text" && lacks(k, x));
            })""",
            path,
        )
        bands = list(study_data.bands(odd(several).table, "noise", path).values())
        assert len(drawn) == len(bands) == 8
        for of_page, band in zip(drawn, bands, strict=True):
            # A number that is none is null, or what JavaScript makes of a quantile of nothing.
            got = np.array([[np.nan if value is None else value for value in place] for place in of_page], dtype=float)
            assert got == pytest.approx(band.T, nan_ok=True)


@pytest.mark.deep
def test_a_sampled_page_says_of_what_its_lines_are(browser, pages, large):
    """The best runs that were added to the sample are in the lines of the best, and in no median and no count."""
    with Opened(browser, pages / "large.html") as opened:
        assert opened.page.inner_text("#count").endswith("rows of the 20,000 of the study: a sample and the best")
        words = opened.page.inner_text(".notice")
        assert "their medians, bands and counts leave out the best runs that were added" in words
        made, best = opened.page.evaluate(
            """() => {
              const cells = casesOf(active).map((code) => cellsOfCase(code, column.force_error_l1));
              const best = cells.flat().map((cell) => cell.best);
              return [cells.flat().reduce((sum, cell) => sum + cell.made, 0), Math.min(...best)];
            }"""
        )
        assert made == page_rows.MOST_ROWS
        assert best == 100.0 * large.table["force_error_l1"].min()


@pytest.mark.deep
def test_the_page_prints_with_its_charts(browser, pages, tmp_path):
    with Opened(browser, pages / "small.html", scheme="dark") as opened:
        page = opened.page
        page.pdf(path=str(tmp_path / "page.pdf"), prefer_css_page_size=True)
        assert (tmp_path / "page.pdf").stat().st_size > 50_000
        page.evaluate('dispatchEvent(new Event("beforeprint"))')
        for chart in CHARTS:
            assert page.locator(f"#{chart} svg path").count() > 20, chart
        assert page.locator("#printed tr").count() == 41
        assert page.locator("details:not([open])").count() == 0
        page.evaluate('dispatchEvent(new Event("afterprint"))')
        assert page.locator("#work canvas").count() == 1
        assert page.locator("details[open]").count() == 0
        assert opened.complaints == []


@pytest.mark.deep
def test_a_chart_is_painted_when_it_comes_into_sight(browser, pages):
    """Painting takes half of the time in which a large page opens."""
    painted = "Object.keys(charts)"
    with Opened(browser, pages / "several.html", all_charts=False) as opened:
        page = opened.page
        page.locator("#work").scroll_into_view_if_needed()
        page.wait_for_function("() => charts.work")
        assert "map" not in page.evaluate(painted)
        assert page.inner_text("#map-note")  # what is said of it, and its height, are there at once
        opened.filter("contact", "lagrange")
        page.locator("#map").scroll_into_view_if_needed()
        page.wait_for_function("() => charts.map && !unpainted.has('map')")
        titles = page.evaluate("charts.map.chart.getOption().title.map((one) => one.text)")
        assert titles
        assert all("lagrange" in title for title in titles)
        assert page.evaluate("unpainted.has('work')")
        page.locator("#work").scroll_into_view_if_needed()
        page.wait_for_function("() => !unpainted.has('work')")
        assert opened.complaints == []


@pytest.mark.deep
def test_no_line_joins_runs_of_different_cases(browser, pages, several):
    done = several.table[several.table["status"] == "done"]
    with Opened(browser, pages / "several.html") as opened:
        assert opened.page.input_value("#work-x") == "node_steps"
        option = opened.page.evaluate(
            """() => {
              const { title, series } = charts.work.chart.getOption();
              const lines = series.filter((one) => one.type === "line").map((one) => [one.xAxisIndex, one.data]);
              const dots = series.filter((one) => one.type === "scatter" && one.name !== "named");
              const points = dots.flatMap((one) => one.data.map((at) => [one.xAxisIndex, at[2]]));
              return { titles: title.map((one) => one.text), lines, points };
            }"""
        )
        assert sorted(option["titles"]) == sorted(set(several.table["case"]))
        assert len(option["points"]) == len(done)
        for panel, row in option["points"]:
            assert several.table["case"].iloc[row] == option["titles"][panel]
        drawn = {case: [] for case in option["titles"]}
        for panel, data in option["lines"]:
            drawn[option["titles"][panel]].append(np.array(data))
        for case, lines in drawn.items():
            of_case = done[done["case"] == case]
            fronts = [own for _, own in of_case.groupby(["integrator", "contact"], sort=False)]
            fronts.append(of_case[of_case["contact"] != "tied"])  # the broad line: all that compete
            wanted = []
            for own in fronts:
                cost, error = own["node_steps"].to_numpy(dtype=float), own["force_error_l1"].to_numpy(dtype=float)
                wanted.append(
                    np.log10(np.array(sorted(zip(cost, 100 * error, strict=True)))[~beaten(*zip_sorted(cost, error))])
                )
            found = [line for line in lines if len(line)]
            assert sorted(map(len, found)) == sorted(map(len, wanted))
            for one in wanted:
                assert any(line.shape == one.shape and np.allclose(line, one) for line in found)
        assert opened.complaints == []


def zip_sorted(cost, error):
    """Return cost and error in the order of their pairs."""
    return np.array(sorted(zip(cost, error, strict=True))).T


@pytest.mark.deep
def test_the_csv_of_the_page_has_every_digit(browser, pages, several):
    table = odd(several).table
    with Opened(browser, pages / "odd.html") as opened:
        with opened.page.expect_download() as download:
            opened.page.click("#csv")
        found = pd.read_csv(download.value.path(), keep_default_na=False, dtype=str)
    assert found["key"].tolist() == table["key"].tolist()
    for name in table.columns:
        if name in {"case", "integrator", "contact", "status", "reason", "said_by", "fragile", "key"}:
            continue
        for text, value in zip(found[name], table[name], strict=True):
            if value is None or value != value:
                assert text == ""
            elif isinstance(value, str):
                assert text == value
            else:
                assert float(text) == value  # to the last bit
                assert len(text) <= len(repr(float(value)))  # and with no digit more than it takes


@pytest.mark.deep
@pytest.mark.parametrize("name", ["several", "odd"])
def test_points_are_where_their_axes_say(browser, pages, name):
    with Opened(browser, pages / f"{name}.html") as opened:
        page = opened.page
        for y in page.evaluate("[...document.getElementById('measure').options].map((one) => one.value)"):
            page.select_option("#measure", y)
            for chart in ("work", "vary"):
                for x in page.evaluate(f'[...document.querySelectorAll("#{chart}-x option")].map((one) => one.value)'):
                    page.select_option(f"#{chart}-x", x)
                    off = page.evaluate(
                        """([chart, x, y]) => {
                          const dots = charts[chart].chart.getOption().series.filter((s) => s.type === "scatter");
                          const points = dots.flatMap((s) => s.data).filter((at) => Number.isInteger(at[2]));
                          const off = (at, one, side) => one.kind !== "text"
                            && Math.abs(at[side] - (one.log ? Math.log10 : Number)(one.values[at[2]])) > 1e-9;
                          const wrong = points.filter((at) => off(at, column[x], 0) || off(at, column[y], 1));
                          return points.length ? wrong.length : -1;
                        }""",
                        [chart, x, y],
                    )
                    assert off == 0, (chart, x, y)
        assert opened.complaints == []


@pytest.mark.deep
def test_a_click_never_leads_to_an_empty_chart(browser, pages, several):
    kept = set(odd(several).kept)
    for name in ("several", "odd"):  # one that kept no history, and one that kept those of every other run
        with Opened(browser, pages / f"{name}.html") as opened:
            page = opened.page
            page.click("#unpick", force=True) if name == "odd" else None
            points = page.evaluate(
                """() => charts.work.chart.getOption().series
                     .filter((one) => one.type === "scatter" && one.name !== "named")
                     .flatMap((one) => one.data.map((at) => at[2]))"""
            )
            keys = several.table["key"]
            bare = next(row for row in points if name == "several" or keys[row] not in kept)
            page.evaluate("(row) => pick(row, true)", bare)
            page.wait_for_function('() => document.querySelectorAll("#table .tabulator-row.picked").length === 1')
            row = page.locator("#table .tabulator-row.picked")
            assert keys[bare] in row.inner_text()
            assert f"({keys[bare]})" in page.inner_text("#force-note")
            assert "kept no forces" in page.inner_text("#force-note") or "keeps no force" in page.inner_text(
                "#force-note"
            )
            assert "A click shows its row" in page.evaluate("(row) => tipOfRun(row)", bare)
            if name == "odd":
                full = next(row for row in points if keys[row] in kept)
                page.evaluate("(row) => pick(row, true)", full)
                page.evaluate("(row) => pick(row, true)", bare)
                # the force that was there stays
                assert page.evaluate("charts.force.chart.getOption().series.length") >= 2
                assert "A click shows its force" in page.evaluate("(row) => tipOfRun(row)", full)
            assert opened.complaints == []


@pytest.mark.deep
def test_a_run_without_a_true_error_is_in_no_line_and_not_shown_first(browser, pages, several):
    table = odd(several).table
    cheapest = int(table["node_steps"].astype(float).idxmin())
    with Opened(browser, pages / "odd.html") as opened:
        titles, rows, picked = opened.page.evaluate(
            """() => {
              const { title, series } = charts.work.chart.getOption();
              const dots = series.filter((one) => one.type === "scatter" && one.name !== "named");
              return [title.map((one) => one.text), dots.flatMap((one) => one.data.map((at) => at[2])), picked];
            }"""
        )
        assert "cradle" not in titles
        assert cheapest not in rows
        assert table["force_error_l1"].iloc[picked].notna().all()
        lacking = int((table["status"].eq("done") & table["force_error_l1"].isna()).sum())
        note = opened.page.inner_text("#work-note")
        assert f"{lacking} runs that are done lack one of the two values, and are neither drawn nor ranked" in note
        assert opened.complaints == []


def test_lost_runs_are_told_in_cell_legend_and_tooltip(browser, pages):
    with Opened(browser, pages / "several.html") as opened:
        page = opened.page
        labels, tips = page.evaluate(
            """() => {
              const { series, tooltip } = charts.map.chart.getOption();
              const labels = series.flatMap((one) => one.data.filter((at) => at.label).map((at) => at.label.formatter));
              const tipsOf = (one, seriesIndex) => one.data.map((data) => tooltip[0].formatter({ data, seriesIndex }));
              const tips = series.flatMap(tipsOf);
              return [labels, tips];
            }"""
        )
        assert labels == []  # each case has panels of its own, in which a cell has one run
        assert sum("1 unstable" in tip for tip in tips) == 4 * 3  # of the first 24 panels, those of three cases
        assert "The first 24 of 32 panels are drawn" in page.inner_text("#map-note")
        assert "12 of the 180 runs on the map failed or have no such number" in page.inner_text("#map-note")
        rings = page.evaluate(
            """() => charts.vary.chart.getOption().series.filter((one) => one.name === "ring")
                 .flatMap((one) => one.data.map((at) => at.tip))"""
        )
        # in each of four cases the penalty with central difference failed once of three runs at one stiffness, and in
        # all at another; in one case another pair was refused at each of four
        assert sum("best of 2 of 3 runs, the others failed" in tip for tip in rings) == 4
        assert sum("none of 3 runs has a number" in tip for tip in rings) == len(rings) - 4 == 8
        assert "28 of 240 runs failed or have no such number" in page.inner_text("#vary-note")


@pytest.mark.deep
@pytest.mark.parametrize("statistic", ["best", "median"])
def test_a_law_without_the_varied_value_is_shown_at_every_value_of_it(browser, pages, several, statistic):
    with Opened(browser, pages / "several.html") as opened:
        page = opened.page
        page.select_option("#statistic", statistic)
        levels = """() => charts.vary.chart.getOption().series.filter((one) => one.name === "level")
            .map((one) => [one.data[0].label.formatter, one.data[0].value[1]])"""
        found = page.evaluate(levels)
        assert [words for words, _ in found] == ["no beta_s"] * 4 * 4
        done = several.table[several.table["contact"] == "lagrange"]
        of_pairs = done.groupby(["case", "integrator"])["force_error_l1"]
        heights = [height for _, height in found]
        for value in of_pairs.min() if statistic == "best" else of_pairs.median():
            assert min(abs(np.array(heights) - np.log10(100 * value))) < 1e-6
        categories = page.evaluate("charts.map.chart.getOption().xAxis.map((one) => one.data)")
        assert categories.count(["no beta_s"]) == page.evaluate("charts.map.chart.getOption().title.length") // 2 > 0
        opened.filter("method.contact.beta_s", "0.3")
        assert "lagrange" in opened.cells("contact")
        assert set(opened.cells("method.contact.beta_s")) == {"0.3", "no beta_s"}
        assert len(page.evaluate(levels)) == 4 * 4
        assert opened.complaints == []


def best_rows(page):
    """Return for each case the names, the values and the failures of its rows, and the names in bold."""
    return page.evaluate(
        """() => Object.fromEntries([...document.querySelectorAll("#best .case")].map((one) => [
          one.querySelector("h3").textContent,
          [...one.querySelectorAll("tbody tr")].map((line) => [
            line.querySelector("th span").textContent,
            ...[...line.querySelectorAll("td")].slice(1).map((at) => at.textContent),
            line.className,
          ]),
        ]))"""
    )


@pytest.mark.parametrize("statistic", ["median", pytest.param("best", marks=pytest.mark.deep)])
def test_the_page_ranks_the_pairs_of_each_case_as_the_rows_do(browser, pages, several, statistic):
    cells = study_data.cells(several.table, "force_error_l1")
    with Opened(browser, pages / "several.html") as opened:
        opened.page.select_option("#statistic", statistic)
        shown = best_rows(opened.page)
        assert list(shown) == list(cells)
        for case, own in cells.items():
            # references stand last, then pairs without a value
            order = sorted(
                own, key=lambda pair: ("tied" in pair, not own[pair].measured, getattr(own[pair], statistic))
            )
            assert [line[0] for line in shown[case]] == order
            for pair, best, median, failed, winner in shown[case]:
                cell = own[pair]
                assert bool(winner) == (pair == order[0])
                assert [best, median] == [
                    f"{float(f'{100 * value:.3g}'):g} %" if cell.measured else "" for value in (cell.best, cell.median)
                ]
                assert failed == cell.lost_words.replace(" runs", "")
        opened.filter("refine", "4")
        less = study_data.cells(several.table[several.table["refine"] == 4].reset_index(drop=True), "force_error_l1")
        for case, own in less.items():
            value = min(getattr(cell, statistic) for pair, cell in own.items() if cell.measured and "tied" not in pair)
            assert best_rows(opened.page)[case][0][1 if statistic == "best" else 2] == f"{100 * value:.3g} %"
        assert opened.complaints == []


@pytest.mark.deep
def test_the_profile_follows_measure_and_statistic(browser, pages):
    first = """() => Object.fromEntries(
      charts.profile.chart.getOption().series.map((one) => [one.name, one.data[0][1]]))"""
    with Opened(browser, pages / "several.html") as opened:
        page = opened.page
        assert opened.colours("profile")[0] > 5000
        assert page.inner_text("#profile-note").startswith("12 problems")
        assert "on a problem the best counts" in page.inner_text("#profile-note")
        best = page.evaluate(first)
        assert page.input_value("#statistic") == "best"
        page.select_option("#statistic", "median")
        assert "on a problem the median counts" in page.inner_text("#profile-note")
        assert page.evaluate(first) != best
        page.select_option("#measure", "penetration")
        shares = page.evaluate(first)
        assert shares["central-difference + lagrange"] == 1.0  # nothing overlaps less than nothing
        assert shares["central-difference + penalty"] == 0.0
        page.select_option("#measure", "noise")  # less of it is not better
        assert page.locator("#profiles:visible").count() == 0
        assert "Lines are medians" in page.inner_text("#vary-note")
        assert opened.complaints == []
    with Opened(browser, pages / "small.html") as opened:
        assert opened.page.locator("#profiles:visible").count() == 0


@pytest.mark.deep
def test_a_pair_with_one_run_that_is_not_beaten_has_a_mark_and_its_name(browser, tmp_path, several):
    study = copy.deepcopy(several)
    study.table = study.table[(study.table["refine"] == 1) | (study.table["contact"] == "tied")].reset_index(drop=True)
    study_report(study, tmp_path / "lone.html")
    with Opened(browser, tmp_path / "lone.html") as opened:
        found = opened.page.evaluate(
            """() => {
              const { series, title } = charts.work.chart.getOption();
              return series.filter((one) => one.name === "named").map(({ xAxisIndex, data: [{ label, value }] }) =>
                [title[xAxisIndex].text, label.formatter, value[0], value[1]]);
            }"""
        )
    done = study.table[study.table["status"] == "done"]
    wanted = {}
    for case, own in done.groupby("case"):
        for pair, line in study_charts.work_lines(own, "node_steps", "force_error_l1")[1].items():
            if line.shape[1] == 1:
                wanted[case, pair] = np.log10(line[:, 0] * (1, 100))
    assert {(case, pair) for case, pair, *_ in found} == set(wanted)
    assert len(wanted) == 4 * 6 - 1
    for case, pair, *at in found:
        assert at == pytest.approx(wanted[case, pair])


@pytest.mark.deep
def test_forces_begin_with_the_best_of_each_pair_and_follow_the_filters(browser, pages, small):
    table = small.table
    pairs = np.array(study_data.methods(table))

    def best(rows):
        return {int(own["force_error_l1"].idxmin()) for _, own in rows.groupby(pairs[rows.index])}

    with Opened(browser, pages / "small.html") as opened:
        page = opened.page
        done = table[table["status"] == "done"]
        assert set(page.evaluate("picked")) == best(done)
        opened.filter("time.courant", "0.5")
        assert set(page.evaluate("picked")) == best(done[done["time.courant"] == 0.5])
        names = page.evaluate("charts.force.chart.getOption().series.map((one) => one.name)")
        assert names[0] == "exact"
        assert len(names) == 7
        page.click("#unpick")
        page.click("#clear")
        page.wait_for_function("() => active.length === page.rows")
        assert page.evaluate("picked") == []  # what the user chose stays
        assert opened.complaints == []


@pytest.mark.deep
def test_each_contact_has_a_panel_of_its_own(browser, tmp_path, several):
    study = copy.deepcopy(several)
    line = {"time": np.linspace(0, 1, 9), "contact_force": np.arange(18.0).reshape(9, 2), "contact": ["a", "b"]}
    study.kept = dict.fromkeys(study.table["key"][:20], line)
    study_report(study, tmp_path / "two.html")
    with Opened(browser, tmp_path / "two.html") as opened:
        titles = opened.page.evaluate("charts.force.chart.getOption().title.map((one) => one.text)")
        assert titles == ["hunek: a", "hunek: b"]
        left = len(several.table) - 20
        assert opened.page.evaluate("page.not_in_page.length") == 0
        assert opened.page.evaluate("page.rows - Object.keys(page.histories).length") == left


@pytest.mark.deep
@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_colours_and_marks_are_told_from_the_page_and_from_each_other(browser, pages, scheme):
    with Opened(browser, pages / "several.html", scheme=scheme) as opened:
        colours, paper, marks = opened.page.evaluate(
            """() => [page.styles.slice(0, 8).map((_, k) => style(k).colour), looks().paper,
                      page.styles.slice(0, 8).map((_, k) => markOf(k).itemStyle)]"""
        )
        assert opened.page.evaluate("getComputedStyle(document.body).backgroundColor") == f"rgb{rgb(paper)}"
    assert min(contrast(colour, paper) for colour in colours) >= (1.9 if scheme == "light" else 3.0)
    assert len(set(colours)) == 8
    for one, other in itertools.combinations(colours, 2):
        assert sum(abs(a - b) for a, b in zip(rgb(one), rgb(other), strict=True)) > 60, (one, other)
    assert {mark["color"] for mark in marks} <= {*colours, paper}  # an open mark has the colour of the page inside


def rgb(colour):
    return tuple(int(colour[k : k + 2], 16) for k in (1, 3, 5))


def contrast(one, other):
    """Return the ratio of contrast of two colours, from 1 to 21, as WCAG defines it."""

    def light(colour):
        linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in (c / 255 for c in rgb(colour))]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted((light(one), light(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.deep
def test_no_axis_prints_two_equal_labels(browser, pages):
    with Opened(browser, pages / "several.html") as opened:
        bad = opened.page.evaluate(
            """() => {
              const bad = [];
              const check = (low, high, log) => {
                const labels = tickLabels(ticksBetween(low, high, log), log);
                if (new Set(labels).size !== labels.length || labels.length < 2) bad.push([log, low, high, labels]);
              };
              for (let power = -6; power < 8; power += 0.37) for (const wide of [1e-7, 1e-4, 0.01, 0.3, 2, 9]) {
                check(10 ** power, 10 ** power * (1 + wide), false);
                check(power, power + wide, true);
              }
              return bad;
            }"""
        )
        assert bad == []
