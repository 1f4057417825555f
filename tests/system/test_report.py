"""A study as one page: it loads nothing, runs no text of the study, and page, table and print have the same numbers."""

import copy
import hashlib
import itertools
import re
from html import unescape
from importlib import resources
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import percuss
from fake_studies import TWO_BARS, FakeStudy, drawn_study, several_cases
from marks import deep
from opened_page import Opened, drawn
from percuss.reporting import page_forces, study_charts, study_data
from percuss.reporting.study_figures import figures
from percuss.reporting.study_page import report_html
from percuss.reporting.verdict import answer
from percuss.studies.columns import metric

pytestmark = pytest.mark.slow

EVIL = (
    """</script><script>window.hacked = 1</script><img src=x onerror="window.hacked = 1">{{js}} $cases 'it' & "one" """
)
ERROR = "force error, L1 [%]"


@pytest.fixture(scope="module")
def large():
    return drawn_study(3000)


@pytest.fixture(scope="module")
def several():
    return several_cases()


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
    study.provenance |= {EVIL: {EVIL: [EVIL]}}
    line = {"time": np.linspace(0, 1, 9), "contact_force": np.arange(9.0), "contact_force_exact": np.arange(9.0)}
    study.kept = dict.fromkeys(table["key"], line)
    study.path = Path(EVIL)
    return study


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


def print_of(study, name, statistic="best"):
    """Return a figure for print as SVG."""
    pytest.importorskip("vl_convert", reason="figures of a study need the extra percuss[plot]")
    return dict(figures(study, statistic))[name]._repr_svg_()


def elements(html):
    """Return what the tags of a page load, where its links go, and its words."""
    tags = re.sub(r"<!--.*?-->|(<(script|style)[^>]*>).*?</\2>", r"\1", html, flags=re.DOTALL)
    assert not re.search(r"<[^>]* on\w+=", tags)
    loads = re.findall(r'<(?!a )[^>]*? (?:src|href|data|action|srcset)="([^"]*)"', tags)
    return loads, re.findall(r'<a [^>]*?href="([^"]*)"', tags), unescape(re.sub("<[^>]*>", "", tags))


# --------------------------------------------------------------------------------------------------- the file


def test_the_page_loads_nothing(several, large):
    html = report_html(several)
    loads, links, _ = elements(html)
    assert loads == ["data:,"]
    assert all(link.startswith("#") for link in links)
    assert "default-src 'none'" in html
    assert not re.search(r"@import|url\(\s*['\"]?(?!data:)[\w/]", html.split("<body>")[0])
    assert len(report_html(large)) < 4_000_000


def test_the_vendored_files_are_those_that_are_named():
    folder = resources.files("percuss") / "web" / "vendor"
    named = re.findall(r"^\| `(\S+)` .*`([0-9a-f]{64})` \|$", (folder / "README.md").read_text(), re.MULTILINE)
    assert len(named) == 5
    licences = (folder / "LICENSES").read_text()
    for name, digest in named:
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
        assert f"\n{Path(name).name.split('.')[0].split('_')[0]}" in licences


def test_the_page_says_what_was_asked_run_and_lost(several):
    words = " ".join(elements(report_html(several))[2].split())
    assert several.spec["question"] in words
    assert "percuss study study.yaml" in words
    assert "0f" * 32 in words
    assert "lambda / eps_s = -g - (eps_m / eps_s) g''" in words
    assert "doi 10.1002/nme.5712" in words
    assert "212 done, 16 unstable, 12 refused" in words
    assert "16 unstable: central-difference + penalty beta_s=1 refine=4, " in words


def test_unknown_methods_and_bare_studies_have_a_page_too(several):
    study = copy.deepcopy(several)
    study.table["contact"] = study.table["contact"].replace("penalty", "of-my-own")
    assert "of-my-own: not registered where this page was made" in report_html(study)
    about = {"case": ["a"], "integrator": ["i"], "contact": ["c"], "status": ["refused"], "reason": [""]}
    bare = pd.DataFrame({**about, "said_by": ["i"], "fragile": [None], "key": ["k"]})
    assert "1 run " in report_html(FakeStudy(bare))
    assert "0 runs" in report_html(FakeStudy(bare.iloc[:0]))


# ------------------------------------------------------------------------------------------------------ columns


def test_bins_hold_every_number_and_few_values_are_their_own():
    places, where = study_data.binned(np.array([3.0, 1.0, np.nan, 3.0]))
    assert (places.tolist(), where.tolist()) == ([1, 3], [1, 0, -1, 1])
    values = 10.0 ** np.random.default_rng(0).uniform(-3, 2, 1000)
    places, where = study_data.binned(values)
    assert where.min() == 0
    assert where.max() == study_data.BINS - 1
    assert np.abs(np.log10(values / places[where])).max() <= 0.5 * 5 / study_data.BINS + 1e-9


def axis_of(values, name="x", *, is_measure=False):
    return study_charts.axis(pd.Series(values, name=name), "label", is_measure=is_measure)


def test_an_axis_is_logarithmic_for_far_numbers_measures_and_the_mesh():
    for values in ([1, 2, 4, 8], [0.01, 0.03, 0.1], [1e-3, 1e-14, 0.2, 5.0, np.nan]):
        assert axis_of(values).kind == "log"
    for values in ([0.3, 0.5, 0.9], [-1, 100], [0, 1, 2, 3]):
        assert axis_of(values).kind == "linear"
    assert axis_of([0.3, 0.5, 0.9], is_measure=True).kind == "log"
    assert axis_of([3.0, 4.0, 6.0], "refine").kind == "log"
    for values in ([0.0, 1.0, 100.0, -1.0, np.nan], [0.0, 1.0], [np.nan, np.nan]):
        assert axis_of(values, is_measure=True).kind == "linear"
    words = axis_of(["matched", 0.5, None])
    assert (words.sort, words.type, words.joined) == (["0.5", "matched", ""], "nominal", "tick")
    assert axis_of([4.0, 1.0, 4.0, np.nan]).axis["values"] == [1.0, 4.0]
    assert "values" not in axis_of(np.arange(9.0)).axis


def test_what_is_round_off_is_drawn_at_the_lower_edge(several):
    table = several.table.copy()
    table.loc[table.index[0], "force_error_l1"] = 1e-17
    charts = study_charts.study_charts(table, study_data.columns(several))
    axis = charts.axes["force_error_l1"]
    assert charts.rows[axis.drawn][0] == pytest.approx(1e-8 * table["force_error_l1"].max())
    assert charts.rows[axis.field][0] == 1e-15  # in the table it is what it is, in per cent
    assert charts.rows[f"{axis.field}r"][0] == 1e-17


def test_lines_that_share_a_colour_differ_in_mark_and_dashes():
    styles = [study_charts.line_style(k) for k in range(64)]
    for look in (1, 2):  # mark and dashes
        assert len({(style[0], str(style[look])) for style in styles}) == 64
        assert len({str(style[look]) for style in styles[:8]}) == 8


# ------------------------------------------------------------------------------------------ what is ranked, and how


def beaten(cost, error):
    """Return which runs another one beats: cheaper or as cheap, better or as good, and not equal in both."""
    cheaper, better = cost[:, None] >= cost[None, :], error[:, None] >= error[None, :]
    equal = (cost[:, None] == cost[None, :]) & (error[:, None] == error[None, :])
    return (cheaper & better & ~equal).any(axis=1)


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


@given(st.lists(st.sampled_from([1.0, 1.0, 1.5, 2.0, 7.0, np.inf]), min_size=1, max_size=12))
def test_the_steps_of_a_profile_are_the_shares_of_its_definition(ratios):
    ratios = np.sort(ratios)
    factors, shares = study_charts.profile_steps(ratios, 10.0)
    assert (factors[0], factors[-1]) == (1.0, 10.0)
    assert np.all(np.diff(factors) > 0)
    assert shares == [np.count_nonzero(ratios <= factor) / ratios.size for factor in factors]


def test_options_of_a_method_are_no_problems(several):
    """A law without stiffness and one with four values of it are set the same problems: a case with one mesh."""
    table, varied = several.table, ("method.contact.beta_s", "refine")
    asked = study_data.problems(table, varied)
    assert (asked["problem"].nunique(), asked["pair"].nunique()) == (4 * 3, 6)
    for (_, pair), own in asked.groupby(["problem", "pair"]):
        assert len(own) == (1 if "lagrange" in pair else 4)
    for _, own in asked.groupby("problem"):
        assert table.loc[own.index, "case"].nunique() == table.loc[own.index, "refine"].nunique() == 1
    lone = table.index[(table["contact"] == "lagrange") & (table["case"] == "hunek") & (table["refine"] == 1)][0]
    less = table.drop(index=lone).reset_index(drop=True)
    assert study_data.profile(less, "force_error_l1", study_data.problems(less, varied)).left_out == 1


def test_the_page_begins_with_the_verdict_and_what_the_error_depends_on(several):
    lines = [("p", 1, 0.02), ("p", 2, 0.01), ("q", 1, 0.01), ("q", 2, 0.08), ("r", 1, np.nan), ("r", 2, 0.5)]
    table = pd.DataFrame(lines, columns=["contact", "refine", "force_error_l1"]).assign(
        case="c", integrator="i", reason="", said_by="", fragile=None, key=[str(k) for k in range(6)]
    )
    table["status"] = np.where(table["force_error_l1"].isna(), "failed", "done")
    for study in (FakeStudy(table), several):
        known = study_data.columns(study)
        told = [*answer(study_data.records(study.table, known), known.measures)]
        depends = study_data.dependence(study.table, known)
        page = elements(report_html(study))[2].replace("\u00a0", " ")
        assert all(page.count(sentence) == 1 for sentence in (*told, *depends))
        if study is not several:
            assert told[0] == "At equal mesh i + q has the smallest force error, L1 on 1 of 2 meshes, i + p on 1."
            assert depends == ["The error of a pair in a case changes by a factor of 5 with refine (medians)."]
    assert "with refine, by a factor of 1.7 with method.contact.beta_s" in depends[0]
    assert not any("tied" in sentence for sentence in told)  # the tied twins have the least errors, and are no answer


def test_cost_is_that_of_the_method_alone():
    for integrator, stages in (("central-difference", 1), ("noh-bathe", 2)):
        case = percuss.load(TWO_BARS, {"method": {"integrator": integrator, "contact": "penalty"}})
        result = percuss.run(case, compiled=False)
        assert metric(result, "node_steps") == stages * result.summary["steps"] * (20 + 1 + 40 + 1)


def test_histories_are_few_and_thin_and_the_best_of_each_pair_and_case(several):
    study = copy.deepcopy(several)
    long = {"time": np.linspace(0, 1, 50_000), "contact_force": np.zeros((50_000, 6)), "contact_force_exact": None}
    study.kept = dict.fromkeys(study.table["key"], long)
    kept = page_forces.kept_histories(study, study.table, ["force_error_l1"])
    assert 60 < len(kept) <= page_forces.MOST_HISTORIES < len(study.table)
    for _, own in study.table.groupby(["case", "integrator", "contact"]):
        errors = own["force_error_l1"].astype(float).fillna(np.inf)
        here = [row in kept for row in own.index]
        assert any(here)
        assert max(errors[here]) <= min(errors[~np.array(here)], default=np.inf)
    assert all(len(lines[0][0]) <= page_forces.POINTS for one in kept.values() for lines in one.values())


# ------------------------------------------------------------------------------- page, table and print say the same


def per_cent(value):
    return f"{float(f'{100 * value:.3g}'):g} %"


def best_rows(svg):
    """Return for each case its rows from the first on: pair, best and median, failed runs, and whether it is bold."""
    out = {}
    numbers = {(one["case"], one["pair"]): one["text"] for one in drawn(svg, "numbers")}
    for one in sorted(drawn(svg, "names"), key=lambda one: int(one["place"])):
        key = (one["case"], one["pair"])
        out.setdefault(one["case"], []).append(
            (one["pair"], numbers[key], one.get("lost", ""), one["weight"] == "bold")
        )
    return out


def wanted_rows(table, statistic):
    """Return what `best_rows` is to say: pairs from the best on, those without a number late, the tied twins last."""
    out = {}
    made = table.assign(pair=study_data.methods(table), error=table["force_error_l1"].astype(float))
    for case, of_case in made.groupby("case", sort=False):
        lines = []
        for pair, own in of_case.groupby("pair", sort=False):
            best, median = own["error"].min(), own["error"].median()
            lost = own.loc[own["error"].isna(), "status"].replace("done", "without a number").value_counts()
            words = ", ".join(f"{count} of {len(own)} {status}" for status, count in lost.items())
            numbers = f"{per_cent(best)}, {per_cent(median)}" if len(lost) == 0 or lost.sum() < len(own) else ""
            rank = ("tied" in pair, np.isnan(best), {"best": best, "median": median}[statistic])
            lines.append((rank, pair, numbers, words))
        lines.sort()
        first = lines[0][0] if not np.isnan(lines[0][0][2]) else None
        out[case] = [(*line, rank == first) for rank, *line in lines]
    return out


def plain_rows(rows):
    return {
        case: [(pair, " ".join(numbers.split()), *more) for pair, numbers, *more in own] for case, own in rows.items()
    }


@pytest.mark.parametrize("statistic", ["best", deep("median")])
def test_the_pairs_of_each_case_are_ranked_as_its_rows_are(several, statistic):
    found = plain_rows(best_rows(print_of(several, "best-and-median", statistic)))
    assert found == wanted_rows(several.table, statistic)
    assert found["hunek"][-3][0] == "central-difference + penalty"
    assert found["hunek"][-3][2] == "4 of 12 unstable"


def test_no_line_joins_runs_of_different_cases_or_runs_that_another_beats(several):
    svg = print_of(several, "work-precision")
    table = several.table.assign(pair=study_data.methods(several.table))
    done = table[table["status"] == "done"]
    assert len(drawn(svg, "runs")) == len(done)
    found = drawn(svg, "fronts")
    for (case, pair), own in done.groupby(["case", "pair"]):
        cost, error = own["node_steps"].to_numpy(float), own["force_error_l1"].to_numpy(float)
        front = ~beaten(cost, error)
        of_pair = [one for one in found if (one["case"], one["pair"]) == (case, pair)]
        assert sorted(float(one[ERROR]) for one in of_pair) == pytest.approx(sorted(100 * error[front]))
    lines = re.findall(r'class="mark-line role-mark front_of_all_marks".*?</g>', svg)
    assert len(lines) == 4
    for line, (_, own) in zip(lines, done[done["contact"] != "tied"].groupby("case", sort=False), strict=True):
        points = np.array(re.findall(r"[ML](-?[\d.]+),(-?[\d.]+)", line), dtype=float)
        front = ~beaten(own["node_steps"].to_numpy(float), own["force_error_l1"].to_numpy(float))
        assert len(points) == front.sum()


@pytest.mark.parametrize("statistic", ["median", deep("best")])
def test_the_runs_over_a_varied_value_and_where_they_failed(several, statistic):
    """A ring stands on the lower edge where all runs failed, as there is no number to draw it at."""
    path = "method.contact.beta_s"
    svg = print_of(several, "against-method-contact-beta_s", statistic)
    table = several.table.assign(
        pair=study_data.methods(several.table), error=100 * several.table["force_error_l1"].astype(float)
    )
    table["error"] = table["error"].where(table["status"] == "done")
    there = {
        (one["case"], one["pair"], float(one[path])): float(one[ERROR])
        for one in drawn(svg, "chosen_runs")
        if one[ERROR] != "NaN"
    }
    rings = {
        layer: {(one["case"], one["pair"], float(one[path])) for one in drawn(svg, layer)}
        for layer in ("partly", "gone")
    }
    wanted = {"partly": set(), "gone": set()}
    for key, own in table[table[path].notna()].groupby(["case", "pair", path]):
        have = own["error"].notna().sum()
        if have:
            assert there.pop(key) == pytest.approx(own["error"].min() if statistic == "best" else own["error"].median())
        if have < len(own):
            wanted["partly" if have else "gone"].add(key)
    assert there == {}
    assert rings == wanted
    assert len(wanted["partly"]) == 4
    assert len(wanted["gone"]) == 8
    bare = table[table[path].isna()].groupby(["case", "pair"])["error"]
    levels = {(one["case"], one["pair"]): float(one[ERROR]) for one in drawn(svg, "level")}
    assert levels == pytest.approx(dict(bare.min() if statistic == "best" else bare.median()))


# --------------------------------------------------------------------------------------------------- a browser


@pytest.fixture(scope="module")
def pages(large, several, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    studies = {"large": large, "hostile": hostile(), "several": several, "odd": odd(several)}
    for name, study in studies.items():
        (folder / f"{name}.html").write_text(report_html(study), encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("name", "scheme", "width"),
    [
        (name, scheme, width) if pick == 2 else deep(name, scheme, width)
        for pick, (name, scheme, width) in enumerate(
            itertools.product(["odd", "large"], ["light", "dark"], [390, 1280])
        )
    ],
)
def test_the_page_is_drawn_and_asks_for_nothing(browser, pages, name, width, scheme):
    with Opened(browser, pages / f"{name}.html", width, scheme) as opened:
        assert len(opened.requests) == 1
        assert opened.complaints == []
        assert opened.page.evaluate("document.documentElement.scrollWidth") <= width
        charts = ["best", "work", "vary", "map", *(["profile", "force"] if name == "odd" else [])]
        assert set(opened.page.evaluate("Object.keys(views)")) == set(charts)
        for chart in charts:
            assert opened.svg(chart).count("<path") > 10, chart
        paper = opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (paper == "rgb(255, 255, 255)") == (scheme == "light")
        ink = opened.page.evaluate("getComputedStyle(document.body).color")
        assert f'fill="#{"".join(f"{int(c):02x}" for c in re.findall("[0-9]+", ink))}"' in opened.svg("best")


def test_no_text_of_a_study_runs_in_the_browser(browser, pages):
    with Opened(browser, pages / "hostile.html") as opened:
        page = opened.page
        page.locator("#table .tabulator-row").nth(0).click()
        page.hover("#work .chart-wrapper", position={"x": 200, "y": 100})
        opened.draw_all()
        page.wait_for_timeout(300)
        assert page.evaluate("window.hacked") is None
        assert page.locator("img").count() == 0
        assert len(opened.requests) == 1
        assert opened.complaints == []


def test_page_table_and_print_have_the_same_numbers_and_follow_the_filters(browser, pages, several):
    with Opened(browser, pages / "several.html") as opened:
        page = opened.page
        assert best_rows(opened.svg("best")) == best_rows(print_of(several, "best-and-median"))
        printed = print_of(several, "against-method-contact-beta_s")
        for layer in ("chosen_runs", "partly", "gone", "level"):
            assert drawn(opened.svg("vary"), layer) == drawn(printed, layer)
        heading = page.locator(
            f'#table .tabulator-col[tabulator-field="{opened.field("force_error_l1")}"] .tabulator-col-title'
        )
        heading.click()
        errors = 100 * several.table["force_error_l1"].astype(float)
        assert float(opened.cells("force_error_l1")[0]) == pytest.approx(errors.min(), rel=1e-3)
        opened.filter("refine", "4")
        page.wait_for_function('() => document.getElementById("count").textContent.startsWith("80 of")')
        less = several.table[several.table["refine"] == 4].reset_index(drop=True)
        assert plain_rows(best_rows(opened.svg("best"))) == wanted_rows(less, "best")
        page.select_option("#statistic", "median")
        assert plain_rows(best_rows(opened.svg("best"))) == wanted_rows(less, "median")
        # A law without the option passes every filter on it.
        opened.filter("method.contact.beta_s", "0.2..0.5")
        page.wait_for_function('() => document.getElementById("count").textContent.startsWith("32 of")')
        assert set(opened.cells("method.contact.beta_s")) == {"0.3", ""}
        page.click("#clear")
        page.wait_for_function('() => document.getElementById("count").textContent.startsWith("240 of")')
        page.select_option("#vary_x", "case")
        assert opened.svg("vary").count(">hunek<") == 1  # a place on the axis of one panel, and no panel of its own
        page.select_option("#filters select >> nth=0", label="hunek")
        page.wait_for_function('() => document.getElementById("count").textContent.startsWith("60 of")')
        assert set(best_rows(opened.svg("best"))) == {"hunek"}
        assert opened.complaints == []


def test_filters_of_numbers(browser, pages):
    bounds = {"0.5": (0.4999999, 0.5000002), "<1e-3": (-1, 9.99e-4), ">=2": (2, 9), "0.1..0.5": (0.1, 0.5)}
    values = [0.05, 0.1, 0.3, 0.5, 0.5000001, 2.0, 5e-4, 7.0]
    filtered = "([wanted, values]) => values.filter((value) => passes(wanted, value, { number: true }))"
    with Opened(browser, pages / "several.html", all_charts=False) as opened:
        for wanted, (low, high) in bounds.items():
            found = opened.page.evaluate(filtered, [wanted, values])
            assert found == [value for value in values if low <= value <= high]


@pytest.mark.deep
def test_every_choice_is_drawn(browser, pages):
    with Opened(browser, pages / "odd.html") as opened:
        for choice in ("measure", "statistic", "work_x", "vary_x", "map_v", "map_x", "map_y"):
            for value in opened.page.evaluate(f"[...{choice}.options].map((one) => one.value)"):
                opened.page.select_option(f"#{choice}", value)
                opened.draw_all()
                assert opened.complaints == [], (choice, value)


@pytest.mark.deep
def test_a_click_shows_the_force_and_the_command_of_a_run(browser, pages, several):
    with Opened(browser, pages / "odd.html") as opened:
        page = opened.page
        table = odd(several).table
        first = table.loc[page.evaluate("page.first")]
        assert set(first["case"]) == {"hunek"}
        done = table[(table["case"] == "hunek") & (table["status"] == "done")].assign(
            error=lambda own: own["force_error_l1"].astype(float)
        )
        kept = done[done["key"].isin(list(odd(several).kept)) & done["error"].notna()]
        assert set(first.index) == set(kept.groupby(["integrator", "contact"])["error"].idxmin())
        assert "exact" in page.evaluate("forces()[0].forces.map((one) => one.run)")
        page.evaluate("pick(0)")
        assert page.inner_text("#command") == "percuss run fake.sqlite --row s0000"
        assert page.evaluate("[...new Set(forces()[0].forces.map((one) => one.row))]") == [0]
        page.evaluate("pick(1)")
        assert "this page has no force of it" in page.inner_text("#chosen")
        page.locator("#table .tabulator-row").nth(2).dispatch_event("click")  # wherever a late chart moves it
        assert page.inner_text("#command") == "percuss run fake.sqlite --row s0002"
        assert page.locator("#table .tabulator-row.picked").count() == 3
        assert opened.complaints == []


@pytest.mark.deep
def test_the_csv_of_the_page_has_every_digit(browser, pages, several):
    table = odd(several).table
    with Opened(browser, pages / "odd.html") as opened:
        with opened.page.expect_download() as download:
            opened.page.click("#csv")
        found = pd.read_csv(download.value.path(), keep_default_na=False, dtype=str)
    assert found["key"].tolist() == table["key"].tolist()
    for name in set(table.columns) - {"case", "integrator", "contact", "status", "reason", "said_by", "fragile", "key"}:
        for text, value in zip(found[name], table[name], strict=True):
            if value is None or value != value:
                assert text == ""
            elif isinstance(value, str):
                assert text == value
            else:
                assert float(text) == value  # to the last bit
                assert len(text) <= len(repr(float(value)))  # and with no digit more than it takes
