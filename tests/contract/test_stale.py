"""Edits of what a single-file plug-in reaches: each is seen by the next load, in this process and in another.

A compiled kernel that does not see an edit is a wrong number that looks right. The quick part asks for the tag under
which machine code is kept; the deep one runs every edit, compiled against plain Python, on a warm cache.
"""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

import percuss
from percuss.methods.registry import Registry
from percuss.solver.compiler.fingerprint import Fingerprint, layout
from percuss.solver.compiler.specialise import Specialiser
from strategies import hunek

DEEP = os.environ.get("HYPOTHESIS_PROFILE") == "deep"

LAW = '''
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
from percuss import ContactLaw
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
        return BOUND(0.25 * points.stiffness, 0.125 * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            k = bound.k[p]
            multiplier[p] = EXPRESSION * max(-trial.predicted_gap[p], 0.0)
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

# what the plug-in imports, how its kernel uses it, the helper, and what of it is edited into what
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
    "in the place of a nested helper": ("from helpers import f", "f(k)", OVERLOADED, "i(x):\n        return 1.0", None),
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
# what of these numba compiles has no hash: machine code that reaches them is not kept on disk
UNTOLD = (
    "class, jitted", "partial", "partial, jitted", "in the place of a nested helper", "vectorised",
    "in a tuple, jitted", "calls itself, jitted",
)  # fmt: skip
QUICK = ["default, jitted", "enumeration"]


def written(folder, name, bound="Bound"):
    """Write plug-in and helper; return the plug-in, the helper's file and its text before and after the edit."""
    imported, expression, text, old, new = EDITS[name]
    law = LAW.replace("IMPORT", imported).replace("EXPRESSION", expression).replace("BOUND", bound)
    file, helper = folder / "mine.py", folder / "helpers.py"
    file.write_text(law, encoding="utf-8")
    helper.write_text(text, encoding="utf-8")
    assert text.count(old) >= 1
    after = text.replace(old, new if new is not None else old.replace("1.0", "2.0"))
    return file, helper, text, after


@pytest.fixture(autouse=True)
def path_as_it_was(monkeypatch):
    """The plug-ins here put their folder on the path."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield
    sys.modules.pop("helpers", None)
    sys.modules.pop("third", None)


def tag(file):
    """The tag of a kernel, and whether machine code with it may be kept."""
    maker = Specialiser()
    law = Registry.load([file]).get("contacts", "spring")
    found = maker.tags[id(maker.bind(law.multipliers))]
    return found, found not in maker._unhashed


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_of_a_helper_gives_another_tag(name, tmp_path):
    file, helper, before, after = written(tmp_path, name)
    first, kept = tag(file)
    assert tag(file) == (first, kept)
    helper.write_text(after, encoding="utf-8")  # within the second, and of the same size
    second, _ = tag(file)
    assert second != first
    helper.write_text(before, encoding="utf-8")
    assert tag(file)[0] == first
    assert kept is (name not in UNTOLD)


@pytest.mark.parametrize("name", EDITS)
def test_the_content_alone_tells_an_edit(name, tmp_path):
    """The same with the name of the plug-in's module left out, which an edit changes too."""

    def printed():
        found = Fingerprint("")
        found.function(Registry.load([file]).get("contacts", "spring").multipliers)
        return found.whole, found.tag

    file, helper, _, after = written(tmp_path, name)
    whole, first = printed()
    helper.write_text(after, encoding="utf-8")
    # a class that is no named tuple, enumeration or jitclass cannot be compiled
    assert printed()[1] != first or not whole or name == "attribute of a class"


def test_a_helper_of_a_helper_and_one_reached_by_two_ways(tmp_path):
    written(tmp_path, "constant")
    third = tmp_path / "third.py"
    (tmp_path / "helpers.py").write_text(
        NJIT + "import third as t\n@njit\ndef g(x):\n    return t.D * x\n@njit\ndef f(x):\n    return t.C * g(x)\n"
    )
    file = tmp_path / "mine.py"
    file.write_text(LAW.replace("IMPORT", "import helpers as h").replace("EXPRESSION", "h.f(k)"))
    tags = set()
    for text in ("C = 1.0\nD = 1.0\n", "C = 2.0\nD = 1.0\n", "C = 1.0\nD = 2.0\n"):
        third.write_text(text)
        tags.add(tag(file)[0])
    assert len(tags) == 3


def test_helpers_count_in_the_version_of_a_plug_in(tmp_path):
    file, helper, before, after = written(tmp_path, "constant")

    def version():
        return Registry.load([file]).sources["contacts", "spring"].version

    first = version()
    helper.write_text(after)
    assert version() != first
    helper.write_text(before)
    assert version() == first


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
import sys, json, pathlib, percuss
case, file, helper = json.loads(sys.argv[1]), sys.argv[2], pathlib.Path(sys.argv[3])
out = []
for text in sys.argv[4:]:
    helper.write_text(text)
    for compiled in (True, False):
        result = percuss.run(percuss.load(case, plugins=[file]), compiled=compiled)
        out.append(result.arrays["contact_force"].max())
print(json.dumps(out))
"""


@pytest.mark.deep
@pytest.mark.parametrize("name", EDITS if DEEP else QUICK)
def test_an_edit_is_seen_by_the_next_run(name, tmp_path):
    """In the process that ran the helper as it was, and in one that finds its machine code on disk."""
    file, helper, before, after = written(tmp_path, name)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment.pop("NUMBA_DISABLE_JIT", None)

    def ran(*texts):
        command = [sys.executable, "-c", RUNS, json.dumps(hunek(10, contact="spring", end=0.3)), str(file), str(helper)]
        done = subprocess.run([*command, *texts], capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 0, done.stderr
        return np.array(json.loads(done.stdout)).reshape(-1, 2)

    first = ran(before)
    other = ran(after)
    both = ran(before, after)
    for found in (first, other, both):
        assert found[:, 0] == pytest.approx(found[:, 1], rel=1e-11)
    assert both == pytest.approx(np.concatenate([first, other]), rel=1e-11)
    assert name == "options, jitted" or abs(first[0, 1] - other[0, 1]) > 1e-6


@pytest.mark.deep
def test_a_case_loaded_before_the_edit_keeps_what_it_was_loaded_with(tmp_path):
    file, helper, _, after = written(tmp_path, "helper")
    case = percuss.load(hunek(10, contact="spring", end=0.3), plugins=[file])
    old = percuss.run(case, compiled=False).arrays["contact_force"].max()
    helper.write_text(after, encoding="utf-8")
    new = percuss.load(hunek(10, contact="spring", end=0.3), plugins=[file])
    assert percuss.run(new, compiled=False).arrays["contact_force"].max() != old
    assert percuss.run(case, compiled=False).arrays["contact_force"].max() == old
