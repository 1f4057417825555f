"""The cache folder: it is made for its user alone, and a run needs none."""

import os
import stat

import pytest

from percuss import cache


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The cache folder of a test, which is not made yet."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "own"))
    return tmp_path / "own" / "percuss"


def test_what_is_kept_is_found_and_nobody_else_reads_it(folder):
    assert cache.kept("name") is None
    cache.keep("name", b"content")
    assert cache.kept("name") == b"content"
    assert [file.name for file in folder.iterdir()] == ["name"]
    assert os.name != "posix" or stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_where_no_folder_can_be_made_nothing_is_kept(folder):
    folder.parent.write_text("a file in its place")
    cache.keep("name", b"content")
    assert cache.kept("name") is None
    assert cache.cache_folder() is None


def test_a_folder_that_cannot_be_written_to_keeps_nothing(folder, monkeypatch):
    folder.mkdir(parents=True)
    (folder / "name").mkdir()  # in the place of the file, as the superuser may write to every folder
    cache.keep("name", b"content")
    assert cache.kept("name") is None
