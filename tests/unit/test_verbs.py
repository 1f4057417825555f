"""What the commands do, from Python: the functions give what the commands print, and objects that show themselves."""

import json

import pytest

import percuss
import places
from command_line import percuss_command
from percuss import load, run
from percuss.results.exact_only import run_exact

SMALL = {"bodies.short.bar.elements": 4, "bodies.long.bar.elements": 8, "expect": []}


@pytest.fixture(scope="module")
def case():
    return load(places.CASES / "hunek.yaml", SMALL)


def command(*words):
    options = [f"--set={path}={value}" for path, value in SMALL.items()]
    return json.loads(
        percuss_command(words[0], str(places.CASES / "hunek.yaml"), *words[1:], *options, "--json").stdout
    )


def test_the_functions_give_what_the_commands_print(case):
    assert percuss.check(case).data == command("check")
    # The last bits of LAPACK's small solutions hang on where its arrays lie in memory.
    for row, printed in zip(percuss.waves(case).rows(), command("waves")["rows"], strict=True):
        assert row.keys() == printed.keys()
        for value, other in zip(row.values(), printed.values(), strict=True):
            number = isinstance(other, float)
            assert value == (pytest.approx(other, rel=1e-12, abs=1e-12) if number else other)
    assert percuss.schema() == json.loads(percuss_command("schema").stdout)
    assert percuss.schema(study=True) == json.loads(percuss_command("schema", "--study").stdout)
    for words in ((), ("penalty",)):
        assert percuss.plugins(*words).data == json.loads(percuss_command("plugins", *words, "--json").stdout)
        assert repr(percuss.plugins(*words)).startswith("integrators" if not words else "penalty (contacts)")
    assert "bodies" in repr(percuss.check(case)).lower()


def test_a_case_is_verified_with_its_own_run_or_with_a_result(case):
    expecting = case.with_overrides(
        {"expect": [{"quantity": "impulse", "contact": "tip", "value": 1, "within": "1%", "source": "paper"}]}
    )
    result = run(expecting, compiled=False)
    (check,) = percuss.verify(expecting, result)
    assert not check.passed
    measured = result.summary["contacts"]["tip"]["impulse"]
    assert repr(check) == f"<failed: impulse of tip {measured:.6g}, expected 1 within 0.01>"
    assert percuss.verify(case, result) == []


def test_a_result_draws_itself_and_a_notebook_shows_the_figure(case, tmp_path):
    result = run(case, compiled=False)
    assert run_exact(case)._repr_png_().startswith(b"\x89PNG")
    assert result.plot(tmp_path / "figure.svg").axes[0].lines
    with pytest.raises(percuss.InputError, match="expected a picture"):
        result.plot(3)


def test_a_comparison_has_a_table(case):
    compared = percuss.compare(case, contacts=["penalty", "lagrange"], vary={"time.courant": [0.25, 0.5]})
    table = compared.table
    assert list(table["contact"]) == ["penalty", "penalty", "lagrange", "lagrange"]
    assert list(table["time.courant"]) == [0.25, 0.5, 0.25, 0.5]
    for run_made, steps in zip(compared, table["steps"], strict=True):
        assert steps == run_made.result.summary["steps"]
    assert repr(compared).splitlines()[0] == "wu-predictor-corrector + penalty courant=0.25: done"
