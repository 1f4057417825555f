"""The file of the rows of a study: what is stored is read again, another file is refused, a kill leaves a whole file.

A file of rows is drawn, not run: what is tested is how it is kept.
"""

import io
import re
import sqlite3

import numpy as np
import pytest

import percuss
from command_line import percuss_command
from percuss.errors import InputError
from percuss.studies.perform import Record
from percuss.studies.study_table import Store
from percuss.studies.tasks import Task

KEYS = [f"{n:02d}{'0123456789abcdef' * 2}"[:32] for n in range(6)]


def task(key, **varied):
    return Task("case", "central-difference", "penalty", varied, varied, key=key)


def stored(path):
    """Write a study of one session: a row for each key, one unstable, one with arrays, the last one not yet made."""
    arrays = io.BytesIO()
    np.savez(arrays, time=np.arange(5.0), contact_force=np.ones((5, 1)), contact=np.array(["tip"]))
    plan = [task(key, **{"time.courant": 0.1 * n}) for n, key in enumerate(KEYS)]
    columns, provenance = {"impulse": "sum", "noise": "of it"}, {"cores": 2}
    store = Store(path, new=True)
    store.begin({"spec": {"title": "Drawn"}, "columns": columns, "provenance": provenance}, plan)
    measures = {"impulse": 0.3, "noise": float("nan")}
    store.add([Record(KEYS[0], "done", seconds=0.1, measures=measures, histories=arrays.getvalue(), cpu="one")])
    store.add([Record(key, "done", seconds=0.1, measures=measures, cpu="one") for key in KEYS[1:-2]])
    store.add([Record(KEYS[-2], "unstable", "energy grew in step 7", "central-difference", cpu="one")])
    return path


def contents(path):
    """Return all that a study says, as one text."""
    study = percuss.open_study(path)
    arrays = {name: array.tolist() for name, array in (study.histories(KEYS[0]) or {}).items()}
    about = study.provenance, study.spec, study.columns, study.rows(), study.counts, study.with_histories
    return repr((study.as_records(), about, arrays, study.histories(KEYS[1])))


@pytest.fixture
def file(tmp_path):
    return stored(tmp_path / "rows.sqlite")


def change(file, command, *values):
    with sqlite3.connect(file) as db:
        db.execute(command, values)
    db.close()


@pytest.mark.parametrize("content", ["percuss: 1\n", "SQLite format 3\0 and no more", "\x89PNG", "x" * 5000])
@pytest.mark.parametrize("command", ["report", "verify"])
def test_another_file_is_refused(tmp_path, content, command):
    bad = tmp_path / "bad.sqlite"
    bad.write_bytes(content.encode("latin-1"))
    with pytest.raises(InputError, match=re.escape(f"{bad}: expected the file of a study, found ")):
        contents(bad)
    done = percuss_command(command, bad, plain=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{bad}: expected the file of a study" in done.stderr
    assert list(tmp_path.iterdir()) == [bad]


def test_where_no_row_is_done_nothing_is_verified(file):
    change(file, "DELETE FROM runs")
    done = percuss_command("verify", file, plain=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert "rows.sqlite: expected rows that are done, found none" in done.stderr


def test_a_file_of_an_earlier_version_is_refused(file):
    change(file, "PRAGMA user_version = 5")
    said = (
        r"of format 6, found one of an earlier version\n  .* make the study again: percuss study STUDY -o NEW\.sqlite"
    )
    with pytest.raises(InputError, match=said):
        contents(file)
    change(file, "PRAGMA user_version = 0")
    with pytest.raises(InputError, match="found another SQLite file"):
        contents(file)


def test_a_file_that_sqlite_cannot_read_is_told(file):
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(InputError, match=r"rows\.sqlite: cannot be read: .*\n  Use an undamaged copy"):
        contents(file)


def test_a_run_that_is_made_again_replaces_its_row(file):
    store = Store(file, new=True)
    store.begin({"columns": {}}, [task(KEYS[0])])
    store.add([Record(KEYS[0], "failed", "another"), Record(KEYS[0], "failed", "the last"), Record("new", "refused")])
    study = percuss.open_study(file)
    assert [(row["status"], row["reason"]) for row in study.as_records()] == [("failed", "the last")]
    assert study.histories(KEYS[0]) is None
    assert Store(file).finished_keys() == {*KEYS[:-1], "new"}


def test_a_process_that_is_killed_while_it_begins_leaves_a_file_that_can_be_begun(tmp_path):
    for nothing in ("", "PRAGMA journal_mode = WAL"):
        path = tmp_path / f"{len(nothing)}.sqlite"
        path.touch()
        change(path, nothing)
        assert percuss.open_study(path).as_records() == []  # for who watches it
        for command in ("report", "verify"):
            assert f"{path}: expected " in (done := percuss_command(command, path, plain=True)).stderr
            assert (done.returncode, done.stdout) == (2, "")
        assert contents(stored(path))


def test_a_study_whose_file_is_gone_makes_none(file, tmp_path):
    study = percuss.open_study(file)
    file.unlink()
    with pytest.raises(InputError, match=r"rows\.sqlite: cannot be read: unable to open database file"):
        _ = study.counts
    assert not list(tmp_path.iterdir())


def test_a_finished_study_is_one_file_that_needs_no_other_beside_it(file, tmp_path):
    """So it opens in a folder that cannot be written to: SQLite makes files beside one with a write-ahead log."""
    whole = contents(file)
    assert file.read_bytes()[18:20] == b"\2\2"  # with a write-ahead log
    Store(file).finish()
    assert file.read_bytes()[18:20] == b"\1\1"
    assert contents(file) == whole
    assert list(tmp_path.iterdir()) == [file]
