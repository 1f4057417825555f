"""The command line as a user meets it: output, files, exit codes."""

import json
from pathlib import Path

import pytest

import percuss
import places
from command_line import percuss_command, printed, refused
from percuss.cli.main import COMMANDS

ROOT = places.ROOT
HUNEK = str(ROOT / "cases" / "hunek.yaml")


def test_help_names_every_command() -> None:
    told = printed("--help")
    shown = {words[0]: " ".join(words[1:]) for line in told.splitlines() if (words := line.split())}
    for command in COMMANDS:
        assert shown[command.__name__] == command.__doc__.splitlines()[0]  # whole, in a terminal of 80 columns
    assert max(map(len, told.splitlines())) <= 80


def test_version_is_an_option() -> None:
    done = percuss_command("--version")
    assert (done.returncode, done.stdout.split()[:2]) == (0, ["percuss", f"{percuss.__version__},"])


def test_run_prints_one_json_object() -> None:
    told = json.loads(printed("run", HUNEK, "--json"))
    assert told["steps"] == 1600
    assert told["status"] == "done"
    assert abs(told["contacts"]["tip"]["impulse"] - 0.02) < 2e-4
    assert set(told) >= {"dt", "certificate", "energy", "momentum", "exact", "seconds"}


@pytest.mark.slow
def test_the_exact_solution_alone_is_printed_saved_and_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    said = printed("run", HUNEK, "--exact-only", "-o", "a.nc", "--plot", "a.svg", cwd=tmp_path)
    for words in ("done", "bars-in-a-row", "0.02"):
        assert words in said
    result = percuss.open_result(tmp_path / "a.nc")
    assert result.fields["stress"].shape[0] == 400
    assert set(result.histories.coords) == {"time", "contact", "probe", "component"}
    told = json.loads(percuss_command("run", HUNEK, "--exact-only", "--json").stdout)
    written = {"title": result.title, **result.summary, "seconds": 0, "plugin_files": [], "error": None}
    assert {**told, "seconds": 0} == written


def test_a_run_that_its_certificate_forbids_is_not_started(tmp_path: Path) -> None:
    changes = ("method.integrator=central-difference", "method.contact=penalty", "method.contact.beta_s=100")
    sets = (f"--set={change}" for change in changes)
    done = percuss_command("run", HUNEK, *sets, "--json", "-o", "bad.nc", cwd=tmp_path)
    told = json.loads(done.stdout)
    assert (done.returncode, told["certificate"]["stable"], told["status"]) == (1, "no", "unstable")
    assert told["steps"] == told["stop"]["step"] == 0
    assert "closed contact 'tip'" in told["stop"]["cause"]
    assert "lower the step to 9.97503e-05" in told["stop"]["cause"]
    assert "not started" in done.stderr
    assert not (tmp_path / "bad.nc").exists()


def test_a_run_that_gains_energy_is_stopped_and_named(tmp_path: Path) -> None:
    law = "method.contact={name: bipenalty, beta_s: 10, ratio: matched}"
    sets = (f"--set={change}" for change in ("method.integrator=central-difference", law, "time.courant=0.9"))
    done = percuss_command("run", HUNEK, *sets, "--json", "-o", "bad.nc", cwd=tmp_path)
    told = json.loads(done.stdout)
    assert (done.returncode, told["certificate"]["stable"], told["status"]) == (1, "yes", "unstable")
    assert told["certificate"]["energy"] == "not guaranteed"
    assert told["stop"]["step"] > 0
    assert "contact adds energy" in told["stop"]["cause"]
    assert "likely cause" in done.stderr
    assert percuss.open_result(tmp_path / "bad.nc").status == "unstable"


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["run", "nowhere.yaml"], "nowhere.yaml"),
        (["run", HUNEK, "--plot", "a.bmp"], "png"),
        (["run", HUNEK, "--set", "refine"], "expected PATH=VALUE"),
        (["run", HUNEK, "--set", "method.contact.beta_s=-1"], "--set method.contact.beta_s=-1"),
        (["run", HUNEK, "--tied", "--exact-only"], "no interface to tie"),
        (["run", HUNEK, "--threads", "2", "--exact-only"], "expected --threads or --exact-only, found both"),
        (["run", HUNEK, "--threads", "0"], "--threads: expected a whole number from 1 to "),
        (["run", HUNEK, "--threads", "99999"], ", found 99999"),
        (["compare", HUNEK, "--contact", "penalti"], "Did you mean 'penalty'?"),
        (["compare", HUNEK, "--vary", "refine=a,b"], "--vary refine=a: refine: expected a number greater than 0"),
        (["compare", HUNEK, "--contact", "cohesive"], "--contact cohesive: method.contact.strength: missing"),
        (["recommend", HUNEK, "--error", "1%", "--workers", "-3"], "expected a number of at least 1, found -3"),
        (["stability", HUNEK, "--by", "linear-law"], "Did you mean 'linear-laws'?"),
        (["stability", HUNEK, "--plot", "a.svg"], "expected one or two --vary, found 0"),
        (["stability", HUNEK, "--vary", "method.contact.beta_z=1"], "Did you mean 'beta_s'?"),
        (["stability", HUNEK, "--vary", "refine=1", "--vary", "refine=2"], "expected a path once"),
        (["stability", HUNEK, "--vary", "refine=a"], "--vary refine=a: refine: expected a number greater than 0"),
        (["waves", HUNEK, "--contact", "tap"], "Did you mean 'tip'?"),
        (["waves", HUNEK, "--plot", "a.bmp"], "png"),
        (["recommend", HUNEK, "--error", "abc"], "--error: expected a number, found 'abc'"),
        (["recommend", HUNEK, "--error", "-1"], "--error: expected a finite number greater than 0, found -1"),
        (["recommend", HUNEK], "expected a bound on the error or on the energy, found none"),
        (
            ["recommend", HUNEK, "--error", "1%", "--contact", "cohesive"],
            "'cohesive' needs a value of strength and length, which no",
        ),
        (["recommend", HUNEK, "--error", "1%", "--runs", "3"], "--runs: expected a number of at least 10, found 3"),
        (["report", "x.sqlite", "-o", "a.pdf"], "a.pdf: expected a page ending in .html or .htm, found .pdf"),
        (["verify", "--method", "bipenalti"], "--method bipenalti: unknown component 'bipenalti'"),
    ],
    ids=lambda value: " ".join(value[:1] + value[2:]) if isinstance(value, list) else "",
)
def test_bad_input_is_one_clear_message(args: list[str], said: str, tmp_path: Path) -> None:
    assert said in refused(*args, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_what_is_expected_after_the_end_is_refused_before_the_run(tmp_path: Path) -> None:
    text = Path(HUNEK).read_text().replace("{end: 0.8, courant: 0.5}", "{steps: 50, courant: 0.5}")
    (tmp_path / "late.yaml").write_text(text)
    told = refused("run", "late.yaml", cwd=tmp_path)
    assert "late.yaml:25:53: expect.1.during: expected an interval that begins at or before the end" in told
    assert "nothing was run" in told


def test_a_run_that_an_override_shortens_is_not_held_to_what_its_file_expects() -> None:
    for override in ("time.end=0.05", "time={steps: 20, courant: 0.5}", "record.probes=[]"):
        assert percuss_command("run", HUNEK, "--set", override).returncode == 0


def test_bad_input_is_json_too() -> None:
    done = percuss_command("run", HUNEK, "--set", "refine=0", "--json")
    assert done.returncode == 2
    told = json.loads(done.stdout)
    assert told["status"] == "bad input"
    assert told["problems"][0]["path"] == "refine"


def test_compare_has_a_row_for_every_pair(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pairs = ("--integrator", "central-difference,wu-predictor-corrector", "--contact", "penalty,bipenalty,lagrange")
    options = ("--set", "method.contact.beta_s=100", "--plot", "a.svg", "--json")
    rows = json.loads(printed("compare", HUNEK, *pairs, *options, cwd=tmp_path))["rows"]
    assert len(rows) == 6
    status = {(r["integrator"], r["contact"]): r["status"] for r in rows}
    assert status["central-difference", "penalty"] == "unstable"
    assert status["wu-predictor-corrector", "bipenalty"] == "done"
    assert (tmp_path / "a.svg").exists()


def test_a_run_names_each_plug_in_file_that_is_loaded(tmp_path: Path) -> None:
    """Also one that the case names and does not use, which may be anything."""
    (tmp_path / "cases").mkdir()
    percuss.new("own", "contact", tmp_path)
    percuss.new("theirs", "contact", tmp_path / "cases")
    case = Path(HUNEK).read_text(encoding="utf-8") + "plugins: [theirs.py]\n"
    (tmp_path / "cases" / "case.yaml").write_text(case, encoding="utf-8")
    words = ("run", "cases/case.yaml", "--plugin", "own.py")
    told, as_json = (percuss_command(*words, *more, cwd=tmp_path) for more in ((), ("--json",)))
    assert told.returncode == 0, told.stderr
    named = [line.removeprefix("plug-in: ") for line in told.stdout.splitlines() if line.startswith("plug-in: ")]
    assert named == json.loads(as_json.stdout)["plugin_files"]
    assert [(tmp_path / name).resolve() for name in named] == [tmp_path / "own.py", tmp_path / "cases" / "theirs.py"]


def test_compare_replaces_a_contacts_own_law_and_says_so(tmp_path: Path) -> None:
    ends = "between: [short.right, long.left]"
    (tmp_path / "own.yaml").write_text(Path(HUNEK).read_text().replace(ends, f"{ends}, method: lagrange"))
    done = percuss_command("compare", "own.yaml", "--contact", "penalty,lagrange", "--json", cwd=tmp_path)
    assert "the named laws replace the own law of tip in every run" in done.stderr
    impulses = [r["summary"]["contacts"]["tip"]["peak_force"] for r in json.loads(done.stdout)["rows"]]
    assert impulses[0] != impulses[1]


def test_verify_passes_and_fails(tmp_path: Path) -> None:
    assert percuss_command("verify", HUNEK).returncode == 0
    (tmp_path / "wrong.yaml").write_text(Path(HUNEK).read_text().replace("mean: 0.05,", "mean: 0.06,"))
    done = percuss_command("verify", HUNEK, "wrong.yaml", "--json", cwd=tmp_path)
    assert done.returncode == 1
    told = json.loads(done.stdout)
    assert [case["passed"] for case in told["cases"]] == [True, False]
