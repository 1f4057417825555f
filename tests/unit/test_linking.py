"""Kernels called by address: the blocks of memory that they read, and the calls themselves."""

import ctypes
import gc
import weakref
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba import types

import percuss
from percuss.compiler import specialise
from percuss.compiler.machine_code import CannotLink, jit_disabled
from percuss.march.march import March
from percuss.march.model import Model
from percuss.step.calls import at, call, form_of
from percuss.step.linking import Block, structure
from strategies import REGISTRY, hunek


class Inner(NamedTuple):
    flag: bool
    table: np.ndarray
    small: np.int8
    word: np.uint32
    sure: np.bool


class Data(NamedTuple):
    number: float
    inner: Inner
    single: np.float32
    pair: tuple[int, int]
    phase: complex
    column: np.ndarray
    nothing: tuple[()]


def weighed(data):
    """Return a number to which every part of the data contributes with a weight of its own."""
    total = 2.0 * data.number + 3.0 * data.inner.small + 5.0 * data.single
    if data.inner.flag:
        total += 7.0
    if data.inner.sure:
        total += 2.0**20
    total += 2.0**-20 * data.inner.word
    for i in range(data.inner.table.shape[0]):
        for j in range(data.inner.table.shape[1]):
            total += (11.0 + 3 * i + j) * data.inner.table[i, j]
    for i in range(data.column.size):
        total += (101.0 + i) * data.column[i]
    return total + 211.0 * data.pair[0] + 223.0 * data.pair[1] + 227.0 * data.phase.real + 229.0 * data.phase.imag


@pytest.mark.parametrize("flag", [True, False])
def test_compiled_code_reads_from_a_block_what_was_put_into_it(flag):
    column = np.arange(12.0).reshape(4, 3)[:, 1]
    column.flags.writeable = False
    inner = Inner(flag, np.array([[1.5, -2.0], [0.25, 8.0]]), np.int8(-3), np.uint32(2**32 - 5), np.bool(not flag))
    data = Data(0.5, inner, np.float32(1.25), (4, -5), 2.0 - 3.0j, column, ())
    helper = numba.njit(weighed)
    kind = types.CPointer(numba.typeof(data))
    read = numba.cfunc(types.float64(kind))(lambda place: helper(at(place)))
    block = Block(data, form_of(numba.typeof(data), helper.targetctx))
    assert ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p)(read.address)(block.address) == weighed(data)


def test_other_values_are_refused():
    masked = np.ma.array([1.0, 2.0], mask=[True, False])
    for value in ("a text", None, [1.0], (1.0, {"a": 1}), np.longdouble(1.0), 2**63, -(2**63) - 1, masked):
        with pytest.raises(CannotLink, match=r"not an? "):
            structure((1.0, value))


def test_values_of_one_structure_have_one_type():
    """And values of another type have another structure."""
    line = np.arange(6.0)
    fixed = line[:]
    fixed.flags.writeable = False
    values = [
        1, 1.0, True, 1j, np.int8(1), np.float32(1.0), (), (1,), (1, 1), (1, (1,)),
        Inner(True, line, np.int8(1), np.uint32(1), np.True_),
        line, fixed, line[::2], line.reshape(2, 3), line.reshape(2, 3).T, line.astype(np.int64), line.view(np.recarray),
        np.zeros(2, dtype=[("a", "f8"), ("b", "i8")]), np.zeros(2, dtype=[("a", "f8"), ("c", "i8")]),
        np.zeros(2, dtype=np.dtype([("a", "f8"), ("b", "i8")], align=True)), np.uint8(1), np.True_, 2**62,
    ]  # fmt: skip
    others = [
        2,
        2.5,
        False,
        3j,
        np.int8(2),
        np.float32(0.5),
        (),
        (3,),
        (2, 3),
        (3, (4,)),
        Inner(False, line + 1, 4, 5, False),
    ]
    for one in values:
        for other in [*values, *others]:
            same_type = numba.typeof(one) == numba.typeof(other)
            assert same_type or structure(one) != structure(other), (one, other)


def test_a_call_with_other_arguments_than_declared_is_not_compiled():
    line = np.zeros(4)
    for arguments in ((1.0, line, line), (1, line, line[::2]), (1, line)):
        with pytest.raises(numba.TypingError, match="internal forces of a stage: the arguments"):
            numba.njit(lambda given: call("internal forces of a stage", 0, 0, given))(arguments)


TEXT = """
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
from percuss.methods.interfaces import ContactLaw

class Bound(NamedTuple):
    stiffness: np.ndarray
    mode: str

@dataclass(frozen=True)
class Law(ContactLaw):
    \"\"\"A penalty whose data contain a text.\"\"\"

    name = "with-text"
    summary = "a penalty"

    def bind(self, points, dt):
        return Bound(0.25 * points.stiffness, "plain")

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = bound.stiffness[p] * max(-trial.gap[p], 0.0)
"""


@pytest.mark.slow
def test_a_law_whose_data_compiled_code_cannot_read_runs_in_python_and_says_why(tmp_path):
    file = tmp_path / "law.py"
    file.write_text(TEXT)
    runs = {}
    for law in ("with-text", {"name": "penalty", "beta_s": 0.25}):
        case = percuss.load(hunek(6, integrator="central-difference", contact=law, end=0.1), plugins=[file])
        runs[str(law)] = percuss.run(case)
    result, truth = runs.values()
    assert result.summary["compiled"] is False
    assert "not a str" in result.summary["compiled_why"][0]
    assert truth.summary["compiled"] is True
    peak = truth.arrays["contact_force"].max()
    assert np.abs(result.arrays["contact_force"] - truth.arrays["contact_force"]).max() < 1e-12 * peak


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["central-difference", "noh-bathe"])
def test_a_loop_that_is_kept_for_the_next_run_keeps_no_arrays_of_this_one(integrator):
    model = Model(percuss.load(hunek(6, integrator=integrator, end=0.1)))
    march = March(model)
    march.run()
    references = [
        weakref.ref(march.u),
        weakref.ref(march.arrays.blocks[0][0].start),
        weakref.ref(march.arrays.step.boundary),
    ]
    del march
    gc.collect()
    assert [reference() for reference in references] == [None] * 3


STRIDED = """
from dataclasses import dataclass
import numpy as np
from percuss import Integrator, Stages, accelerations

@dataclass(frozen=True)
class Verlet(Integrator):
    \"\"\"Velocity Verlet that asks for accelerations in every second entry of an array.\"\"\"

    name = "strided"
    summary = "velocity Verlet"
    critical_courant = 1.0
    kept = 1

    def bind(self, dt):
        return Stages(times=(1.0,))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        v += 0.5 * dt * kept[0]
        u += dt * v
        both = np.zeros((u.size, 2))
        accelerations(system, 0, u, v, both[:, 0])
        kept[0, :] = both[:, 0]
        v += 0.5 * dt * kept[0]
"""


@pytest.mark.deep
def test_a_scheme_that_asks_for_accelerations_in_a_strided_array_runs_in_python_and_says_why(tmp_path):
    file = tmp_path / "scheme.py"
    file.write_text(STRIDED)
    case = hunek(4, integrator="strided", contact={"name": "penalty", "beta_s": 0.25}, end=0.05)
    result = percuss.run(percuss.load(case, plugins=[file]))
    assert result.summary["compiled"] is False
    (why,) = result.summary["compiled_why"]
    assert "integrator strided" in why
    assert "accelerations of a stage" in why


def test_a_layout_of_the_loop_is_part_of_every_tag(monkeypatch):
    """Machine code reads the fields of the loop's tuples by position."""
    specialise._versions.cache_clear()
    before = specialise._versions()
    monkeypatch.setattr(
        specialise, "content_digest", lambda content: "another digest" if b"class Bulk" in content else ""
    )
    specialise._versions.cache_clear()
    assert specialise._versions() != before
    specialise._versions.cache_clear()


SCHEMES = [{"method.integrator": name} for name in REGISTRY.names("integrators")]
BODIES = [
    *({"bodies.short.element": name} for name in REGISTRY.names("elements")),
    {"bodies.short.material": {"name": "bilinear-plastic", "young": 100.0, "density": 0.01, "yield_stress": 0.02}},
]
ALL = [
    *({"method.contact": name} for name in REGISTRY.names("contacts")),
    *({"method.mass": name} for name in REGISTRY.names("masses")),
    *(scheme | bodies for scheme in SCHEMES for bodies in BODIES),
]
# Each scheme with bars, and two of them with each element and material; each other pair is compiled for seconds.
EACH = ("central-difference", "noh-bathe")


def is_deep(changes):
    """Whether a pair of scheme and bodies is left to the whole check."""
    bodies = changes.get("bodies.short.element", "bar"), "bodies.short.material" in changes
    return bodies != ("bar", False) and changes.get("method.integrator", EACH[0]) not in EACH


def words(changes):
    return " ".join(value if isinstance(value, str) else value["name"] for value in changes.values())


@pytest.mark.skipif(jit_disabled(), reason="compilation is switched off")
@pytest.mark.parametrize(
    "changes",
    [pytest.param(changes, marks=pytest.mark.deep if is_deep(changes) else ()) for changes in ALL],
    ids=words,
)
def test_every_registered_method_is_compiled(changes):
    """Plain Python gives the same numbers, a hundred times slower: nothing else would show that a kernel is none."""
    base = hunek(4, integrator="central-difference", contact="penalty", end=0.05)
    try:
        result = percuss.run(percuss.load(base, changes))
    except (percuss.RefusedPair, percuss.InputError):
        pytest.skip("refused")
    assert result.summary["compiled"], result.summary["compiled_why"]
