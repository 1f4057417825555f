"""Numbers and sizes that cannot be computed with, and arguments of the wrong kind: one clear message each."""

import numpy as np
import pytest
import yaml

import percuss
import places
from command_line import percuss_command
from percuss.certificate.linear_laws import LinearLaws
from percuss.certificate.verdict import certificate, settled
from percuss.errors import InputError
from percuss.mesh import size_limits
from percuss.results.exact_only import run_exact
from strategies import hunek

ROOT = places.ROOT
HUNEK = str(ROOT / "cases" / "hunek.yaml")
GIB = 2**30

# what is set, and what the message says; on a machine of 16 GiB
ABSURD = [
    ("time.courant=1e300", ["time.courant: expected a number between 1e-100 and 1e+100, found 1e+300"]),
    ("method.contact.beta_s=1e154", ["method.contact.beta_s: expected a number between 1e-100 and", "found 1e+154"]),
    ("method.contact={name: uzawa, iterations: 4611686018427387904}", ["iterations: expected", "at most 10000"]),
    ("refine=1000000000", ["refine: expected elements that fit into memory", "1e+11 in body 'short'", "16 GiB"]),
    (f"bodies.short.bar.elements=1{30 * '0'}", ["elements: expected a whole number below 2^63, found 1000000"]),
    (f"refine={400 * '1'}", ["refine: expected a number greater than 0 and less than 1e18, found 1111"]),
    ("bodies.short.material.density=1e-100", ["bodies.short: expected a mass of an element between", "Choose units"]),
    ("bodies.short.material.young=1e100", ["bodies.short: expected a stiffness EA/h", "found 1e+101"]),
    ("time.end=1e8", ["found 2e+11 steps, whose records take", "TiB", "16 GiB", "record: {every: 10000}"]),
    ("record.fields=100000000", ["record.fields: expected snapshots that fit into memory"]),
]


@pytest.fixture
def machine(monkeypatch):
    monkeypatch.setattr(size_limits, "memory", lambda: 16 * GIB)


@pytest.mark.parametrize(("change", "said"), ABSURD, ids=[change for change, _ in ABSURD])
def test_what_cannot_be_computed_is_refused(change, said, machine):
    path, _, value = change.partition("=")
    overrides = {path: value, **({"time.end": 1e5, "record.every": 10**7} if "fields" in path else {})}
    with pytest.raises(InputError) as caught:
        percuss.run(percuss.load(HUNEK), overrides)
    for words in said:
        assert words in str(caught.value)
    assert "hunek.yaml:" in str(caught.value) or "--set" in str(caught.value)


def test_memory_that_runs_out_all_the_same_is_told(monkeypatch, capsys):
    import typer

    from percuss.cli.common import reporting

    with pytest.raises(typer.Exit) as caught, reporting(as_json=False):
        raise MemoryError("Unable to allocate 1 TiB")
    assert caught.value.exit_code == 2
    assert "too little memory for this (Unable to allocate 1 TiB)" in capsys.readouterr().err


WRONG = [
    (lambda case: percuss.run("file.yaml"), ["expected a case, found 'file.yaml' of type str", "percuss.load('file.y"]),
    (lambda case: percuss.run(case, "refine=2"), ["mapping of dotted paths to values as `overrides`", "'refine=2'"]),
    (lambda case: percuss.study({}, plugins="my.py"), ["percuss.study: expected a list of files", "As ['my.py']"]),
    (lambda case: percuss.stability(case, vary={"refine": "1,2"}), ["a list of values for 'refine' of `vary`"]),
    (lambda case: percuss.compare(case, contacts="penalty"), ["a list of names as `contacts`, found 'penalty'"]),
    (lambda _: percuss.check("case.yaml"), ["percuss.check: expected a case, found 'case.yaml' of type str"]),
    (lambda _: percuss.schema(files="law.py"), ["percuss.schema: expected a list of files"]),
]


@pytest.mark.parametrize(("call", "said"), WRONG, ids=[said[0] for _, said in WRONG])
def test_an_argument_of_the_wrong_kind_is_told_from_what_is_meant(call, said):
    with pytest.raises(InputError) as caught:
        call(percuss.load(hunek(4, end=0.01)))
    for words in said:
        assert words in str(caught.value)
    assert str(caught.value).startswith("percuss.")


def test_snapshots_of_an_exact_solution_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match=r"record.fields: expected snapshots that fit"):
        run_exact(percuss.load(hunek(4), {"record.fields": 2**62}))


def test_energies_that_overflow_end_a_run_without_a_word_of_numpy(tmp_path):
    soft = [f"--set=bodies.{name}.material.young=1e-95" for name in ("short", "long")]
    more = ["--set=loads.pull={on: short.left, constant: 1e100}", "--set=time={steps: 40, courant: 0.5}"]
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(hunek(4, end=0.1)), encoding="utf-8")
    done = percuss_command("run", tmp_path / "case.yaml", *soft, *more, plain=True)
    assert done.returncode == 1
    assert "the energy exceeds 1e+200, beyond which numbers overflow" in done.stderr
    assert "Warning" not in done.stderr


@pytest.mark.parametrize("integrator", ["central-difference", "wu-predictor-corrector"])
def test_matrices_that_overflow_leave_the_certificate_unknown(monkeypatch, integrator):
    def fails(self, dt):
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr(LinearLaws, "assess_step", fails)
    monkeypatch.setattr(LinearLaws, "critical_step", property(lambda self: fails(self, 0.0)))
    case = percuss.load(hunek(4, end=0.1), {"method.integrator": integrator})
    found = certificate(settled(case).model)
    assert found["stable"] == "unknown"
    assert "too large or too unlike to be computed with (Eigenvalues did not converge)" in found["why"]
    with pytest.raises(InputError, match=r"time\.courant: expected methods of which some step is known"):
        settled(percuss.load(hunek(4, end=0.1), {"method.integrator": integrator, "time.courant": "auto"}))
