"""The verdict at the end of a command: true, computed, and where a reader of JSON does not meet it."""

import re
from pathlib import Path

import pytest

import percuss
import places
from command_line import percuss_command, printed
from marks import deep
from percuss.reporting.verdict import best_words, error_words, failures, rows_verdict, run_verdict, tie_words
from percuss.results.true_error import largest_error
from percuss.studies.columns import metric

CASES = places.ROOT / "cases"
COARSE = """\
percuss: 1
title: Two equal bars, five elements each
bodies:
  left: {bar: {length: 1, elements: 5}, material: {young: 1, density: 1}, area: 1, velocity: 1}
  right: {bar: {length: 1, elements: 5}, at: 1, material: {young: 1, density: 1}, area: 1}
contacts:
  tip: {between: [left.right, right.left]}
method: {integrator: central-difference, contact: penalty}
time: {end: 3, courant: 0.5}
"""
RAMBERG_OSGOOD = ("bodies.left.material={name: ramberg-osgood, young: 1, density: 1, yield_stress: 1}",)


@pytest.fixture
def coarse(tmp_path: Path) -> Path:
    path = tmp_path / "coarse.yaml"
    path.write_text(COARSE)
    return path


@pytest.mark.deep
def test_a_run_with_a_large_error_names_the_search_for_better_methods(coarse: Path) -> None:
    said = printed("run", str(coarse))
    told = re.search(rf"contact force is off by .*: try `percuss (recommend {coarse} [^`]*)`", said)
    few = ("--runs", "10", "--contact", "lagrange", "--workers", "1")
    found = percuss_command(*told[1].split(), *few, cwd=coarse.parent)
    assert re.search("(?m)^(Cheapest: |No run meets the bounds; the nearest is )", found.stdout), found.stderr


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (("time.courant=1.2",), "refused to run it: the certificate says unstable. To be stable, lower the step"),
        deep(RAMBERG_OSGOOD, "No exact solution is known"),
        (("refine=40", "method.contact=lagrange"), r"off by \S+ % \(exact solution known\)\.\n"),
        deep(("refine=4", *RAMBERG_OSGOOD), r"`--reference refine=16`, or try `percuss recommend .*`"),
        (("contacts={}",), "(?s)materials kept the energy put in.*is exact up to round-off"),
        (("time.courant=1.2", "time.on_unstable=warn"), r"do not trust this run\. To be stable, [^\n]*\n$"),
    ],
)
def test_what_else_a_verdict_says(coarse: Path, changes: tuple[str, ...], words: str) -> None:
    done = percuss_command("run", str(coarse), *(f"--set={change}" for change in changes))
    assert re.search(words, done.stdout), done.stdout + done.stderr


GLUED = ("method.contact={name: cohesive, strength: 2, length: 5}",)


def test_no_command_advises_to_drop_a_bond(coarse: Path) -> None:
    """The exact solution of bodies that may part would be off by more than 10 %, and lagrange nearer to it."""
    done = percuss_command("run", str(coarse), *(f"--set={change}" for change in GLUED))
    assert "No exact solution is known" in done.stdout
    assert "(cohesive) holds its bodies together" in done.stdout
    assert done.stdout.endswith("give `--reference refine=4`.\n")
    path = coarse.with_name("glued.yaml")
    path.write_text(COARSE.replace("penalty", "{name: cohesive, strength: 2, length: 5}"))
    done = percuss_command("recommend", str(path), "--error", "5%", cwd=coarse.parent)
    assert done.returncode == 2
    assert "expected a contact whose bodies may part, found a bond (cohesive)" in done.stderr
    done = percuss_command("compare", str(path), "--contact", "cohesive,lagrange", cwd=coarse.parent)
    assert "not compared, as their force error, L1 is unknown: central-difference + cohesive." in done.stdout


THREE = """\
percuss: 1
title: A contact that presses for the whole run, and one that begins to press at its end
bodies:
  left: {bar: {length: 1, elements: 20}, material: {young: 1, density: 1}, area: 1, velocity: 1}
  middle: {bar: {length: 2, elements: 40}, at: 1, material: {young: 1, density: 1}, area: 1}
  right: {bar: {length: 1, elements: 20}, at: 3, material: {young: 1, density: 1}, area: 1}
contacts:
  first: {between: [left.right, middle.left]}
  late: {between: [middle.right, right.left]}
method: {integrator: central-difference, contact: penalty}
time: {end: 2, courant: 0.5}
"""


def test_a_verdict_names_its_contact_and_leaves_out_one_that_barely_presses(tmp_path: Path) -> None:
    (tmp_path / "three.yaml").write_text(THREE)
    done = percuss_command("run", str(tmp_path / "three.yaml"))
    result = percuss.run(percuss.load(tmp_path / "three.yaml"))
    errors = {name: contact["force_error_l1"] for name, contact in result.summary["exact"]["contacts"].items()}
    assert errors["late"] > 0.5 > 3 * errors["first"]
    assert f"The contact force of 'first' is off by {100 * errors['first']:.2g} %" in done.stdout
    assert largest_error(result.summary) == metric(result, "force_error_l1") == errors["first"]
    assert "(exact: 1), overshoot" in done.stdout
    for command in (done.stdout, percuss_command("run", str(tmp_path / "three.yaml"), "--exact-only").stdout):
        assert "| first closed |    last open |" in command
        assert "still closed" in command
    longer = percuss.run(percuss.load(tmp_path / "three.yaml", {"time.end": 2.3}))
    assert error_words(longer).startswith("the contact force of 'late' is off by")


@pytest.mark.deep
def test_round_off_is_not_ranked(coarse: Path) -> None:
    """Exact laws overlap by round-off alone, which of them by less is chance; at the critical step all are exact."""
    uncovered = ("--set=bodies.left.material.name=ramberg-osgood", "--set=bodies.left.material.yield_stress=1")
    gap = ("--set=bodies.right.at=1.013", "--set=time.courant=0.3", "--set=refine=7")
    laws = ("--contact=lagrange,moreau-jean,penalty",)
    words = percuss_command("compare", str(coarse), *laws, *uncovered, *gap).stdout
    both = "central-difference + lagrange and central-difference + moreau-jean"
    assert f"{both} have the smallest largest penetration (0)" in words
    words = percuss_command("compare", str(coarse), *laws, "--set=time.courant=1", "--set=time.end=2.7").stdout
    assert f"{both} have the smallest force error, L1" in words


def test_a_run_whose_energy_grew_is_not_called_good_by_its_force() -> None:
    """Newmark's explicit scheme at its critical step: the force is exact, and the bars shake ever more."""
    changes = {"refine": 0.09, "time": {"end": 0.8, "courant": 1}, "record.every": 1}
    methods = {"method.integrator": "explicit-newmark", "method.contact": {"name": "nitsche"}}
    result = percuss.run(percuss.load(CASES / "hunek.yaml", {**changes, **methods}))
    assert largest_error(result.summary) < 1e-10 < 1e2 < metric(result, "energy_kept")
    *_, last = run_verdict(result, "")
    assert re.match(r"But contacts, scheme and materials added \S+ % of the energy put in, which no real contact", last)
    row = {"integrator": "a", "contact": "b", "case": "c", "status": "done", "force_error_l1": 0.0, "energy_kept": 3.0}
    assert "; its energy grew by 200 %" in best_words("c", [row], "force_error_l1")


def row(case, integrator, contact, refine, error, kept=0.5):
    measured = {"force_error_l1": error, "energy_kept": kept, "steps": 10, "seconds": error}
    names = {"case": case, "integrator": integrator, "contact": contact, "refine": refine}
    return names | {"status": "done", "reason": "", "said_by": "", "fragile": None} | measured


ROWS = [
    row("one", "a", "x", 1, 0.05),
    row("one", "b", "x", 1, 0.05),
    row("one", "a", "y", 1, 0.03),
    row("one", "a", "x", 2, 0.02),
    row("one", "b", "x", 2, 0.02),
    row("one", "a", "y", 2, 0.04),
    row("two", "a", "x", 1, 0.2),
    row("two", "b", "x", 1, 0.2),
    row("two", "a", "y", 1, 0.1),
]


def test_ties_and_the_best_at_equal_mesh_are_told_before_the_best() -> None:
    """The best of all runs may owe its place to its mesh; pairs with the same bits hide each other in every chart."""
    told = list(rows_verdict(ROWS, ["force_error_l1", "energy_kept", "steps", "seconds"]))
    smallest, both = (f"{verb} the smallest force error, L1" for verb in ("has", "have"))
    assert told == [
        "a + x and b + x tie: their numbers are the same to the last bit.",
        f"At equal mesh a + y {smallest} on 2 of 3 pairs of case and mesh, a + x on 1, b + x on 1.",
        f"one: a + x refine=2 and b + x refine=2 {both} (2 %); the median of 6 runs is 3.5 %.",
        f"two: a + y refine=1 {smallest} (10 %); the median of 3 runs is 20 %.",
    ]
    last_bit = [{**one, "energy_kept": 0.5 + 1e-16 * (one["integrator"] == "b")} for one in ROWS]
    assert last_bit[1]["energy_kept"] != 0.5
    assert not any(" tie: " in line for line in rows_verdict(last_bit, ["force_error_l1", "energy_kept"]))
    assert next(rows_verdict(ROWS[:3], ["steps"]), "") == ""


RUNS_ALL_THE_SAME = (
    r"^It runs although it is unstable, as the case asks \(on_unstable: warn\)\. "
    r"To be stable, lower the step to [^ ]* \(Courant number [^ ]*\)\.$"
)
UNKNOWN = "Whether it is stable is unknown: "


@pytest.mark.parametrize(
    ("changes", "lines"),
    [
        ((), ["It will run: 30 steps of 0.1.", r"It is stable: its step is \d+.* % of", "will compute the true"]),
        (("time.courant=1.2",), ["It will not run. To be stable, lower", r"unstable: its step is 120 % of", "compute"]),
        (("time.courant=1.2", "time.on_unstable=warn"), [RUNS_ALL_THE_SAME, "unst", "compute"]),
        (RAMBERG_OSGOOD, ["It will run", UNKNOWN, "cannot compute the true error: no exact solution"]),
    ],
)
def test_a_check_begins_with_three_answers(coarse: Path, changes: tuple[str, ...], lines: list[str]) -> None:
    said = printed("check", str(coarse), *(f"--set={change}" for change in changes)).splitlines()
    assert said[3] == ""
    for line, words in zip(said, lines, strict=False):
        assert re.search(words, line), line


def test_one_reason_is_told_once_with_the_number_of_its_runs() -> None:
    where = "node {0} of body 'steel'"
    why = f"not started: the certificate says unstable, {where} limits the step\n  cause: a step"
    runs = [("unstable", why.format(10 * k), f"i + l{k % 5}") for k in range(6)]
    assert list(failures([*runs, ("done", "", "i + l9")])) == [
        "6 unstable: i + l0, i + l1, i + l2 and 2 more: not started: the certificate says unstable"
    ]
    (alone,) = failures(runs[:1])
    assert alone.endswith("node 0 of body 'steel' limits the step; cause: a step")


def test_values_that_are_no_keys_may_vary():
    """A friction is a mapping, a mesh a list: runs with the same numbers are told all the same."""
    mu = {"method.friction": {"name": "coulomb", "mu": 0.2}, "bodies.block.block.elements": [8, 2]}
    head = ({"case": "a", "integrator": name, "contact": "lagrange"} for name in ("central-difference", "wu"))
    rows = [{**one, **mu, "status": "done", "energy_kept": 0.5} for one in head]
    (told,) = tie_words(rows, ["energy_kept"])
    assert told.startswith("central-difference + lagrange and wu + lagrange tie")
