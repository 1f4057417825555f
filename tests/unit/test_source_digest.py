"""What a source imports and names is found once and kept, until the source changes."""

import pytest

from percuss import cache
from percuss.methods import source_digest

CONTENT = b"import numpy as np\nfrom . import beside\nTABLE = 'table.csv'\n"


@pytest.fixture
def kept(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "cache_folder", lambda: tmp_path)
    source_digest.imports_and_texts.cache_clear()
    yield tmp_path
    source_digest.imports_and_texts.cache_clear()


def found(content=CONTENT, package="mine"):
    source_digest.imports_and_texts.cache_clear()
    return source_digest.imports_and_texts(content, package)


def test_what_is_kept_is_what_was_found(kept, monkeypatch):
    expected = source_digest._parsed(CONTENT, "mine")
    assert [statement.module for statement in expected[0]] == ["numpy", "mine"]
    assert expected[1] == ("table.csv",)
    assert found() == expected
    assert len(list(kept.iterdir())) == 1
    monkeypatch.setattr(source_digest, "_parsed", None)
    assert found() == expected


def test_other_text_and_another_package_are_other_sources(kept):
    assert found(CONTENT + b"import os\n") != found()
    assert found(package="yours") != found()
    assert len(list(kept.iterdir())) == 3


def test_a_folder_that_cannot_be_made_is_no_obstacle(tmp_path, monkeypatch):
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setattr(cache, "cache_folder", lambda: tmp_path / "file")
    assert found() == source_digest._parsed(CONTENT, "mine")
