"""A study as one page: it loads nothing, runs no text of the study, tells the same twice, and works in a browser."""

import copy
import hashlib
import json
import re
import shutil
from html.parser import HTMLParser
from importlib import resources

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from fake_studies import FakeStudy, drawn_study, run_study
from percuss import study_data
from percuss.cli import app
from percuss.cli_report import written
from percuss.study_report import report_html, study_report

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
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
    assert "the certificate says no" in words
    assert "random sample" not in words


def test_the_same_study_gives_the_same_page(small, large, tmp_path):
    assert report_html(small) == report_html(copy.deepcopy(small))
    assert report_html(large, "all.csv") == report_html(drawn_study(20_000), "all.csv")


def test_text_of_a_study_is_never_markup():
    plain, evil = Tags(report_html(drawn_study(40))), Tags(report_html(hostile()))
    assert evil.tags.count("script") == plain.tags.count("script")
    assert "img" not in evil.tags
    assert "window.hacked = 1" in "".join(evil.words)
    assert "{{js}}" in "".join(evil.words)


def test_a_table_larger_than_a_page_is_sampled_and_says_so(large, tmp_path):
    paths = study_report(large, tmp_path / "large.html")
    assert [path.name for path in paths] == ["large.html", "large.csv"]
    assert len(pd.read_csv(paths[1])) == 20_000
    html = paths[0].read_text(encoding="utf-8")
    data = data_of(html)
    assert (data["rows"], data["total"], data["seed"]) == (study_data.MOST_ROWS, 20_000, 0)
    assert "5,000 of the 20,000 rows: a random sample" in html
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
    assert "3 still to be run" in words
    assert "{name: penalty, beta_s: 2}" in words
    assert "lambda = eps_s <-g>" in words
    assert sum(group["count"] for group in study_data.lost(study.table)) == study.table["reason"].ne("").sum()


def test_columns_are_told_apart(small):
    known = study_data.columns(small)
    assert known.varied == ("method.contact.beta_s", "time.courant", "refine")
    assert list(known.measures)[:3] == ["force_error_l1", "force_error_l2", "impulse_error"]
    assert known.measures["noise"] == "noise of the force"
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
    cost[:3], error[3:6] = np.nan, 0.0
    found = study_data.front(cost, error)
    assert np.all(np.diff(found[0]) > 0)
    assert np.all(np.diff(found[1]) < 0)
    good = (error > 0) & np.isfinite(cost)
    for x, y in found.T:
        assert not ((cost[good] < x) & (error[good] <= y)).any()


def test_bands_are_quantiles_of_all_done_runs(large):
    table = large.table
    found = {(m, n): band for m, n, band in study_data.bands(table, ["noise", "seconds"], "refine")}
    method = "central-difference + penalty"
    assert found[method, "noise"][0].tolist() == [1, 2, 4, 8, 16, 32]
    own = table[(table["status"] == "done") & (np.array(study_data.methods(table)) == method) & (table["refine"] == 4)]
    assert found[method, "noise"][1:, 2] == pytest.approx(own["noise"].quantile([0.1, 0.5, 0.9]).to_numpy())


def test_maps_count_every_run_once(large):
    table = large.table
    found = {(x, y): one for x, y, one in study_data.maps(table, ["noise"], list(study_data.columns(large).varied))}
    assert len(found) == 6
    one = found["time.courant", "refine"]
    assert one["up"].tolist() == [1, 2, 4, 8, 16, 32]
    assert sum(told[kind].sum() for told in one["methods"].values() for kind in ("done", "unstable", "other")) == 20_000
    method = "wu-predictor-corrector + penalty"
    low, high = table["time.courant"].min(), table["time.courant"].max()
    own = table[(np.array(study_data.methods(table)) == method) & (table["refine"] == 2) & (table["status"] == "done")]
    first = own[own["time.courant"] < low + (high - low) / study_data.MAP_BINS]
    assert one["methods"][method]["done"][study_data.MAP_BINS] == len(first)
    assert one["methods"][method]["noise"][study_data.MAP_BINS] == pytest.approx(first["noise"].median())


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


def test_histories_are_few_thin_and_spread(small):
    study = copy.deepcopy(small)
    long = {"time": np.linspace(0, 1, 50_000), "contact_force": np.zeros((50_000, 6)), "contact_force_exact": None}
    study.kept = dict.fromkeys(study.table["key"], long)
    kept = study_data.kept_histories(study, study.table)
    assert 60 < len(kept) <= study_data.MOST_HISTORIES
    assert len(json.dumps(kept)) < 1.05 * study_data.MOST_LETTERS
    assert len({study_data.methods(study.table)[row] for row in kept}) == 6
    one = next(iter(kept.values()))
    assert len(one["force"]) == study_data.MOST_CONTACTS
    assert one["exact"] == []
    assert len(one["force"][0][0]) < 4 * study_data.POINTS * 2


def test_the_command_line_names_what_it_wrote(small, tmp_path):
    assert written(small, tmp_path / "s.db", None, None) == [tmp_path / "s.html"]
    told = CliRunner().invoke(app, ["report", str(tmp_path / "s.db"), "-o", str(tmp_path / "s.pdf")])
    assert told.exit_code == 2


def test_pictures_for_print(small, tmp_path):
    pytest.importorskip("matplotlib", reason="pictures need the extra percuss[plot]")
    paths = written(small, tmp_path / "s.db", None, tmp_path / "figures")
    names = {path.name for path in paths}
    assert names >= {
        "work-precision.svg",
        "work-precision.pdf",
        "against-method-contact-beta_s.svg",
        "against-refine.pdf",
    }
    assert all(path.stat().st_size > 10_000 for path in paths)
    assert not (tmp_path / "s.html").exists()


# --------------------------------------------------------------------------------------------------- a browser


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="the page is opened by playwright")
    if CHROMIUM is None:
        pytest.skip("the page is opened in Chromium, which is not installed")
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def pages(small, large, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    for name, study in {"small": small, "large": large, "hostile": hostile()}.items():
        study_report(study, folder / f"{name}.html")
    return folder


class Opened:
    """A page in the browser, and what it asked for and complained of."""

    def __init__(self, browser, path, width=1280, scheme="light"):
        self.requests, self.complaints = [], []
        self.page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-ready]")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.page.close()

    def colours(self, chart):
        """Return how many pixels of a chart are drawn, and in how many colours."""
        return self.page.evaluate(
            """(id) => {
              const { width, height } = document.querySelector(`#${id} canvas`);
              const copy = Object.assign(document.createElement("canvas"), { width, height });
              const paper = copy.getContext("2d", { willReadFrequently: true });
              paper.drawImage(document.querySelector(`#${id} canvas`), 0, 0);
              const data = paper.getImageData(0, 0, width, height).data;
              const seen = new Set();
              let drawn = 0;
              for (let k = 0; k < data.length; k += 4) {
                if (data[k + 3] === 0) continue;
                drawn += 1;
                seen.add((data[k] << 16) | (data[k + 1] << 8) | data[k + 2]);
              }
              return [drawn, seen.size];
            }""",
            chart,
        )

    def cells(self, title):
        """Return what the table shows in one column."""
        place = self.page.evaluate("(name) => columns.findIndex((one) => one.name === name)", title)
        return self.page.locator(f'#table .tabulator-cell[tabulator-field="c{place}"]').all_inner_texts()

    def filter(self, title, text):
        place = self.page.evaluate("(name) => columns.findIndex((one) => one.name === name)", title)
        box = self.page.locator(f'#table .tabulator-col[tabulator-field="c{place}"] input')
        box.fill("")
        before = self.page.inner_text("#count")
        box.press_sequentially(text)
        # Tabulator waits for the end of typing
        self.page.wait_for_function('(before) => document.getElementById("count").textContent !== before', arg=before)
        self.page.wait_for_timeout(400)


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", ["small", "large"])
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
        assert shown[0] == pytest.approx(small.table["force_error_l1"].min(), rel=1e-3)
        heading.click()
        assert float(opened.cells("force_error_l1")[0]) == pytest.approx(small.table["force_error_l1"].max(), rel=1e-3)
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
        page.wait_for_function('document.getElementById("count").textContent === "132 rows"')
        page.select_option("#filters select >> nth=2", "2")
        page.wait_for_function('document.getElementById("count").textContent === "66 of 132 rows"')
        assert opened.complaints == []


def test_every_choice_is_drawn(browser, pages):
    with Opened(browser, pages / "small.html") as opened:
        page = opened.page
        for choice, chart in {
            "work-x": "work",
            "work-y": "work",
            "vary-x": "vary",
            "vary-y": "vary",
            "map-v": "map",
        }.items():
            for value in page.evaluate(f'[...document.querySelectorAll("#{choice} option")].map((one) => one.value)'):
                page.select_option(f"#{choice}", value)
                assert opened.colours(chart)[0] > 2000, (choice, value)
        page.uncheck("#vary-log")
        page.uncheck("#work-log")
        page.click("#legend button >> nth=0")
        assert page.get_attribute("#legend button >> nth=0", "aria-pressed") == "false"
        assert opened.complaints == []


def test_a_click_on_a_row_or_a_point_shows_its_force(browser, pages):
    with Opened(browser, pages / "small.html") as opened:
        page = opened.page
        page.click("#unpick")
        assert page.locator("#force-legend .entry").count() == 0
        page.locator("#table .tabulator-row").nth(0).click()
        assert page.locator("#force-legend .entry").count() == 2
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
        page.wait_for_function('picked.length === 2 || document.querySelectorAll(".picked").length === 1')
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


def test_observed_orders_are_told_over_the_mesh(browser, pages, small):
    with Opened(browser, pages / "small.html") as opened:
        opened.filter("method.contact.beta_s", "0.2")
        opened.page.select_option("#vary-x", "refine")
        done = small.table[(small.table["status"] == "done") & (small.table["method.contact.beta_s"] == 0.2)]
        rows = done[np.array(study_data.methods(done)) == "wu-predictor-corrector + penalty"]
        medians = rows.groupby("refine")["force_error_l1"].median()
        order = f"{np.log2(medians[1] / medians[2]):.2g}"
        assert f"wu-predictor-corrector + penalty {order}" in opened.page.inner_text("#vary-note")


def test_a_sampled_page_says_of_what_its_lines_are(browser, pages):
    with Opened(browser, pages / "large.html") as opened:
        assert "of all 20,000 rows" in opened.page.inner_text("#vary-note")
        assert opened.page.inner_text("#count") == "5,000 rows sampled from 20,000"
        opened.filter("case", "hunek")
        assert "of the sample" in opened.page.inner_text("#vary-note")
        assert "of the sample" in opened.page.inner_text("#map-note")
        opened.page.click("#clear")
        opened.page.wait_for_function('document.getElementById("map-note").textContent.includes("all 20,000 rows")')
        shares = opened.page.evaluate(
            """() => {
              const [x, y] = [column["refine"], column["time.courant"]];
              const cells = (one, other) => storedMap(one, other).cells(0, null);
              const key = (i, j) => `${i} ${j}`;
              const turned = new Map(cells(y, x).map((cell) => [key(cell.j, cell.i), cell.value]));
              return cells(x, y).every((cell) => turned.get(key(cell.i, cell.j)) === cell.value);
            }"""
        )
        assert shares is True
        assert "kept no histories" in opened.page.inner_text("#force-note")


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
