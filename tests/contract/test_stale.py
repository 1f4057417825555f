"""Edits of what a kernel reaches: each is seen by the next process, and an edit of a single file by the next load.

A compiled kernel that does not see an edit is a wrong number that looks right. The quick part asks for the tag under
which machine code is kept; the deep one runs every edit, compiled against plain Python, on a warm cache.
"""

import importlib
import json
import os
import subprocess
import sys

import numpy as np
import pytest

import percuss
from percuss.compiler.fingerprint import layout
from percuss.compiler.specialise import Specialiser
from percuss.methods import source_digest
from strategies import hunek

DEEP = os.environ.get("HYPOTHESIS_PROFILE") == "deep"

LAW = '''
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
from percuss import ContactLaw, hookimpl
IMPORT


class Bound(NamedTuple):
    k: np.ndarray
    other: np.ndarray


@dataclass(frozen=True)
class Spring(ContactLaw):
    """A penalty as a kernel that asks its helpers."""

    name = "spring"
    summary = "Penalty as a kernel"

    def bind(self, points, dt):
        return Bound(0.25 * points.stiffness, 0.125 * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            k = bound.k[p]
            multiplier[p] = EXPRESSION * max(-trial.predicted_gap[p], 0.0)


@hookimpl
def percuss_contacts():
    return [Spring]
'''

NJIT = "from numba import njit\n"
MAKE = "def make(c):\n    {jit}\n    def f(x):\n        return c * x\n    return f\nf = make(1.0)\n"
TUPLE = "from typing import NamedTuple\nclass Q(NamedTuple):\n    c: float\n    d: float\nP = Q(1.0, 2.0)\n"
OVERLOADED = (
    "from numba import njit\nfrom numba.extending import overload\ndef g(x):\n    return 1.0 * x\n@overload(g)\n"
    "def o(x):\n    def i(x):\n        return 1.0 * x\n    return i\n@njit\ndef f(x):\n    return g(x)\n"
)
JITCLASS = (
    "from numba import float64\nfrom numba.experimental import jitclass\n@jitclass([('c', float64)])\nclass S:\n"
    "    def __init__(self, x):\n        self.c = 1.0 * x\n"
)
PLAIN = "def f(x):\n    return 1.0 * x\n"

# what the package's module imports, how its kernel uses it, the helper, and what of it is edited into what
EDITS = {
    "constant": ("from helpers import C", "k * C", "C = 1.0\n", "1.0", "2.0"),
    "constant of a module": ("import helpers as h", "k * h.C", "C = 1.0\n", "1.0", "2.0"),
    "by getattr": ("import helpers as h", "k * getattr(h, 'C')", "C = 1.0\n", "1.0", "2.0"),
    "made when asked for": (
        "import helpers as h", "k * h.C", "def __getattr__(n):\n    if n == 'C':\n        return 1.0\n"
        "    raise AttributeError(n)\n", "1.0", "2.0",
    ),
    "helper": ("from helpers import f", "f(k)", PLAIN, "1.0", "2.0"),
    "helper of a module": ("import helpers as h", "h.f(k)", PLAIN, "1.0", "2.0"),
    "constant of a helper": ("from helpers import f", "f(k)", "C = 1.0\ndef f(x):\n    return C * x\n", "1.0", "2.0"),
    "default": ("from helpers import f", "f(k)", "def f(x, c=1.0):\n    return c * x\n", "1.0", "2.0"),
    "keyword default": ("from helpers import f", "f(k)", "def f(x, *, c=1.0):\n    return c * x\n", "1.0", "2.0"),
    "closure": ("from helpers import f", "f(k)", MAKE.format(jit=""), "1.0", "2.0"),
    "jitted": ("import helpers as h", "h.f(k)", NJIT + "@njit\n" + PLAIN, "1.0", "2.0"),
    "default, jitted": (
        "import helpers as h", "h.f(k)", NJIT + "@njit\ndef f(x, c=1.0):\n    return c * x\n", "1.0", "2.0",
    ),
    "closure, jitted": ("import helpers as h", "h.f(k)", NJIT + MAKE.format(jit="@njit"), "1.0", "2.0"),
    "options, jitted": ("import helpers as h", "h.f(k)", NJIT + "@njit(fastmath=False)\n" + PLAIN, "False", "True"),
    "nested, jitted": (
        "from helpers import f", "f(k)",
        NJIT + "C = 1.0\n@njit\ndef g(x):\n    return C * x\n@njit\ndef f(x):\n    return g(x)\n", "1.0", "2.0",
    ),
    "instead of a nested helper": ("from helpers import f", "f(k)", OVERLOADED, "i(x):\n        return 1.0", None),
    "vectorised": ("from helpers import f", "f(k)", "from numba import vectorize\n@vectorize\n" + PLAIN, "1.0", "2.0"),
    "class, jitted": ("from helpers import S", "S(k).c", JITCLASS, "1.0", "2.0"),
    "in a tuple, jitted": ("import helpers as h", "h.F[0](k)", NJIT + f"@njit\n{PLAIN}F = (f,)\n", "1.0", "2.0"),
    "calls itself": (
        "from helpers import f", "f(k, 3)",
        "def f(x, n):\n    if n == 0:\n        return 1.0 * x\n    return f(x, n - 1)\n", "1.0", "2.0",
    ),
    "calls itself, jitted": (
        "from helpers import f", "f(k, 3)",
        NJIT + "@njit\ndef f(x, n):\n    if n == 0:\n        return 1.0 * x\n    return f(x, n - 1)\n", "1.0", "2.0",
    ),
    "call each other": (
        "from helpers import f", "f(k, 3)",
        "def g(x, n):\n    return f(x, n - 1)\ndef f(x, n):\n    if n == 0:\n        return 1.0 * x\n"
        "    return g(x, n)\n", "1.0", "2.0",
    ),
    "names of arguments": (
        "from helpers import f", "f(a=2.0 * k, b=k)", "def f(a, b):\n    return a - 3.0 * b\n", "f(a, b):\n    return "
        "a - 3.0 * b", "f(b, a):\n    return b - 3.0 * a",
    ),
    "array": ("from helpers import A", "k * A[1]", "import numpy as np\nA = np.array([5.0, 1.0])\n", "1.0", "2.0"),
    "long array": ("import helpers as h", "k * h.A[5000]", "import numpy as np\nA = np.full(9999, 1.0)\n", "1.0", "2."),
    "tuple": ("import helpers as h", "k * h.A[1]", "A = (5.0, 1.0)\n", "1.0", "2.0"),
    "named tuple": ("import helpers as h", "k * h.P.c", TUPLE, "Q(1.0, 2.0)", "Q(2.0, 1.0)"),
    "fields of a named tuple": (
        "import helpers as h", "k * h.P.c", TUPLE, "    c: float\n    d: float\n", "    d: float\n    c: float\n",
    ),
    "default of a named tuple": (
        "from helpers import Q", "k * Q().c",
        "from typing import NamedTuple\nclass Q(NamedTuple):\n    c: float = 1.0\n", "1.0", "2.0",
    ),
    "enumeration": ("from helpers import M", "k * M.C.value", "import enum\nclass M(enum.Enum):\n    C = 1.0\n", "1.0",
                    "2.0"),
    "whole enumeration": ("import helpers as h", "k * h.M.C", "import enum\nclass M(enum.IntEnum):\n    C = 1\n",
                          "= 1", "= 2"),
    "attribute of a class": ("from helpers import K", "k * K.C", "class K:\n    C = 1.0\n", "1.0", "2.0"),
    "dictionary": ("from helpers import D", "k * D['c']", "D = {'c': 1.0}\n", "1.0", "2.0"),
    "partial": (
        "from helpers import f", "f(k)", "import functools\ndef g(c, x):\n    return c * x\n"
        "f = functools.partial(g, 1.0)\n", "1.0", "2.0",
    ),
    "partial, jitted": (
        "from helpers import f", "f(k)", NJIT + "import functools\n@njit\ndef g(c, x):\n    return c * x\n"
        "f = functools.partial(g, 1.0)\n", "1.0", "2.0",
    ),
}  # fmt: skip
# what of these has no content by which it is identified: machine code that reaches them is not kept on disk
UNTOLD = (
    "class, jitted", "partial", "partial, jitted", "instead of a nested helper", "vectorised",
    "in a tuple, jitted", "calls itself, jitted", "calls itself", "call each other",
)  # fmt: skip
QUICK = ["default, jitted", "enumeration"]


MODULES = ("mine", "helpers", "third")


def written(folder, name):
    """Write a package as if installed as editable; return the helper's file and its text before and after the edit."""
    imported, expression, text, old, new = EDITS[name]
    (folder / "mine.py").write_text(LAW.replace("IMPORT", imported).replace("EXPRESSION", expression), encoding="utf-8")
    info = folder / "mine-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[percuss]\nmethods = mine\n")
    helper = folder / "helpers.py"
    helper.write_text(text, encoding="utf-8")
    return helper, text, edited(text, old, new)


def edited(text, old, new):
    assert text.count(old) >= 1
    return text.replace(old, new if new is not None else old.replace("1.0", "2.0"))


def single_file(folder, name):
    """Write a plug-in that holds its helper itself; return its file and its text after the edit."""
    _, expression, helper, old, new = EDITS[name]
    file = folder / "single.py"
    text = LAW.replace("EXPRESSION", expression)
    file.write_text(text.replace("IMPORT", helper), encoding="utf-8")
    return file, text.replace("IMPORT", edited(helper, old, new))


@pytest.fixture
def imported(tmp_path, monkeypatch):
    """Import the package anew, as another process would or as ``importlib.reload`` does; return its law."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # bytecode does not see an edit within the same second

    def do(reload=False):
        for module in MODULES:
            sys.modules.pop(module, None)
        if not reload:
            monkeypatch.setattr(source_digest, "_DIGEST_AT_IMPORT", {})
        importlib.invalidate_caches()
        return importlib.import_module("mine").Spring

    yield do
    for module in MODULES:
        sys.modules.pop(module, None)


def tag_of(kernel):
    """The tag of a kernel, and whether machine code with it may be kept."""
    maker = Specialiser()
    found = maker.tags[id(maker.bind(kernel))]
    return found, found not in maker._unkept


@pytest.mark.parametrize("reload", [False, True], ids=["in another process", "reloaded"])
@pytest.mark.parametrize("name", EDITS)
def test_an_edit_of_a_helper_gives_another_tag(name, reload, tmp_path, imported):
    helper, before, after = written(tmp_path, name)
    first, kept = tag_of(imported().multipliers)
    helper.write_text(after, encoding="utf-8")  # within the second, and of the same size
    second, _ = tag_of(imported(reload).multipliers)
    # a class that is no named tuple, enumeration or jitclass cannot be compiled
    assert second != first or name == "attribute of a class"
    helper.write_text(before, encoding="utf-8")
    assert not kept or tag_of(imported(reload).multipliers) == (first, kept)
    assert kept is (name not in UNTOLD)


def test_the_same_kernel_has_the_same_tag(tmp_path, imported):
    """Also of code that numba has called under a profiler, which changes the flags of the code."""
    written(tmp_path, "helper")
    first = tag_of(imported().multipliers)
    law = imported()
    assert tag_of(law.multipliers) == first
    for function in (law.multipliers, sys.modules["helpers"].f):
        function.__code__ = function.__code__.replace(co_flags=function.__code__.co_flags ^ 3)
    assert tag_of(law.multipliers) == first


def test_a_comment_gives_another_tag(tmp_path, imported):
    """The source of a module counts as a whole, for machine code as for stored runs."""
    helper, before, _ = written(tmp_path, "helper")
    first, _ = tag_of(imported().multipliers)
    helper.write_text(f"# nothing\n{before}")
    assert tag_of(imported().multipliers)[0] != first


def test_a_helper_that_is_replaced_at_run_time(tmp_path, imported, monkeypatch):
    """By a function of another module, by one without a source, and by new code in the same function."""
    written(tmp_path, "helper of a module")
    law = imported()
    first, kept = tag_of(law.multipliers)
    assert kept
    sourceless = {"__name__": "helpers"}
    exec("def f(x):\n    return 3.0 * x\n", sourceless)
    monkeypatch.setattr(sys.modules["helpers"], "f", sourceless["f"])
    second, kept = tag_of(law.multipliers)
    assert second != first
    assert not kept
    monkeypatch.undo()
    monkeypatch.setattr(sys.modules["helpers"].f, "__code__", sourceless["f"].__code__)
    third, kept = tag_of(law.multipliers)
    assert third != first
    assert not kept


def test_a_function_without_a_source_is_compiled_and_not_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    names = {"__name__": "__console__", "C": 2.0}
    exec("def f(x):\n    return C * x\n", names)
    assert Specialiser().bind(names["f"], entry=True)(3.0) == 6.0
    names["C"] = 4.0
    assert Specialiser().bind(names["f"], entry=True)(3.0) == 12.0
    assert not tag_of(names["f"])[1]


def test_a_helper_of_a_helper_and_one_reached_by_two_ways(tmp_path, imported):
    helper, _, _ = written(tmp_path, "helper of a module")
    helper.write_text(
        NJIT + "import third as t\n@njit\ndef g(x):\n    return t.D * x\n@njit\ndef f(x):\n    return t.C * g(x)\n"
    )
    tags = set()
    for text in ("C = 1.0\nD = 1.0\n", "C = 2.0\nD = 1.0\n", "C = 1.0\nD = 2.0\n"):
        (tmp_path / "third.py").write_text(text)
        tags.add(tag_of(imported(reload=True).multipliers)[0])
    assert len(tags) == 3


def test_fields_of_bound_arrays_count():
    """Machine code on disk knows the class of a bound tuple by its name, and a field by its place."""
    from collections import namedtuple

    one = namedtuple("Bound", "k other")(1.0, 2.0)
    two = namedtuple("Bound", "other k")(1.0, 2.0)
    assert layout((one,)) != layout((two,))
    kernel = layout
    tags = {about: Specialiser(about=about) for about in (layout(one), layout(two))}
    assert len({maker.tags[id(maker.bind(kernel))] for maker in tags.values()}) == 2


RUNS = """
import json, sys, percuss
case, files = json.loads(sys.argv[1]), sys.argv[2:3]
out = []
for text in sys.argv[3:] or [None]:
    if text is not None:
        open(files[0], "w", encoding="utf-8").write(text)
    for compiled in (True, False):
        result = percuss.run(percuss.load(case, plugins=files), compiled=compiled)
        out.append(result.arrays["contact_force"].max())
print(json.dumps(out))
"""


def ran(folder, *arguments):
    """Run a case in another process; return the largest forces, compiled and plain, for each text of the plug-in."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(folder)}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # bytecode does not see an edit within the same second
    environment.pop("NUMBA_DISABLE_JIT", None)
    case = json.dumps(hunek(10, contact="spring", end=0.3))
    command = [sys.executable, "-c", RUNS, case, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    forces = np.array(json.loads(done.stdout)).reshape(-1, 2)
    assert forces[:, 0] == pytest.approx(forces[:, 1], rel=1e-11)
    return forces[:, 1]


@pytest.mark.deep
@pytest.mark.parametrize("name", EDITS if DEEP else QUICK)
def test_an_edit_of_a_package_is_seen_by_the_next_process(name, tmp_path):
    """Which finds machine code of the helper as it was on disk."""
    helper, before, after = written(tmp_path, name)
    first = ran(tmp_path)
    helper.write_text(after, encoding="utf-8")
    other = ran(tmp_path)
    helper.write_text(before, encoding="utf-8")
    assert ran(tmp_path) == pytest.approx(first, rel=1e-11)
    assert name == "options, jitted" or abs(first - other) > 1e-6


@pytest.mark.deep
@pytest.mark.parametrize("name", ["helper", "jitted", "closure"] if DEEP else ["helper"])
def test_an_edit_of_a_single_file_is_seen_by_the_next_load(name, tmp_path):
    """In the process that ran the file as it was, and in one that finds its machine code on disk."""
    file, after = single_file(tmp_path, name)
    before = file.read_text(encoding="utf-8")
    both = ran(tmp_path, file, before, after)
    assert abs(both[0] - both[1]) > 1e-6
    assert ran(tmp_path, file, after, before) == pytest.approx(both[::-1], rel=1e-11)


@pytest.mark.deep
def test_a_case_loaded_before_the_edit_keeps_what_it_was_loaded_with(tmp_path):
    file, after = single_file(tmp_path, "helper")
    case = percuss.load(hunek(10, contact="spring", end=0.3), plugins=[file])
    old = percuss.run(case, compiled=False).arrays["contact_force"].max()
    file.write_text(after, encoding="utf-8")
    new = percuss.load(hunek(10, contact="spring", end=0.3), plugins=[file])
    assert percuss.run(new, compiled=False).arrays["contact_force"].max() != old
    assert percuss.run(case, compiled=False).arrays["contact_force"].max() == old
