"""The conformance kit itself: planted mistakes are caught by the check that should, by name."""

import dataclasses
import json
import os
import re
import subprocess
import sys
import unittest

import pytest

import places
import planted
from command_line import percuss_command, printed, refused
from percuss import ContactLaw, PluginError
from percuss.cli.scaffold import new
from percuss.methods.registry import Registry
from percuss.testing import CheckFailed, DeclaredFailure, NotApplicable, Subject, checks
from percuss.testing.kit import Check, demands
from percuss_methods.contacts.penalty import Penalty
from percuss_methods.integrators.central_difference import CentralDifference
from percuss_methods.integrators.viscous_central_difference import ViscousCentralDifference

REGISTRY = Registry.load()


def check_of(cls, name, registry=REGISTRY):
    return dict(checks(cls, registry=registry))[name]


# These compile the loop anew, and the checks are seen by other mistakes too, or are long.
LASTING, SLOW = (
    {"units", "blocks", "slides-far"},
    {"energy-claimed", "forgets-its-dashpot", "unbalanced", "speaks-python", "one-end"},
)


@pytest.mark.slow
@pytest.mark.parametrize(("cls", "name", "said"), [
    pytest.param(*one, id=one[0].name, marks=pytest.mark.deep if one[1] in LASTING or one[0].name in SLOW else ())
    for one in planted.WRONG
])  # fmt: skip
def test_a_planted_mistake_is_caught_by_the_check_that_should(cls, name, said):
    with pytest.raises(CheckFailed) as failure:
        check_of(cls, name)()
    assert said in failure.value.message


def test_all_checks_but_few_see_a_planted_mistake():
    seen = {name.partition(" with ")[0] for _, name, _ in planted.WRONG}
    # what no plug-in can break by itself: the framework applies what it gives
    assert {one.name for one in demands()} - seen == {"runs-in-a-case"}


# ------------------------------------------------------------------------------------------------ how it is run


def planted_like(like, **facts):
    planted.plant("declaring", "", "", like, **facts)
    return planted.WRONG.pop()[0]


def test_a_check_raises_what_pytest_and_unittest_know():
    assert issubclass(CheckFailed, AssertionError)
    assert issubclass(NotApplicable, unittest.SkipTest)
    with pytest.raises(CheckFailed, match=r"has a kink(.|\n)*demanded: `kinks` names every kink") as failure:
        check_of(planted.planted_smooth_claimed, "kinks")()
    assert failure.value.case == ""  # it reads none


def test_a_declared_failure_is_skipped_with_its_reason_and_one_that_is_not_declared_fails():
    name = "energy-never-grows with bipenalty"
    with pytest.raises(DeclaredFailure, match="declared: the same, and the penalty mass lets it pull"):
        check_of(CentralDifference, name)()
    with pytest.raises(CheckFailed, match=r"energy grows by(.|\n)*title: energy-never-grows of declaring"):
        check_of(planted_like(CentralDifference, expected_failures={}), name)()


def test_a_declared_failure_never_excuses_an_error():
    method = planted_like(Penalty, expected_failures={"exact-impact": "so it is"})
    check = check_of(method, "exact-impact with central-difference")
    wrong = dataclasses.replace(check.demand, function=lambda *_: 1 / 0)
    with pytest.raises(CheckFailed, match="ZeroDivisionError"):
        Check(wrong, Subject.of(method, REGISTRY), check.partner)()


@pytest.mark.deep
@pytest.mark.parametrize("name", ["conserves", "order"])
def test_nothing_is_asked_above_the_limit_of_a_scheme(name):
    """A Courant number of 0.4 and of 0.45."""
    much = {"examples": ({"viscosity": 2.5},), "critical_courant": 6.0**-0.5}
    check_of(planted_like(ViscousCentralDifference, **much), name)()


@pytest.mark.deep
def test_of_pytest_each_check_is_a_test(tmp_path):
    (tmp_path / "test_mine.py").write_text(
        "from planted import planted_smooth_claimed\n"
        "from percuss.testing import parametrize\n"
        "@parametrize(planted_smooth_claimed)\n"
        "def test_it(check):\n"
        "    check()\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-rf", "test_mine.py"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.pathsep.join([str(places.SUPPORT), *sys.path])},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "1 failed, 4 passed" in done.stdout, done.stdout
    assert "test_mine.py::test_it[smooth-claimed-kinks]" in done.stdout


def test_what_is_no_method_is_refused():
    for thing in (42, Penalty(), dict, ContactLaw):
        with pytest.raises(PluginError, match="is no finished component: pass the class"):
            list(checks(thing))


@pytest.fixture
def verified(tmp_path):
    """Write a template with other words, verify it and return what came out."""

    def ran(kind, words, *more):
        (file,) = [path for path in new("mine", kind, tmp_path).files if path.suffix == ".py"]
        text = file.read_text()
        for old, other in words.items():
            assert old in text
            text = text.replace(old, other)
        file.write_text(text)
        return percuss_command("verify", "--plugin", file, *more, cwd=tmp_path)

    return ran


UNKNOWING = {
    "return (0.5 * self.duration, self.duration)": "return ()",
    '    name = "mine"\n': '    name = "mine"\n    expected_failures = {"kinks": "it does not know its own end"}\n',
}


def test_a_file_is_verified_without_pytest(verified, tmp_path):
    done = verified("load", UNKNOWING, "--verbose")
    assert done.returncode == 0, done.stdout
    assert "mine (loads) conforms: 4 passed, 1 declared" in done.stdout
    assert "declared  kinks: it does not know its own end" in done.stdout
    assert {one.name.partition(".")[0] for one in tmp_path.iterdir()} == {"mine"}  # nothing is left in the folder


def test_a_failed_check_is_told_as_json(verified):
    wrong = verified("load", {"Formula:": "So:"}, "--json")
    assert wrong.returncode == 1
    told = json.loads(wrong.stdout)
    assert told["passed"] is False
    (failed,) = [one for one in told["methods"][0]["checks"] if one["status"] == "failed"]
    assert failed["name"] == "well-formed"
    assert failed["message"].startswith("formula: no paragraph")
    assert failed["demand"].startswith("Its class says what it is")


def test_a_registered_method_is_verified_by_its_name(tmp_path):
    assert "ripple (measures) conforms" in printed("verify", "--method", "ripple", cwd=tmp_path)
    assert "Did you mean 'ripple'?" in refused("verify", "--method", "riple", cwd=tmp_path)


def test_a_law_that_cannot_run_is_told_on_one_screen(verified):
    done = verified("contact", {"points.stiffness": "points.stifness"})
    assert done.returncode == 1
    told = r"starts: mine\.py:\d+: AttributeError: 'ContactPoints' object has no attribute 'stifness'"
    assert re.search(told, done.stdout), done.stdout
    assert "Did you mean 'stiffness'?" in done.stdout
    assert re.search(r"It cannot run, so \d\d checks were not made", done.stdout)
    assert len(done.stdout.splitlines()) <= 40


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
