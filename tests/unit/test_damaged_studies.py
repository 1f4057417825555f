"""The file of a study that is not as it was written is refused, whatever was changed in it, and never read as another.

A file of rows is drawn, not run: what is tested is how it is kept.
"""

import hashlib
import io
import json
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
from percuss.studies.store import FORMAT, Store
from percuss.studies.study_files import StudyFile
from percuss.studies.study_table import Study

KEYS = [f"{n:02d}{'0123456789abcdef' * 2}"[:32] for n in range(12)]
COMMAND = [["percuss run case.yaml --set time.courant=", {"value": "time.courant", "whole": False}]]


def stored(path, keys=KEYS, title="Damaged"):
    """Write a study of one session: a row for each key, some unstable, some with arrays, the last one not yet made."""
    draw = np.random.default_rng(5)
    names = {"case": "case", "integrator": "central-difference", "contact": "penalty"}
    varied = [{"time.courant": float(value)} for value in draw.random(len(keys))]
    plan = [(key, {**names, "varied": one, "command": 0}) for key, one in zip(keys, varied, strict=True)]
    facts = {
        "study": {"file": None, "title": title, "cases": ["case.yaml"]},
        "spec": {"title": title, "vary": {"time.courant": [0.1, 0.2]}},
        "columns": {"impulse": "sum over contacts", "noise": "of the force"},
        "commands": COMMAND,
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
    about = study.provenance, study.spec, study.columns, study.files, study.row_commands, study.counts
    return repr((study.as_records(), about, study.command(KEYS[5]), told))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return stored(tmp_path_factory.mktemp("whole") / "rows.sqlite")


def outcome(path):
    """Return the contents of a study, or the text of its refusal."""
    try:
        return contents(path)
    except InputError as error:
        return str(error)


def refusal(path):
    with pytest.raises(InputError) as caught:
        contents(path)
    told = str(caught.value)
    assert told.startswith(f"{path}: ")
    made_by = "drawn.yaml" if "sessions" not in told and "percuss-study-2" not in told else ""
    assert f"\n  Make the study again with `percuss study {made_by}" in told
    assert told.endswith(" -o NEW.sqlite`, or use an undamaged copy.")
    return told


@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.deep)])
@pytest.mark.parametrize("kind", ["another byte", "another digit", "a lost block", "a missing end", "a lost page"])
def test_no_change_gives_other_rows(whole, tmp_path, kind, count):
    """A change in free space alone may go unseen: what is read then is what was written."""
    content, expected, bad = whole.read_bytes(), contents(whole), tmp_path / "bad.sqlite"
    digits = [match.start() for match in re.finditer(rb"[0-9]", content)]
    draw = np.random.default_rng(11)
    refused = 0
    for _ in range(count):
        at = int(draw.choice(digits)) if kind == "another digit" else int(draw.integers(len(content)))
        byte = content[at] ^ int(draw.integers(1, 256))
        if kind == "another digit":
            byte = 48 + (content[at] - 48 + int(draw.integers(1, 10))) % 10
        page, other = at // 4096 * 4096, int(draw.integers(len(content) // 4096)) * 4096
        damaged = {
            "another byte": content[:at] + bytes([byte]) + content[at + 1 :],
            "another digit": content[:at] + bytes([byte]) + content[at + 1 :],
            "a lost block": content[:at] + bytes(len(content[at : at + 64])) + content[at + 64 :],
            "a missing end": content[:at],
            "a lost page": content[:page] + content[other : other + 4096] + content[page + 4096 :],
        }[kind]
        bad.write_bytes(damaged)
        told = outcome(bad)
        assert told == expected or told.startswith(f"{bad}: "), (at, byte)
        refused += told != expected
    assert refused > (0.9 if kind == "another digit" else 0.1) * count


# What an editor may do to a file that SQLite finds whole, and what is said of it.
EDITS = {
    "a run removed": ("DELETE FROM runs WHERE key = ?1", "rows were added to its table runs or removed from it"),
    "a run under another key": ("UPDATE runs SET key = 'x' WHERE key = ?1", "row 'x' of its table runs"),
    "a status": ("UPDATE runs SET status = 'failed' WHERE key = ?1", "row '00"),
    "a number": ("UPDATE runs SET seconds = seconds + 1e-12 WHERE key = ?1", "row '00"),
    "a number as text": ("UPDATE runs SET seconds = 'inf' WHERE key = ?1", "row '00"),
    "a column that there is not": ("UPDATE runs SET measures = '{\"x\": 1}' WHERE key = ?1", "row '00"),
    "a key twice": ("UPDATE runs SET measures = replace(measures, '{', '{\"noise\": NaN, ')", "row '00"),
    "the row of another run": ("UPDATE runs SET digest = (SELECT digest FROM runs r WHERE r.key != ?1)", "row '00"),
    "a row twice": (
        "INSERT INTO plan SELECT 99, key, row, digest FROM plan WHERE key = ?1",
        "row 99 of its table plan",
    ),
    "a row removed": ("DELETE FROM plan WHERE key = ?1", "rows were added to its table plan or removed from it"),
    "no plan": ("DELETE FROM plan", "rows were added to its table plan or removed from it"),
    "no commands": ("DELETE FROM facts WHERE name = 'commands'", "rows were added to its table facts"),
    "a command without its value": (
        "UPDATE facts SET value = replace(value, '\"value\"', '\"other\"') WHERE name = 'commands'",
        "row 'commands' of its table facts",
    ),
    "columns": ("UPDATE facts SET value = '{}' WHERE name = 'columns'", "row 'columns' of its table facts"),
    "a file": ("UPDATE files SET text = text || ' '", "row 0 of its table files"),
    "a session": ("DELETE FROM sessions", "rows were added to its table sessions or removed from it"),
    "no arrays": ("DELETE FROM arrays WHERE key = ?1", "the histories of the run 00"),
    "arrays of another run": ("UPDATE arrays SET npz = (SELECT max(npz) FROM arrays)", "the histories of the run 0"),
    "no seals": ("DELETE FROM seals", "rows were added to its table "),
    "a seal": ("UPDATE seals SET sum = 'z'", "the sum of the digests of its table "),
    "a column twice": ("ALTER TABLE runs ADD COLUMN status2", "its table runs has other columns than"),
    "no table": ("DROP TABLE files", "its table files has other columns than those it was made with"),
    "the format": ("UPDATE facts SET value = '\"percuss-study-9\"' WHERE name = 'format'", "found percuss-study-9"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_what_an_editor_changes_is_told(whole, tmp_path, edit):
    bad = tmp_path / "bad.sqlite"
    bad.write_bytes(whole.read_bytes())
    statement, said = EDITS[edit]
    with sqlite3.connect(bad) as db:
        db.execute(statement, (KEYS[0],) if "?1" in statement else ())
    db.close()
    assert said in refusal(bad)


def test_the_plan_of_another_study_is_told(whole, tmp_path):
    bad, other = tmp_path / "bad.sqlite", stored(tmp_path / "other.sqlite", keys=KEYS[::-1], title="Other")
    bad.write_bytes(whole.read_bytes())
    with sqlite3.connect(bad) as db:
        db.execute("ATTACH ? AS other", (str(other),))
        db.execute("DELETE FROM plan")
        db.execute("INSERT INTO plan SELECT * FROM other.plan")
    db.close()
    assert "rows were added to its table plan or removed from it" in refusal(bad)


def test_a_file_of_an_older_format_is_refused_with_the_command_that_makes_it_again(tmp_path):
    old = tmp_path / "old.sqlite"
    with sqlite3.connect(old) as db:
        db.execute("CREATE TABLE facts (name TEXT PRIMARY KEY, value TEXT NOT NULL)")
        db.execute("CREATE TABLE sessions (number INTEGER PRIMARY KEY, provenance TEXT NOT NULL)")
        db.execute("INSERT INTO facts VALUES ('format', '\"percuss-study-2\"')")
        db.execute("INSERT INTO sessions VALUES (1, ?)", (json.dumps({"command": "percuss study mine.yaml"}),))
    db.close()
    said = (
        f"expected the format {FORMAT}, found percuss-study-2\n  Make the study again with `percuss study mine.yaml -o"
    )
    assert said in refusal(old)


def test_the_command_line_refuses_a_damaged_study(whole, tmp_path):
    """Neither a report nor the rows of a study come of it, and no study is interrupted for ever."""
    content = whole.read_bytes()
    at = content.index(b'{"impulse": 0.') + 15
    bad = tmp_path / "bad.sqlite"
    bad.write_bytes(content[:at] + bytes([48 + (content[at] - 47) % 10]) + content[at + 1 :])
    done = percuss_command("report", bad, "-o", tmp_path / "page.html", plain=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{bad}: the file is damaged: row '" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "page.html").exists()


def test_a_run_that_is_made_again_replaces_its_row(whole, tmp_path):
    file = tmp_path / "rows.sqlite"
    file.write_bytes(whole.read_bytes())
    store = Store(file, new=True)
    names = {**dict.fromkeys(("case", "integrator", "contact"), "one"), "varied": {}, "command": None}
    store.begin({"commands": [], "columns": {}}, {"command": None}, [(KEYS[0], names)])
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


KILLED = """
import os, signal, sys
from pathlib import Path
import percuss.studies.workers
from percuss.studies.store import Store

def make(path):
    Store(path, new=True).begin({"commands": []}, {"command": None}, [("k", {"varied": {}, "command": None})])

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
    whole = (folder / "rows.sqlite").exists()
    print(number, whole)
    assert not whole or Store(folder / "rows.sqlite").planned() == {"k"}
    make(folder / "rows.sqlite")
    assert Store(folder / "rows.sqlite").planned() == {"k"}
"""


@pytest.mark.skipif(sys.platform == "win32", reason="processes of that system are not forked")
def test_a_kill_in_the_moment_of_making_leaves_a_whole_file_or_none(tmp_path):
    """The process is killed before each of its calls to the system that touches a file."""
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    whole = [line.split()[1] for line in done.stdout.splitlines()]
    assert len(whole) > 4
    assert (whole[0], whole[-1]) == ("False", "True")
