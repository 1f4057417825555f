"""The digest of sources: an edit gives another one, for a package as for a single file, in the next process."""

from pathlib import Path

import pytest

import percuss
from percuss import digest
from percuss.methods.provenance import Provenance


def digest_of(file):
    """The digest of a file as a new process finds it."""
    digest._package_digest.cache_clear()
    digest.source_digest.cache_clear()
    return digest.source_digest(str(file))


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "theirs" / "laws"
    folder.mkdir(parents=True)
    for file in (folder.parent / "__init__.py", folder / "__init__.py", folder / "mine.py", folder.parent / "util.py"):
        file.write_text("A = 1\n")
    return folder


def test_an_edit_of_any_file_of_a_package_gives_another_digest(package):
    method = package / "mine.py"
    first = digest_of(method)
    assert digest_of(package.parent / "util.py") == first  # there is one a package
    for file in (package.parent / "util.py", package / "__init__.py", method):
        before = file.read_text()
        file.write_text("A = 2\n")
        assert digest_of(method) != first
        file.write_text(before)
        assert digest_of(method) == first
    (package / "notes.txt").write_text("none of it")
    assert digest_of(method) == first
    (package / "another.py").write_text("")
    assert digest_of(method) != first


def test_a_process_has_the_digest_of_what_it_has_imported(package):
    method = package / "mine.py"
    first = digest_of(method)
    method.write_text("A = 2\n")
    assert digest.source_digest(str(method)) == first


def test_a_file_in_no_package_counts_by_itself(package, tmp_path):
    alone, other = tmp_path / "alone.py", tmp_path / "other.py"
    alone.write_text("A = 1\n")
    first = digest_of(alone)
    other.write_text("A = 1\n")
    assert digest_of(alone) == first
    alone.write_text("A = 2\n")
    assert digest_of(alone) != first
    assert digest_of("") == digest_of("<stdin>") != first


def test_the_version_and_the_text_of_a_single_file_count(package):
    file = str(package / "mine.py")
    installed = Provenance("theirs", "1.0", "theirs.laws.mine", file)
    assert installed.digest != Provenance("theirs", "1.1", "theirs.laws.mine", file).digest
    assert Provenance("", "0123", "percuss_file_mine", file).digest != Provenance("", "4567", "other", file).digest


def test_the_loop_of_percuss_has_a_digest_of_its_own():
    folder = Path(percuss.__file__).parent
    for file in ("step/loop.py", "mesh/cell_kernels.py", "methods/slots.py"):
        assert digest.source_digest(str(folder / file)) == digest.loop_digest()
    assert digest.source_digest(str(folder / "march" / "march.py")) == digest.own_digest() != digest.loop_digest()
