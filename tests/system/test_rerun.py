"""`percuss verify RESULT.nc` makes a result again from itself alone, and says what differs and what has changed."""

import json

import numpy as np
import pytest
import yaml

import percuss
import places
from command_line import percuss_command, refused
from percuss import digest
from strategies import hunek

LAW = (places.SUPPORT / "bodies" / "spring.py").read_text(encoding="utf-8")
PULSE = {"push": {"table": {"file": "pulse.csv"}, "on": "short.left"}}


def saved(folder, case, overrides=None, name="result.nc", **how):
    """Run a case and save its result, also that of a run that was stopped; return its path."""
    try:
        result = percuss.run(percuss.load(case, overrides), **how)
    except percuss.RunError as stopped:
        result = stopped.result
    result.save(folder / name)
    return folder / name


def verified(path, *words):
    """Return exit code and comparison of a result."""
    made = percuss_command("verify", path, *words, "--json")
    return made.returncode, json.loads(made.stdout)["results"][0]


@pytest.fixture
def with_files(tmp_path):
    """A result whose case names a table and a plug-in, and the folder of these files."""
    folder = tmp_path / "case"
    folder.mkdir()
    (folder / "law.py").write_text(LAW, encoding="utf-8")
    (folder / "pulse.csv").write_text("time,force\n0,0\n0.1,0.002\n0.2,0\n", encoding="utf-8")
    case = hunek(5, contact="bipenalty", end=0.1) | {"plugins": ["law.py"], "loads": PULSE}
    (folder / "case.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    words = ("run", folder / "case.yaml", "--set", "method.contact=spring", "-o", tmp_path / "result.nc")
    assert percuss_command(*words).returncode == 0
    return tmp_path / "result.nc", folder


def test_the_case_inside_is_the_effective_one_and_brings_its_tables(with_files, monkeypatch):
    result, folder = with_files
    (folder / "pulse.csv").unlink()
    (folder / "case.yaml").unlink()
    monkeypatch.chdir(folder.parent)
    code, compared = verified(result)
    assert (code, compared["passed"], compared["differences"], compared["changes"]) == (0, True, [], [])


def test_no_code_inside_a_result_is_run(with_files, monkeypatch):
    result, folder = with_files
    (folder / "law.py").rename(folder / "moved.py")
    trap = folder.parent / "law.py"  # where the path in the case would lead from this folder
    trap.write_text("raise SystemExit('this file was run')\n", encoding="utf-8")
    monkeypatch.chdir(folder.parent)
    told = refused("verify", result)
    assert "needs spring (contacts)" in told
    assert "--plugin" in told
    with pytest.raises(percuss.InputError, match="needs spring"):
        percuss.open_result(result).exact  # noqa: B018 - the solution is computed again from the case
    assert verified(result, "--plugin", folder / "moved.py")[0] == 0


def test_a_plugin_that_has_changed_is_run_only_where_it_is_named(with_files):
    result, folder = with_files
    (folder / "law.py").write_text(LAW.replace("0.25", "0.26"), encoding="utf-8")
    refused = percuss_command("verify", result)
    assert refused.returncode == 2
    assert "it has changed since" in refused.stderr
    code, compared = verified(result, "--plugin", folder / "law.py")
    assert code == 1
    (change,) = compared["changes"]
    assert change["what"] == "plug-in contacts/spring"
    assert change["then"] != change["now"]
    force = next(one for one in compared["differences"] if one["quantity"] == "contact_force")
    assert (force["of"], force["now"] / force["then"]) == ("tip", pytest.approx(1.04))
    told = percuss_command("verify", result, "--plugin", folder / "law.py").stdout
    assert f"contact_force of tip from t = {force['time']:.9g} on" in told
    assert "changed since: plug-in contacts/spring" in told


@pytest.mark.parametrize(
    ("overrides", "how"),
    [
        ({"record.fields": 7, "record.every": 3}, {"nudge": True}),
        ({"time.courant": 3, "time.on_unstable": "warn"}, {}),
        ({"time.courant": "auto", "method.contact": {"name": "penalty"}}, {"compiled": False}),
    ],
    ids=["fields-and-nudge", "unstable", "plain-python"],
)
def test_any_run_is_made_again(tmp_path, overrides, how):
    code, compared = verified(saved(tmp_path, hunek(5, end=0.1), overrides, **how))
    assert (code, compared["differences"], compared["changes"]) == (0, [], [])


def test_one_bit_is_found_with_its_time(tmp_path):
    path = saved(tmp_path, hunek(5, end=0.1))
    result = percuss.open_result(path)
    gap = result.arrays["gap"]
    gap[3, 0] = np.nextafter(gap[3, 0], 1.0)
    result.summary["momentum"]["initial"][0] *= 1 + 2**-52
    result.save(path)
    code, compared = verified(path)
    assert code == 1
    history, number = compared["differences"]
    assert (history["quantity"], history["of"], history["time"]) == ("gap", "tip", result.arrays["time"][3])
    assert history["largest"] == abs(history["then"] - history["now"]) > 0
    assert number["quantity"] == "momentum.initial[0]"
    assert "nothing that percuss records has changed" in percuss_command("verify", path).stdout


def test_what_has_changed_is_told_although_the_bits_agree(tmp_path):
    path = saved(tmp_path, hunek(5, end=0.1))
    result = percuss.open_result(path)
    there = result.provenance
    there["versions"]["numpy"], there["source_digest"], there["machine"]["cpu"] = "1.0", "0" * 64, "another"
    there["plugins"]["contacts/bipenalty"]["digest"] = "f" * 64
    result.save(path)
    code, compared = verified(path)
    assert (code, compared["differences"]) == (0, [])
    changed = {one["what"]: (one["then"], one["now"]) for one in compared["changes"]}
    assert changed.pop("version of numpy") == ("1.0", np.__version__)
    assert changed.pop("sources of percuss") == ("0" * 64, digest.own_digest())
    assert changed.pop("processor")[0] == "another"
    assert changed.pop("plug-in contacts/bipenalty")[0].endswith("f" * 64)
    assert not changed
    told = percuss_command("verify", path).stdout
    assert "the same bits" in told
    assert f"changed since: version of numpy: 1.0, now {np.__version__}" in told


def test_what_is_no_result_is_refused_in_one_message(tmp_path):
    path = saved(tmp_path, hunek(5, end=0.1))
    older = percuss.open_result(path)
    del older.provenance["single_files"]
    older.save(tmp_path / "older.nc")
    ended = percuss.open_result(path)
    ended.summary["status"] = "interrupted"
    ended.save(tmp_path / "ended.nc")
    for name, told in (("older", "as an older percuss has written it"), ("ended", "found one that Ctrl-C ended")):
        refused = percuss_command("verify", tmp_path / f"{name}.nc")
        assert refused.returncode == 2
        assert told in refused.stderr
        assert "1 mistake; nothing was run" in refused.stderr


def test_results_and_cases_are_verified_together(tmp_path):
    path = saved(tmp_path, hunek(5, end=0.1))
    exact = tmp_path / "exact.nc"
    expectation = {"quantity": "steps", "value": 8, "within": 0, "source": "exact"}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(hunek(5, end=0.1) | {"expect": [expectation]}), encoding="utf-8")
    assert percuss_command("run", tmp_path / "case.yaml", "--exact-only", "-o", exact).returncode == 0
    steps = percuss.open_result(path).summary["steps"]
    made = json.loads(percuss_command("verify", path, exact, tmp_path / "case.yaml", "--json").stdout)
    assert [one["passed"] for one in made["results"]] == [True, True]
    assert made["passed"] == made["cases"][0]["passed"] == (steps == 8)
