"""The cache folder: what is damaged in it is not believed, and it is not used where others can write to it."""

import json
import os
import random
import shutil
import stat
import subprocess
import sys
import time

import pytest

from percuss import cache
from percuss.compiler import specialise
from percuss.compiler.specialise import Specialiser
from places import CASES

DAMAGES = ["emptied", "halved", "another byte", "swapped"]
others_can_write = pytest.mark.skipif(not hasattr(os, "getuid"), reason="folders of this system have no such rights")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The cache folder of a test; nothing is known of folders that were used before."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "own"))
    cache._made.cache_clear()
    cache._tidy.cache_clear()
    return tmp_path / "own" / "percuss"


def damage(files, how, seed=0):
    """Damage all these files, each in its own way."""
    draw, contents = random.Random(f"{how} {seed}"), [file.read_bytes() for file in files]
    for k, file in enumerate(files):
        content = bytearray(contents[k])
        content[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
        file.write_bytes(
            {
                "emptied": b"",
                "halved": contents[k][: len(content) // 2],
                "another byte": content,
                "swapped": contents[k - 1],
            }[how]
        )


@pytest.mark.parametrize("how", DAMAGES)
def test_a_damaged_file_is_removed_and_made_again(folder, how):
    contents = {f"{k}.kind": bytes([k]) * k for k in range(1, 11)}
    for seed in range(10):
        for name, content in contents.items():
            cache.keep(name, content)
            assert cache.kept(name) == content
        damage(sorted(folder.iterdir()), how, seed)
        assert [cache.kept(name) for name in contents] == [None] * len(contents)
        assert not list(folder.iterdir())


def _halved(x):
    return 0.5 * x


def _moved(x):
    return _halved(x) + 1.0


@pytest.mark.parametrize("how", DAMAGES)
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.deep) for seed in range(1, 6))])
def test_damaged_machine_code_and_intermediate_code_are_compiled_again(folder, monkeypatch, how, seed):
    def answer():
        monkeypatch.setattr(specialise, "_COMPILED", {})
        kernel = Specialiser().bind(_moved, entry=True)
        return kernel(3.0), kernel(3), sum(kernel.stats.cache_hits.values())

    assert answer() == (2.5, 2.5, 0)
    assert answer() == (2.5, 2.5, 2)
    whole = {file.name for file in folder.iterdir()}
    damage(sorted(folder.glob("*.compiled")), how, seed)
    assert answer() == (2.5, 2.5, 0)
    assert {file.name for file in folder.iterdir()} == whole
    assert answer() == (2.5, 2.5, 2)


def test_what_killed_processes_leave_behind_is_in_nobodys_way(folder):
    cache.keep("first", b"1")
    cache._tidy.cache_clear()
    old, young = (folder / f".second.{name}{cache.TEMPORARY}" for name in ("old", "young"))
    for file in (old, young):
        file.write_bytes(b"half of")
    os.utime(old, (time.time() - 2 * cache.ABANDONED_AFTER,) * 2)
    (folder / "second.lock").touch()
    assert cache.kept("second") is None
    cache.keep("second", b"2")
    assert (cache.kept("first"), cache.kept("second")) == (b"1", b"2")
    assert young.exists()
    assert not old.exists()


@others_can_write
@pytest.mark.parametrize("mode", [None, 0o755, 0o555])
def test_the_folder_is_private(folder, mode):
    """It is made so whatever the mask is, with those above it, or becomes so where others could only read it."""
    if mode is not None:
        folder.mkdir(parents=True)
        folder.chmod(mode)
    before = os.umask(0)
    try:
        cache.keep("name", b"content")
    finally:
        os.umask(before)
    assert stat.S_IMODE(folder.stat().st_mode) == (mode or 0o700) & 0o700
    assert cache.kept("name") == b"content" or not os.access(folder, os.W_OK)
    assert mode is not None or stat.S_IMODE(folder.parent.stat().st_mode) == 0o700


@others_can_write
@pytest.mark.parametrize("place", ["folder", "parent"])
@pytest.mark.parametrize("how", ["all", "group", "sticky", "owner"])
def test_a_folder_that_others_can_change_is_not_used(folder, capsys, monkeypatch, tmp_path, place, how):
    cache.keep("name", b"content")
    cache._made.cache_clear()
    at = folder if place == "folder" else folder.parent
    if how != "owner":
        at.chmod({"all": 0o777, "group": 0o770, "sticky": 0o1777}[how])
    elif os.getuid() == 0:
        os.chown(at, 12345, -1)
    else:
        monkeypatch.setattr(os, "getuid", lambda: 12345)
        at = tmp_path
    if (place, how) == ("parent", "sticky"):  # where others cannot replace what is the user's
        assert cache.kept("name") == b"content"
        assert not capsys.readouterr().err
        return
    assert cache.kept("name") is None
    cache.keep("other", b"content")
    assert [file.name for file in folder.iterdir()] == ["name"]
    (note,) = capsys.readouterr().err.splitlines()
    assert note.startswith(f"note: the cache folder {folder} is not used, because")
    assert how == "owner" or f" another user owns {at} or can write to it. " in note


@others_can_write
def test_a_link_is_as_good_as_where_it_leads(folder, capsys, tmp_path):
    elsewhere, open_to_all = tmp_path / "elsewhere", tmp_path / "open"
    for made in (elsewhere, open_to_all, folder.parent):
        made.mkdir()
    open_to_all.chmod(0o777)
    folder.symlink_to(elsewhere)
    cache.keep("name", b"content")
    assert [file.name for file in elsewhere.iterdir()] == ["name"]
    # a link that another user may have made leads somewhere else afterwards
    folder.unlink()
    folder.symlink_to(open_to_all)
    assert cache.kept("name") == b"content"
    cache._made.cache_clear()
    assert cache.kept("name") is None
    assert f"owns {open_to_all} or" in capsys.readouterr().err


@others_can_write
@pytest.mark.parametrize("command", ["run", pytest.param("study", marks=pytest.mark.deep)])
def test_a_command_says_once_that_it_does_not_use_the_folder(tmp_path, command):
    open_to_all = tmp_path / "open"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    study = tmp_path / "study.yaml"
    study.write_text(f"percuss-study: 1\ncases: [{CASES / 'hunek.yaml'}]\nvary: {{refine: [1, 2]}}\n", encoding="utf-8")
    words = [str(CASES / "hunek.yaml"), "--exact-only"] if command == "run" else [str(study), "--workers", "2"]
    done = subprocess.run(
        [sys.executable, "-m", "percuss", command, *words],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "NUMBA_CACHE_DIR": str(open_to_all), "NUMBA_DISABLE_JIT": "1"},
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("note: the cache folder") == 1
    assert "Traceback" not in done.stderr
    assert not [each for each in open_to_all.rglob("*") if each.is_file()]


# -------------------------------------------------------------------------------------------------- a whole command


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """The cache folder after a run, and the numbers of this run."""
    parent = tmp_path_factory.mktemp("warm")
    return parent, summary(parent)


def summary(parent):
    """The numbers of a run of a case, which uses a cache folder in `parent`."""
    done = subprocess.run(
        [sys.executable, "-m", "percuss", "run", str(CASES / "hunek.yaml"), "--json"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "NUMBA_CACHE_DIR": str(parent)},
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "Aborted" not in done.stderr
    return {name: value for name, value in json.loads(done.stdout).items() if name != "seconds"}


@pytest.mark.deep
@pytest.mark.parametrize("how", DAMAGES)
def test_no_file_of_a_run_is_believed_when_it_is_damaged(folder, warm, how):
    for seed in range(5):
        shutil.copytree(warm[0] / "percuss", folder, dirs_exist_ok=True)
        files = sorted(file for file in folder.iterdir() if file.stat().st_size)
        assert {file.suffix for file in files} == {".code", ".compiled", ".imports"}
        damage(files, how, seed)
        assert [file.name for file in files if cache.kept(file.name) is not None] == []


@pytest.mark.deep
@pytest.mark.parametrize("how", DAMAGES)
def test_no_damage_changes_a_run(folder, warm, how):
    """Each file is read, as those made from it are damaged too; all are there again afterwards."""
    shutil.copytree(warm[0] / "percuss", folder)
    damage(sorted(file for file in folder.iterdir() if file.stat().st_size), how)
    assert summary(folder.parent) == warm[1]
    names = {file.name for file in folder.iterdir() if file.suffix != ".lock"}
    assert names == {file.name for file in (warm[0] / "percuss").iterdir() if file.suffix != ".lock"}
    assert [name for name in names if cache.kept(name) is None] == []
