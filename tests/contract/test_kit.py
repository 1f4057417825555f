"""The conformance kit itself: right methods pass, planted mistakes are caught by the check that should, by name."""

import dataclasses
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

import dense
import places
import planted
from command_line import percuss_command
from percuss import PluginError
from percuss.certificate import verdict
from percuss.methods.provenance import Provenance
from percuss.methods.registry import Registry
from percuss.testing import CheckFailed, StrictSystem, conformance
from percuss.testing.draws import bar_chains, for_all
from percuss.testing.kit import checks_of, known_checks, perform
from percuss.testing.report import Outcome, Report
from percuss.testing.subject import Subject, named

REGISTRY = Registry.load()


@pytest.mark.deep
@pytest.mark.parametrize("cls", planted.RIGHT, ids=lambda cls: cls.name)
def test_a_method_without_a_mistake_conforms(cls):
    report = conformance(cls, strict=False)
    assert report.passed, str(report)
    assert report.count("passed") >= 8


LASTING = (
    "exact-impact",
    "energy-never-grows",
    "order",
    "no-hidden-state",
    "units",
    "critical-courant",
)  # checks that take long


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cls", "name", "said"),
    [
        pytest.param(
            cls,
            name,
            said,
            id=f"{cls.name}-{name}",
            marks=pytest.mark.deep if name.partition(" with ")[0] in LASTING else (),
        )
        for cls, name, said in planted.WRONG
    ],
)
def test_a_planted_mistake_is_caught_by_the_check_that_should(cls, name, said):
    subject = Subject.of(cls, REGISTRY)
    (found,) = [perform(*each[:1], subject, each[1]) for each in checks_of(subject) if named(*each) == name]
    assert not found.good, f"{name} let it pass: {found.message or found.status}"
    assert name in str(found)
    assert said in found.message
    assert said in " ".join(str(Report(cls, (found,))).split())  # what decides is told in a short report too


def test_a_pairing_that_does_not_declare_the_patch_test_is_not_said_to_pass_it():
    for cls, said in (
        (REGISTRY.get("pairings", "node-to-segment"), "and pressures are wrong by 4.9"),
        (next(cls for cls, _, _ in planted.WRONG if cls.name == "negative-shares"), "yet it passes: declare it"),
    ):
        outcome = perform(named_check("patch-test"), Subject.of(cls, REGISTRY))
        assert outcome.status == "not applicable"
        assert said in outcome.message


def test_more_than_a_dozen_mistakes_are_planted_and_most_checks_see_one():
    assert len(planted.WRONG) > 90
    seen = {name.partition(" with ")[0] for _, name, _ in planted.WRONG}
    unseen = {one.name for one in known_checks()} - seen
    # identities that no plug-in can break by itself: the framework moves, turns and applies what it gives
    assert unseen <= {
        "placement", "balances", "first-step", "certificate", "schema",
        "as-a-strict-host-has-it", "compiled-and-plain", "documented", "formula", "frozen", "facts-of-loads",
        "runs-in-a-case", "impulse-and-balances", "methods-tend-to-it", "balance-in-contact",
    }, unseen  # fmt: skip


# ------------------------------------------------------------------------------------------------ how it is run


def test_without_pytest_one_call_runs_all_and_raises_with_the_report():
    with pytest.raises(AssertionError, match=r"kinks: the amplitude has a kink(.|\n)*DOES NOT CONFORM"):
        conformance(planted.SmoothClaimed)
    report = conformance(planted.SmoothClaimed, strict=False)
    assert not report.passed
    assert report.as_dict()["passed"] is False
    assert {one["status"] for one in report.as_dict()["checks"]} == {"passed", "failed"}


@pytest.mark.deep
def test_a_declared_failure_that_does_not_occur_is_an_error():
    subject = Subject.of(planted.DeclaredButPasses, REGISTRY)
    (units,) = [one for one in known_checks() if one.name == "units"]
    outcome = perform(units, subject)
    assert outcome.status == "passes unexpectedly"
    assert not outcome.good
    assert "declared to fail (it was so once), but it passes: delete the entry" in str(outcome)


def outcomes_of(name, *messages, partner="p{}", status="failed"):
    """Outcomes of one check with several partners, without running it."""
    named_so = named_check(name)
    return [Outcome(named_so, partner.format(k), status, text, case="a: 1\n") for k, text in enumerate(messages)]


def test_equal_failures_are_told_once_and_a_single_mistake_on_one_screen():
    """Failures differ in numbers, options and partners, and are still one kind."""
    impact = outcomes_of("exact-impact", *(f"with p{k} and {{'a': {k}}} it is off by 1.{k}e-3 %" for k in range(12)))
    growth = outcomes_of("energy-never-grows", "energy grows by 2 %") + outcomes_of(
        "energy-never-grows", "", status="passed"
    )
    report = Report(planted.WrongSign, (*impact, *growth), unmade=3)
    assert [len(group) for group in report.groups()] == [12, 1]
    lines = str(report).splitlines()
    told = " ".join(str(report).split())
    assert told.count("it is off by") == 1
    assert "12 checks (exact-impact with p0, exact-impact with p1, ...): with p0 and" in told
    assert "12 of 12 failed" in told
    assert "so 3 checks were not made" in told
    # a check that fails in all pairs is declared by its name alone
    assert 'expected_failures = {"exact-impact": "why", "energy-never-grows with p0": "why"}' in told
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80


def test_a_method_that_fails_by_itself_is_not_advised_to_declare_what_follows_in_pairs():
    failed = outcomes_of("pushes-apart", "its impulse is -1", partner=""), outcomes_of("exact-impact", "it is off")
    assert "declare it" in str(Report(planted.WrongSign, tuple(failed[1])))
    assert "declare it" not in str(Report(planted.WrongSign, (*failed[0], *failed[1])))


def test_the_smallest_failing_case_is_sought():
    """What fails with two bars and a push fails with fewer elements and steps than those first drawn."""

    def fails(case):
        subject.loaded[:] = [case]
        if len(case["bodies"]) == 2 and case["loads"]:
            raise CheckFailed("two bars are pushed")

    found = {}
    for shrinks in (False, True):
        subject = dataclasses.replace(Subject.of(planted.Spring, REGISTRY, draws=300), shrinks=shrinks)
        with pytest.raises(CheckFailed, match="two bars are pushed"):
            for_all(subject, bar_chains(push=True), fails)
        found[shrinks] = subject.loaded[0]
    elements = {how: sum(body["bar"]["elements"] for body in case["bodies"].values()) for how, case in found.items()}
    assert elements[True] < elements[False]
    assert found[True]["time"]["steps"] <= found[False]["time"]["steps"]
    assert len(found[True]["bodies"]) == 2


def test_a_declared_failure_that_occurs_is_told_with_its_reason():
    subject = Subject.of(planted.Spring, REGISTRY)
    (never,) = [one for one in known_checks() if one.name == "energy-never-grows"]
    outcome = perform(never, subject, "central-difference")
    assert outcome.status == "expected failure"
    assert outcome.good
    assert "a contact that opens or closes between two steps" in str(outcome)
    undeclared = perform(never, Subject.of(planted.Silent, REGISTRY), "central-difference")
    assert undeclared.status == "failed"
    assert "energy grows by" in undeclared.message


def with_law_of_somebody(law):
    """Return the registry with a law of another installed package."""
    key, source = ("contacts", law.name), Provenance("unfinished", "0.0.1", law.__module__, "/elsewhere/unfinished.py")
    return dataclasses.replace(
        REGISTRY, components={**REGISTRY.components, key: law}, sources={**REGISTRY.sources, key: source}
    )


def named_check(name):
    return next(one for one in known_checks() if one.name == name)


def test_an_unfinished_law_of_somebody_else_is_listed_apart_and_does_not_count():
    cls = REGISTRY.components["integrators", "central-difference"]
    subject = Subject.of(cls, with_law_of_somebody(planted.NoStep))
    assert "no-step" not in subject.partners
    assert set(subject.partners) == set(REGISTRY.names("contacts"))
    planned = [(check.name, partner) for check, partner in checks_of(subject)]
    assert [partner for _, partner in planned[-2:]] == ["no-step"] * 2  # the pairs with it come last
    assert all(partner != "no-step" for _, partner in planned[:-2])
    impact = named_check("exact-impact")
    outcomes = (perform(impact, subject, "lagrange"), perform(impact, subject, "no-step"))
    assert [(one.status, one.counts) for one in outcomes] == [("passed", True), ("failed", False)]
    report = Report(cls, outcomes)
    assert report.passed
    assert report.verdict == "central-difference (integrators) conforms: 1 passed"
    apart = str(report).partition("with methods of other plug-ins, which the verdict does not count:")[2]
    assert "failed  exact-impact with no-step" in apart
    assert [one["counts"] for one in report.as_dict()["checks"]] == [True, False]


def test_the_methods_of_one_plug_in_judge_each_other():
    subject = Subject.of(planted.Predicting, Subject.of(planted.WrongSign, REGISTRY).registry)
    assert "wrong-sign" in subject.partners
    assert perform(named_check("exact-impact"), subject, "wrong-sign").counts


@pytest.mark.parametrize(
    ("name", "partner"),
    [
        *(("conserves", ""), ("first-step", "")),
        *(
            pytest.param(*one, marks=pytest.mark.deep)
            for one in [("order", ""), ("exact-impact", "regularised-lagrange")]
        ),
    ],
)
def test_nothing_is_asked_above_the_limit_of_a_scheme(name, partner):
    assert planted.Viscous.critical_courant < 0.45
    outcome = perform(named_check(name), Subject.of(planted.Viscous, REGISTRY), partner)
    assert outcome.status == "passed", outcome.message


def test_a_partner_of_unknown_critical_step_is_asked_at_a_step_at_which_the_default_method_runs(monkeypatch):
    known = verdict.certificate
    monkeypatch.setattr(
        verdict, "certificate", lambda *given, **asked: {**known(*given, **asked), "courant_critical": None}
    )
    impact, registry = named_check("exact-impact"), Subject.of(planted.Stiffer, REGISTRY).registry
    outcome = perform(impact, Subject.of(planted.Predicting, registry), "stiffer")
    assert outcome.status == "passed", outcome.message
    # the law itself is held to the step at which the default law runs
    assert perform(impact, Subject.of(planted.Stiffer, REGISTRY), "wu-predictor-corrector").status == "failed"


@pytest.mark.slow
def test_one_line_of_pytest_is_one_test_a_check(pytester_free_run):
    out = pytester_free_run(
        "from planted import Triangle, SmoothClaimed\n"
        "from percuss.testing import conformance_test\n"
        "test_right = conformance_test(Triangle)\n"
        "test_wrong = conformance_test(SmoothClaimed)\n"
    )
    assert "test_wrong[kinks]" in out
    assert "the amplitude has a kink near time 0.0" in out
    assert "2 failed" in out  # the other is its formula
    assert "test_right" not in out.partition("short test summary")[2]


@pytest.fixture
def pytester_free_run(tmp_path):
    """Run pytest on a file by itself and return what it prints."""

    def ran(text):
        file = tmp_path / "test_mine.py"
        file.write_text(text)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-rf", str(file)]
        here = {**os.environ, "PYTHONPATH": str(places.SUPPORT)}
        return subprocess.run(command, cwd=tmp_path, env=here, capture_output=True, text=True, check=False).stdout

    return ran


def test_what_is_no_method_is_refused():
    for thing in (42, planted.Spring(), dict, planted.ContactLaw):
        with pytest.raises(PluginError, match="is no finished component: pass the class"):
            conformance(thing)


FILE = '''
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from percuss import Doc, Gt, Load, Unit


@dataclass(frozen=True)
class Mine(Load):
    """A step down.

    Formula: ``A(t) = value`` up to `duration`, zero after it.
    """

    name = "mine"
    summary = "A step down"
    examples = ({"value": 2.0},)
    expected_failures = {"kinks": "it does not know its own end"}

    value: Annotated[float, Unit("amplitude"), Doc("before")]
    duration: Annotated[float, Gt(0), Unit("time"), Doc("until")] = 0.1

    def amplitude(self, time):
        return np.where(time < self.duration, self.value, 0.0)

    def kinks(self):
        return ()
'''


@pytest.fixture
def verified(tmp_path):
    """Write a single-file plug-in, verify it and return what came out."""

    def ran(text, *more):
        file = tmp_path / "mine.py"
        file.write_text(text)
        return percuss_command("verify", "--plugin", file, *more, cwd=tmp_path)

    return ran


def test_a_single_file_is_verified_without_pytest(verified, tmp_path):
    done = verified(FILE)
    assert done.returncode == 0, done.stdout
    assert "mine (loads) conforms: " in done.stdout
    assert [one.name for one in tmp_path.iterdir() if one.suffix != ".py"] == []  # nothing is left in the folder
    assert "expected failure  kinks (it does not know its own end)" in verified(FILE, "--verbose").stdout
    wrong = verified(FILE.replace("Formula:", "So:"), "--json")
    assert wrong.returncode == 1
    told = json.loads(wrong.stdout)
    assert told["passed"] is False
    (failed,) = [one for one in told["methods"][0]["checks"] if one["status"] == "failed"]
    assert failed["name"] == "formula"
    assert failed["demand"].startswith("The docstring of a method has a paragraph")


def test_a_registered_method_is_verified_by_its_name(verified):
    done = verified(FILE, "--method", "ripple")
    assert done.returncode == 0, done.stdout
    assert "ripple (measures) conforms" in done.stdout
    unknown = verified(FILE, "--method", "riple")
    assert unknown.returncode == 2
    assert "Did you mean 'ripple'?" in unknown.stderr


LAW = '''
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw


@dataclass(frozen=True)
class Mine(ContactLaw):
    """A spring."""

    name = "mine"
    summary = "A spring"

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stifness)
'''


def test_a_law_that_cannot_run_is_told_on_one_screen_and_its_case_written(verified, tmp_path):
    done = verified(LAW, "--cases", "failed")
    assert done.returncode == 1
    told = " ".join(done.stdout.split())
    assert "starts: mine.py:14: AttributeError: 'ContactPoints' object has no attribute 'stifness'" in told
    assert "Did you mean 'stiffness'?" in told
    assert re.search(r"It cannot run, so \d\d checks were not made", told)
    assert len(done.stdout.splitlines()) <= 40
    assert max(len(line) for line in done.stdout.splitlines() if str(tmp_path) not in line) <= 80
    (case,) = (tmp_path / "failed").iterdir()
    assert case.name == "mine-starts.yaml"
    assert "has no attribute 'stifness'" in percuss_command("run", case, cwd=tmp_path).stderr


def test_there_must_be_something_to_verify(tmp_path):
    done = percuss_command("verify", cwd=tmp_path)
    assert done.returncode == 2
    assert "nothing to verify" in done.stderr


# ------------------------------------------------------------------------------------------------- strict host

CASE = {
    "bodies": {
        "a": {"bar": {"length": 1.0, "elements": 5}, "material": {"young": 100.0, "density": 0.01}, "area": 1.0,
              "at": 0.0, "velocity": 0.5},
        "b": {"bar": {"length": 2.0, "elements": 4}, "material": {"young": 49.0, "density": 0.02}, "area": 2.0,
              "at": 1.0, "velocity": 0.0, "fixed": ["right"]},
    },
    "contacts": {"ab": {"between": ["a.right", "b.left"]}, "wall": {"body": "a.left", "wall": -0.001}},
    "loads": {},
    "time": {"steps": 100, "courant": 0.5},
}  # fmt: skip


@pytest.mark.parametrize("integrator", ["central-difference", "wu-predictor-corrector"])
@pytest.mark.parametrize("law", ["penalty", "bipenalty", "lagrange"])
def test_the_strict_host_gives_what_the_dense_solver_gives(integrator, law):
    """Two hosts that know nothing of each other, nor of the march."""
    options = {"penalty": {"beta_s": 0.4}, "bipenalty": {"beta_s": 0.4, "ratio": 1.0}, "lagrange": {}}[law]
    host = StrictSystem(CASE, REGISTRY.get("integrators", integrator)(), REGISTRY.get("contacts", law)(**options))
    mine, theirs = host.march(), dense.march(CASE, integrator, {"name": law, **options})
    assert np.abs(theirs.force).max() > 0.0
    assert np.abs(mine.contact_force - theirs.force).max() <= 1e-10 * np.abs(theirs.force).max()
    assert np.abs(mine.displacement - theirs.u).max() <= 1e-11 * np.abs(theirs.u).max()


def test_the_strict_host_hands_out_nothing_that_can_be_changed():
    cd = REGISTRY.get("integrators", "central-difference")()
    with pytest.raises(ValueError, match="read-only"):
        StrictSystem(CASE, cd, planted.ChangesPoints())
    with pytest.raises(PluginError, match="multipliers changes what it was handed to read"):
        StrictSystem(CASE, cd, planted.ChangesTrial()).march()
    with pytest.raises(PluginError, match=r"leaves the multiplier of point \d of \d unset"):
        StrictSystem(CASE, cd, planted.FirstOnly()).march()
    points = StrictSystem(CASE, cd, planted.Spring()).points
    with pytest.raises(AttributeError):
        points.model  # noqa: B018


def test_without_hypothesis_the_kit_says_what_to_install():
    code = (
        "import sys; sys.modules['hypothesis'] = None\n"
        "from percuss.cli.main import app\n"
        "app(['verify', '--method', 'ripple'])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "error: the kit draws its cases with hypothesis: pip install 'percuss[kit]'" in done.stderr
    assert "Traceback" not in done.stderr


DRAWN = """
import sys
from types import SimpleNamespace
if sys.argv[1:]:
    sys.path.insert(0, sys.argv[1])
    import constants
from percuss.testing.draws import bar_chains, for_all, number
drawn = []
for_all(SimpleNamespace(draws=60, shrinks=False), bar_chains(), lambda case: drawn.append(case))
for_all(SimpleNamespace(draws=200, shrinks=False), number(10, 90), drawn.append)
print(drawn)
"""


@pytest.mark.deep
def test_the_draws_do_not_depend_on_the_modules_that_are_loaded(tmp_path):
    """Hypothesis would draw their constants, so that a method would conform in one installation and not in another."""
    (tmp_path / "constants.py").write_text(f"VALUES = {list(range(1001, 9000, 13))}\n")
    told = [
        subprocess.run([sys.executable, "-c", DRAWN, *more], capture_output=True, text=True, check=True).stdout
        for more in ([], [str(tmp_path)])
    ]
    assert len(told[0]) > 10_000
    assert told[0] == told[1]
