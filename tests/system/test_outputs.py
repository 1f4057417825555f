"""What a command writes takes the place of no file that it reads, and of nothing but a file."""

import os
import pickle

import pytest
import yaml

import percuss
from command_line import percuss_command, printed
from percuss.cli.scaffold import new
from strategies import hunek

STABILITY = "stability case.yaml --vary method.contact.ratio=1,2 --by linear-laws"
STUDY = "study study.yaml --workers 1"
RECOMMEND = "recommend case.yaml --error 1% --runs 10 --workers 1"
ALL = [
    ("run case.yaml -o {}", "out.nc", "plug-in {}/my-law.py"),
    ("run case.yaml -o {}", "out.nc", "data file record.csv"),
    ("run case.yaml --animate {}", "out.gif", "case case.yaml"),
    ("compare case.yaml --contact penalty --plot {}", "out.svg", "case case.yaml"),
    (f"{STABILITY} -o {{}}", "out.csv", "case case.yaml"),
    ("waves case.yaml --plot {}", "out.svg", "case case.yaml"),
    (f"{STUDY} -o new.sqlite --export {{}}", "out.csv", "case case.yaml"),
    (f"{RECOMMEND} -o {{}}", "out.sqlite", "case case.yaml"),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with a case that names a plug-in and a record, a study of it, and its rows."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "record.csv").write_text("0,0\n0.1,0.01\n")
    new("my-law", "contact", folder)
    push = {"push": {"table": {"file": "record.csv"}, "on": "short.left"}}
    case = {**hunek(4, end=0.2), "plugins": ["my-law.py"], "loads": push}
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    study = {"percuss-study": 1, "cases": ["case.yaml"], "vary": {"method.contact.ratio": [1.0, 2.0]}}
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    printed("study", "study.yaml", "-o", "rows.sqlite", "--workers", "1", cwd=folder, plain=True)
    return folder


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def refused(folder, command):
    """Return what a command is refused with that changes no file and leaves none behind."""
    before, names = contents(folder), sorted(folder.iterdir())
    done = percuss_command(*command.split(), cwd=folder, plain=True)
    assert done.returncode == 2, done.stdout
    assert "Traceback" not in done.stderr
    assert contents(folder) == before
    assert sorted(folder.iterdir()) == names
    return done.stderr


def test_only_a_file_is_replaced(bench):
    target = bench / "out.nc"
    for make, remove, kind in ((os.mkdir, os.rmdir, "a folder"), (os.mkfifo, os.unlink, "a pipe or a device")):
        make(target)
        told = refused(bench, "run case.yaml -o out.nc")
        assert told.startswith(f"out.nc: expected a file to write, found {kind}\n  Name another file.")
        remove(target)


@pytest.mark.parametrize(("command", "name", "role"), ALL)
def test_no_output_takes_the_place_of_an_input(bench, command, name, role):
    """Here by way of a link, as the endings of most outputs are those of no input."""
    role = role.format(bench)
    link = bench / name
    link.symlink_to(role.split(" ")[-1])
    try:
        told = refused(bench, command.format(name))
        assert told.startswith(f"{name}: expected a file to write, found the {role}, which is read\n  Name another")
        assert link.is_symlink()
    finally:
        link.unlink()


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (f"{STUDY} -o study.yaml", "study.yaml: expected a file to write, found the study"),
        (f"{STUDY} -o my-law.yaml", "expected the file of a study, found a case"),
        (f"{STUDY} -o new.csv --export new.csv", "found the file of rows new.csv, which is read"),
        (f"{RECOMMEND} --plot nowhere/a.svg", "expected a folder nowhere"),
    ],
)
def test_an_output_is_checked_before_anything_is_run(bench, command, said):
    assert said in refused(bench, command)


def test_a_file_among_the_varied_values_is_an_input(bench):
    (bench / "other.csv").write_text("0,0\n0.1,0.02\n")
    vary = "--vary loads.push.table.file=record.csv,other.csv"
    told = refused(bench, f"stability case.yaml {vary} --by linear-laws -o other.csv")
    assert "other.csv: expected a file to write, found the data file other.csv, which is read" in told


def test_a_report_does_not_take_the_place_of_its_study(bench):
    rows = bench / "rows.html"
    rows.write_bytes((bench / "rows.sqlite").read_bytes())
    try:
        for command in ("report rows.html", "report rows.html -o rows.html"):
            assert "rows.html: expected a file to write, found the study rows.html, which is" in refused(bench, command)
    finally:
        rows.unlink()


def test_a_result_is_pickled():
    """As a pool of processes does with what a function returns."""
    result = percuss.run(percuss.load(hunek(4, end=0.2)), {"record.fields": 3})
    other, exact = pickle.loads(pickle.dumps((result, result.exact)))
    assert other.summary == result.summary
    assert other.provenance == result.provenance
    assert other.histories.identical(result.histories)
    assert other.fields.identical(result.fields)
    forces = [one.contacts["tip"].force(result.arrays["time"]).tolist() for one in (result.exact, other.exact, exact)]
    assert forces[0] == forces[1] == forces[2]
