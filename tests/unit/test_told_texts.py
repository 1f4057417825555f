"""Messages at their places, and texts of files that cannot steer a terminal."""

import xml.dom.minidom

import pytest

from command_line import percuss_command, refused
from percuss import InputError, RefusedPair, load, run
from percuss.errors import nearest, printable

TITLE = r"\e[31mred\x9b5m\e]0;owned\a [bold]b[/bold]"
SHOWN = r"\u001b[31mred\u009b5m\u001b]0;owned\u0007 [bold]b[/bold]"
CASE = f"""percuss: 1
title: "{TITLE}"
bodies:
  a: {{bar: {{length: 1, elements: 3}}, area: 1, velocity: 0.1, material: {{young: 1, density: 1}}}}
  b: {{bar: {{length: 1, elements: 3}}, at: 1, area: 1, material: {{young: 1, density: 1}}}}
contacts:
  c: {{between: [a.right, b.left]}}
method:
  integrator: central-difference
  contact: lagrange
time: {{steps: 4, courant: 0.5}}
"""


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "case.yaml"
    path.write_text(CASE)
    return path


@pytest.mark.parametrize("words", [("check",), ("verify",), ("run", "--json"), ("compare",)])
def test_no_text_of_a_case_steers_a_terminal(case, words):
    methods = ("--contact", "lagrange,penalty") if words[0] == "compare" else ()
    done = percuss_command(words[0], "case.yaml", *words[1:], *methods, cwd=case.parent, plain=True)
    assert printable(done.stdout + done.stderr) == done.stdout + done.stderr
    assert SHOWN.replace(" ", "") in "".join(done.stdout.replace("\\\n", "\\").split())  # it may be broken into lines


def test_no_message_does_either_nor_a_picture(case):
    told = refused("run", "case.yaml", "--set", r'"\e[2J"=1', cwd=case.parent)
    assert printable(told) == told
    assert percuss_command("run", "case.yaml", "--plot", "p.svg", cwd=case.parent, plain=True).returncode == 0
    xml.dom.minidom.parse(str(case.parent / "p.svg"))


def test_a_refused_pair_is_told_at_both_its_names(case):
    case.write_text(CASE.replace("central-difference", "explicit-hht"))
    done = percuss_command("run", "case.yaml", cwd=case.parent)
    assert done.returncode == 2
    first, _, _, second, *_ = done.stderr.splitlines()
    assert first.startswith("case.yaml:9:15: method.integrator: explicit-hht with lagrange is refused by explicit-hht")
    assert second == "case.yaml:10:12: method.contact: lagrange, the contact law of that pair"
    own = {"contacts.c.method": "lagrange", "method.contact": "penalty"}
    with pytest.raises(RefusedPair) as refused:
        run(load(case), own)
    assert [problem.place for problem in refused.value.problems] == [
        f"{case}:9:15", "--set contacts.c.method=lagrange",
    ]  # fmt: skip
    assert refused.value.sentence.startswith("explicit-hht with lagrange is refused by explicit-hht: ")


def test_two_ends_of_one_body_are_told_as_that(case):
    case.write_text(CASE.replace("[a.right, b.left]", "[a.right, a.left]"))
    message = r"7:26: contacts\.c\.between\.1: expected ends of two bodies, found a\.right and a\.left of one"
    with pytest.raises(InputError, match=message):
        load(case)


def test_an_end_that_is_driven_for_a_part_of_the_run_is_told_with_that_part(case):
    drive = "loads: {p: {prescribed-velocity: 0.1, on: a.right, from: 0.2, until: 0.4}}\n"
    case.write_text(CASE.replace("at: 1, area: 1,", "at: 1, area: 1, fixed: [left],") + drive)
    with pytest.raises(InputError, match=r"can move, found every side fixed or driven from 0\.16") as part:
        run(load(case), {"time": {"end": 1.0, "courant": 0.5}})
    assert "Free one of the ends" not in str(part.value)
    with pytest.raises(InputError, match=r"found every side fixed or driven\n(.*\n)*  Free one of the ends"):
        run(load(case), {"loads.p.from": None, "loads.p.until": None})


def test_a_far_fetched_name_is_not_suggested():
    assert nearest("velocty", ["velocity", "volume"]) == "velocity"
    assert nearest("tap", ["tip", "seam"]) == "tip"
    assert nearest("spring", ["ring", "spring-dashpot"]) == "spring-dashpot"
    assert nearest("radius", ["disk"]) is None
