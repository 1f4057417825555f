"""Kernels called by address: the blocks of memory that they read, and the calls themselves."""

import ctypes
import gc
import weakref
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core import types

import percuss
from percuss.solver.compiler.linking import Block, CannotLink, at, call, form_of, structure
from percuss.solver.march import March
from percuss.solver.model import Model
from strategies import hunek


class Inner(NamedTuple):
    flag: bool
    table: np.ndarray
    small: np.int8


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
    inner = Inner(flag, np.array([[1.5, -2.0], [0.25, 8.0]]), np.int8(-3))
    data = Data(0.5, inner, np.float32(1.25), (4, -5), 2.0 - 3.0j, column, ())
    helper = numba.njit(weighed)
    kind = types.CPointer(numba.typeof(data))
    read = numba.cfunc(types.float64(kind))(lambda place: helper(at(place)))
    block = Block(data, form_of(numba.typeof(data)))
    assert ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p)(read.address)(block.address) == weighed(data)


def test_other_values_are_refused():
    for value in ("a text", None, [1.0], (1.0, {"a": 1})):
        with pytest.raises(CannotLink, match="not a "):
            structure((1.0, value))


def test_values_of_one_structure_have_one_type():
    """And values of another type have another structure."""
    line = np.arange(6.0)
    fixed = line[:]
    fixed.flags.writeable = False
    values = [
        1, 1.0, True, 1j, np.int8(1), np.float32(1.0), (), (1,), (1, 1), (1, (1,)), Inner(True, line, np.int8(1)),
        line, fixed, line[::2], line.reshape(2, 3), line.reshape(2, 3).T, line.astype(np.int64), line.view(np.recarray),
        np.zeros(2, dtype=[("a", "f8"), ("b", "i8")]), np.zeros(2, dtype=[("a", "f8"), ("c", "i8")]),
    ]  # fmt: skip
    others = [2, 2.5, False, 3j, np.int8(2), np.float32(0.5), (), (3,), (2, 3), (3, (4,)), Inner(False, line + 1, 4)]
    for one in values:
        for other in [*values, *others]:
            same_type = numba.typeof(one) == numba.typeof(other)
            assert same_type or structure(one) != structure(other), (one, other)


def test_a_call_with_other_arguments_than_declared_is_not_compiled():
    line = np.zeros(4)
    for arguments in ((line, line, 1.0), (line, line[::2], 1), (line, line)):
        with pytest.raises(numba.TypingError, match="internal forces: the arguments"):
            numba.njit(lambda given: call("internal forces", 0, 0, given))(arguments)


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


@pytest.mark.parametrize("integrator", ["central-difference", "noh-bathe"])
def test_a_loop_that_is_kept_for_the_next_run_keeps_no_arrays_of_this_one(integrator):
    model = Model(percuss.load(hunek(6, integrator=integrator, end=0.1)))
    march = March(model)
    march.run()
    references = [weakref.ref(march.u), weakref.ref(march.groups[0].start), weakref.ref(march.bulk.mass)]
    del march
    gc.collect()
    assert [reference() for reference in references] == [None] * 3
