"""What percuss stands on: every dependency is justified, and none has a licence that binds who uses it."""

import re
import tomllib
from importlib import metadata

from packaging.requirements import Requirement

import lowest
import pages
import places

EXTRAS = ("plot", "study", "kit")  # those for users
# Licences that ask for no more than their text: of Mozilla's the files themselves stay free, and percuss changes none.
ALLOWED = {
    "0BSD", "Apache-2.0", "BSD", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "ISC", "LLVM-exception", "MIT", "MIT-CMU",
    "MPL-2.0", "PSF-2.0", "Unlicense", "Zlib",
}  # fmt: skip
# The same in the words of metadata older than licence expressions.
WORDS = {
    "Apache 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "The Unlicense (Unlicense)": "Unlicense",
}


def licences(about):
    """Return the licences in the metadata of a distribution: its expression, its classifiers, or else its text."""
    expression = about.get("License-Expression")
    if expression:
        return set(re.findall(r"[\w.-]+", expression)) - {"AND", "OR", "WITH"}
    classifiers = [line.split(" :: ") for line in about.get_all("Classifier") or ()]
    found = {parts[-1] for parts in classifiers if parts[0] == "License" and parts[-1] != "OSI Approved"}
    return {WORDS.get(name, name) for name in found or {about.get("License") or "none given"}}


def stands_on(name, extras, found):
    """Add a distribution, and recursively all that it needs where it is installed, to `found`."""
    distribution = metadata.distribution(name)
    if found.get(name, set()) >= {"", *extras}:
        return
    found.setdefault(name, set()).update({"", *extras})
    for line in distribution.requires or ():
        need = Requirement(line)
        if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            stands_on(need.name, need.extras, found)


def test_the_licence_of_all_that_percuss_stands_on_is_a_permissive_one():
    found = {}
    stands_on("percuss", EXTRAS, found)
    assert {"numpy", "numba", "llvmlite", "pandas", "matplotlib", "dask"} <= set(found)
    # Pebble may be used by programs of any licence, as long as its own source stays open: percuss imports it as it is.
    refused = {name: licences(metadata.metadata(name)) - ALLOWED for name in found if name != "pebble"}
    assert not {name: names for name, names in refused.items() if names}


PROJECT = tomllib.loads((places.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DECLARED = [*lowest.declared(PROJECT), *(name for extra in EXTRAS for name in lowest.declared(PROJECT, extra))]


def test_every_dependency_is_justified():
    rows = re.findall(r"^\| `([\w-]+)` \| (.+) \| [\d.]+ \|$", pages.section("## Dependencies"), re.MULTILINE)
    assert [name for name, _ in rows] == DECLARED


def test_every_dependency_has_a_lowest_version():
    bounds = lowest.declared(PROJECT) | lowest.declared(PROJECT, "test")
    assert len(bounds) > 18
    assert None not in bounds.values()
    assert f"numba=={bounds['numba']}" in lowest.constraints(PROJECT)
