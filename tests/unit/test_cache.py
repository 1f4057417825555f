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


def test_nobody_else_reads_the_folder(folder):
    assert cache.cache_folder() == folder
    assert os.name != "posix" or stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_there_is_none_where_it_cannot_be_made(folder):
    folder.parent.write_text("a file in its place")
    assert cache.cache_folder() is None
