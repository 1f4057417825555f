"""The file of the rows of a study: what is stored is read again, another file is refused, a kill leaves a whole file.

A file of rows is drawn, not run: what is tested is how it is kept.
"""

import contextlib
import hashlib
import io
import re
import sqlite3
import subprocess
import sys

import numpy as np
import pytest

import percuss
from command_line import percuss_command
from percuss.errors import InputError
from percuss.studies.job_package import Record
from percuss.studies.store import Store
from percuss.studies.study_files import StudyFile
from percuss.studies.study_table import Study

KEYS = [f"{n:02d}{'0123456789abcdef' * 2}"[:32] for n in range(12)]


def stored(path, keys=KEYS, title="Damaged"):
    """Write a study of one session: a row for each key, some unstable, some with arrays, the last one not yet made."""
    draw = np.random.default_rng(5)
    names = {"case": "case", "integrator": "central-difference", "contact": "penalty"}
    varied = [{"time.courant": float(value)} for value in draw.random(len(keys))]
    plan = [
        (key, {**names, "varied": one, "changes": one, "twin": False}) for key, one in zip(keys, varied, strict=True)
    ]
    facts = {
        "study": {"file": None, "title": title, "cases": ["case.yaml"]},
        "spec": {"title": title, "vary": {"time.courant": [0.1, 0.2]}},
        "columns": {"impulse": "sum over contacts", "noise": "of the force"},
    }
    text = f"percuss: 1\ntitle: {title}\n"
    files = [StudyFile("case.yaml", "case", hashlib.sha256(text.encode()).hexdigest(), len(text), text)]
    store = Store(path, new=True)
    store.begin(facts, {"command": "percuss study drawn.yaml", "percuss": "1"}, plan, files)
    records = []
    for n, key in enumerate(keys[:-1]):
        arrays = io.BytesIO()
        np.savez(arrays, time=draw.random(5), contact_force=draw.random((5, 1)), contact=np.array(["tip"]))
        records += [
            Record(key, "unstable", "energy grew in step 7", "central-difference", cpu="one")
            if n % 3 == 2
            else Record(
                key,
                "done",
                fragile=False,
                seconds=draw.random(),
                measures={"impulse": draw.random(), "noise": float("nan") if n == 4 else draw.random()},
                compiling=0.0,
                cpu="one",
                histories=arrays.getvalue() if n < 3 else b"",
            )
        ]
    for first in range(0, len(records), 4):
        store.add(records[first : first + 4])
    return path


def contents(path):
    """Return all that a study says, as one text."""
    study = Study(path)
    arrays = [study.histories(key) for key in KEYS[:4]]
    told = [one and {name: array.tolist() for name, array in one.items()} for one in arrays]
    about = study.provenance, study.spec, study.columns, study.files, study.plan, study.counts
    return repr((study.as_records(), about, told))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return stored(tmp_path_factory.mktemp("whole") / "rows.sqlite")


@pytest.mark.parametrize("content", ["percuss: 1\n", "SQLite format 3\0 and no more", "\x89PNG", "x" * 5000])
def test_another_file_is_refused(tmp_path, content):
    bad = tmp_path / "bad.sqlite"
    bad.write_bytes(content.encode("latin-1"))
    with pytest.raises(InputError, match=re.escape(f"{bad}: expected the file of a study, found ")):
        contents(bad)
    done = percuss_command("report", bad, "-o", tmp_path / "page.html", plain=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{bad}: expected the file of a study" in done.stderr
    assert not (tmp_path / "page.html").exists()


def test_a_file_of_an_earlier_version_is_refused(tmp_path):
    old = tmp_path / "old.sqlite"
    with sqlite3.connect(old) as db:
        db.execute("CREATE TABLE facts (name TEXT PRIMARY KEY, value TEXT NOT NULL)")
        db.execute("CREATE TABLE plan (number INTEGER PRIMARY KEY, key TEXT)")
    db.close()
    said = r"of format 4, found one of an earlier version\n  Make the study again: percuss study STUDY -o NEW\.sqlite"
    with pytest.raises(InputError, match=said):
        contents(old)
    with sqlite3.connect(old) as db:
        db.execute("DROP TABLE plan")
    db.close()
    with pytest.raises(InputError, match="found another SQLite file"):
        contents(old)


def test_a_file_that_sqlite_cannot_read_is_told(whole, tmp_path):
    bad, content = tmp_path / "bad.sqlite", whole.read_bytes()
    bad.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match=r"bad\.sqlite: cannot be read: .*\n  Use an undamaged copy"):
        contents(bad)


HARMLESS = {("runs", "{}")}  # a row may leave out what it does not have


@pytest.mark.parametrize("text", ["xx", "{}", "[]", '{"case": 1}'])
@pytest.mark.parametrize("table", ["plan", "runs"])
def test_a_row_that_is_not_as_it_was_written_is_one_error(whole, tmp_path, table, text):
    bad = tmp_path / "bad.sqlite"
    bad.write_bytes(whole.read_bytes())
    with sqlite3.connect(bad) as db:
        db.execute(f"UPDATE {table} SET {'value' if table == 'facts' else 'row'} = ?", (text,))
    db.close()
    told = contextlib.nullcontext() if (table, text) in HARMLESS else pytest.raises(InputError, match="is damaged: ")
    with told:
        contents(bad)


def test_a_run_that_is_made_again_replaces_its_row(whole, tmp_path):
    file = tmp_path / "rows.sqlite"
    file.write_bytes(whole.read_bytes())
    store = Store(file, new=True)
    names = {**dict.fromkeys(("case", "integrator", "contact"), "one"), "varied": {}}
    store.begin({"columns": {}}, {"command": None}, [(KEYS[0], names)])
    store.add([Record(KEYS[0], "failed", "another"), Record(KEYS[0], "failed", "the last"), Record("new", "refused")])
    study = percuss.open_study(file)
    assert [(row["status"], row["reason"]) for row in study.as_records()] == [("failed", "the last")]
    assert study.histories(KEYS[0]) is None
    assert study.command("of no run") is None
    assert Store(file).finished_keys() == {*KEYS[:-1], "new"}
    assert len(study.provenance["sessions"]) == 2


def test_a_log_of_a_file_that_is_gone_is_not_replayed(whole, tmp_path):
    """A process was killed, and its file was removed, but not the log beside it."""
    file, log = tmp_path / "rows.sqlite", tmp_path / "rows.sqlite-wal"
    file.write_bytes(whole.read_bytes())
    with sqlite3.connect(file) as db:
        db.execute("UPDATE runs SET status = 'failed'")
        db.commit()
        kept = log.read_bytes()
    db.close()
    file.unlink()
    log.write_bytes(kept)
    assert contents(stored(file)) == contents(whole)


def test_a_study_whose_file_is_gone_makes_none(whole, tmp_path):
    file = tmp_path / "rows.sqlite"
    file.write_bytes(whole.read_bytes())
    study = percuss.open_study(file)
    file.unlink()
    with pytest.raises(InputError, match=r"rows\.sqlite: cannot be read: unable to open database file"):
        _ = study.counts
    assert not list(tmp_path.iterdir())


def test_a_finished_study_is_one_file_that_needs_no_other_beside_it(whole, tmp_path):
    """So it opens in a folder that cannot be written to: SQLite makes files beside one with a write-ahead log."""
    file = tmp_path / "rows.sqlite"
    file.write_bytes(whole.read_bytes())
    assert file.read_bytes()[18:20] == b"\2\2"  # with a write-ahead log
    Store(file).finish()
    assert file.read_bytes()[18:20] == b"\1\1"
    assert contents(file) == contents(whole)
    assert list(tmp_path.iterdir()) == [file]


KILLED = """
import os, signal, sys
from pathlib import Path
import percuss.studies.pool
from percuss.studies.store import Store

def make(path):
    names = dict.fromkeys(("case", "integrator", "contact", "varied"))
    Store(path, new=True).begin({}, {"command": None}, [("k", names)])

make(Path(sys.argv[1]) / "warm.sqlite")
watched = ("open", "os.", "sqlite3.", "tempfile.", "shutil.")
number, status = 0, -1
while status:
    number += 1
    folder = Path(sys.argv[1]) / str(number)
    folder.mkdir()
    child = os.fork()
    if not child:
        left = [number]
        def count(event, _):
            left[0] -= event.startswith(watched)
            if not left[0]:
                os.kill(os.getpid(), signal.SIGKILL)
        sys.addaudithook(count)
        make(folder / "rows.sqlite")
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    whole = Store(folder / "rows.sqlite", new=True).planned().keys() == {"k"}
    print(number, whole)
    make(folder / "rows.sqlite")
    assert Store(folder / "rows.sqlite").planned().keys() == {"k"}
"""


@pytest.mark.skipif(sys.platform == "win32", reason="processes of that system are not forked")
def test_a_kill_in_the_moment_of_making_leaves_a_whole_file_or_none(tmp_path):
    """The process is killed before each of its calls to the system that touches a file."""
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    whole = [line.split()[1] for line in done.stdout.splitlines()]
    assert len(whole) > 2
    assert (whole[0], whole[-1]) == ("False", "True")
