"""Tables on narrow terminals and in pipes: no number is ever cut, and what is left out is named."""

import io
import re

import pytest
from rich.console import Console

from percuss.cli.common import progress_bar
from percuss.reporting import terminal
from percuss.reporting.tables import show
from percuss.reporting.terminal import study_lines
from percuss.studies.perform import Run

LONG = "integrator-with-a-name-that-someone-liked"
NUMBER = re.compile(r"-?\d[\d.]*(?:e[+-]?\d+)?")


class Study:
    title, found, path, complete = "A study with a title that is rather long", 3, "study.sqlite", True
    columns = {f"measure_number_{k}_error": "a number" for k in range(9)}
    spec = {"measure": list(columns)}

    def __init__(self, cases):
        self.cases = cases

    @property
    def counts(self):
        return {"done": len(self.as_records())}

    def as_records(self):
        return [
            {
                "case": case, "integrator": LONG, "contact": f"law-{k}-with-a-long-name",
                **({"method.contact.beta_s": 1.23456e-05 * (k + 1)} if len(self.cases) == 1 else {}), "status": "done",
                "reason": "", "said_by": "", "fragile": None, **dict.fromkeys(self.columns, -1.23456e-05),
                "seconds": 0.123, "key": "k",
            }
            for case in self.cases
            for k in range(7)
        ]  # fmt: skip


def comparison(monkeypatch):
    numbers = dict.fromkeys((*terminal.COMPARISON_TABLE, "seconds"), -1.23456789e-05)
    monkeypatch.setattr(terminal, "metrics", lambda _: numbers)
    varied = {"method.contact.beta_s": 1.2345678e-05, "bodies.short.bar.elements": 12345}
    return terminal.comparison_lines("A long title " * 9, [Run(LONG, "bipenalty", varied, "done") for _ in range(3)])


def stability(_):
    rows = [
        {
            "method.contact.beta_s": 0.0123456 * n, "time.courant": 0.9, "by": by, "courant_critical": 1.0 / (n + 1),
            "margin": 0.87654321, "theta": 0.12345678, "reason": "the bodies are not linear" if n % 2 else "",
        }
        for n in range(200)
        for by in ("linear-laws", "black-box")
    ]  # fmt: skip
    return terminal.stability_lines("A case", rows)


TABLES = {
    "compare": comparison,
    "stability": stability,
    "study of one case": lambda _: study_lines(Study(["hunek"])),
    "study of cases": lambda _: study_lines(Study(["hunek", "a-case-with-a-long-name"])),
}


@pytest.fixture
def told(monkeypatch):
    """Return what a table prints on a terminal of some width, or in a pipe."""

    def tell(name, width):
        out = io.StringIO()
        console = Console(
            file=out, width=width or 100_000, force_terminal=bool(width), color_system=None, highlight=False
        )
        show(TABLES[name](monkeypatch), console)
        return out.getvalue()

    return tell


@pytest.mark.parametrize("name", TABLES)
def test_no_number_is_cut_on_a_narrow_terminal(name, told):
    whole = set(NUMBER.findall(told(name, 0)))
    for width in (80, 60, 30):
        text = told(name, width)
        assert "…" not in text
        inside = [line for line in text.splitlines() if line.startswith(("│", "┃"))]
        assert all(len(line) <= width for line in inside)
        for line in inside:  # a number that is broken in two is none of those of the whole table
            cells = [cell.strip() for cell in line.split("│")]
            assert all(cell in whole for cell in cells if NUMBER.fullmatch(cell)), line


def test_the_columns_left_out_are_named(told):
    wide, narrow = told("compare", 0), told("compare", 80)
    left_out = re.search(r"not shown, for lack of width: ([^;]*); --json has all", narrow.replace("\n", " "))
    assert all(head.strip() in wide for head in left_out[1].split(", "))
    assert "not shown" not in wide


@pytest.mark.parametrize("name", TABLES)
def test_what_goes_into_a_pipe_is_plain_and_a_row_is_a_line(name, told):
    text = told(name, 0)
    assert text.isascii()
    assert "\x1b" not in text
    assert all(line == line.rstrip() for line in text.splitlines())
    assert len({line.count("|") for line in text.splitlines() if line.startswith("|")}) == 1


def test_many_critical_courant_numbers_are_summed_up(told):
    short = told("stability", 0)
    assert len(short.splitlines()) < 30
    assert "linear-laws: C critical from 0.005 (at method.contact.beta_s 2.45677, time.courant 0.9) to 1 (at" in short
    assert "of 200 combinations: -o FILE.csv saves every one, --json prints them" in short
    assert short.splitlines()[-1].startswith("black-box: C critical from 0.005 (at ")


def test_progress_is_told_without_a_terminal_and_does_not_count_what_came_before(capsys, monkeypatch):
    """Here two minutes of compiling, then 1000 runs that were stored before, then 1 s each; a line each half minute."""
    now = [0.0]
    monkeypatch.setattr("percuss.cli.common.time.monotonic", lambda: now[0])
    with progress_bar("runs") as progress:
        progress(0, 1400)
        for done in range(1000, 1200):
            now[0] = 120.0 + done - 1000
            progress(done, 1400)
    said = [line for line in capsys.readouterr().err.splitlines() if "after" in line]
    assert len(said) == 7, said
    assert said[:2] == ["1000 of 1400 runs after 2 min", "1030 of 1400 runs after 2 min, about 6 min to go"]
