"""A bound loop is used again only while everything that its kernels read is as it was."""

import types

import numba
import numpy as np
import pytest

import percuss
from percuss.compiler.specialise import Specialiser
from strategies import hunek

TEXT = """
import numpy as np
import settings

FACTOR = 1.0
TABLE = np.ones(3)
PAIR = [1.0, 2.0]


def made(content):
    def inner(x):
        return content * x

    return inner


inner = made(1.0)


def default(x, by=1.0):
    return by * x


def helper(x):
    return FACTOR * x


def unused(x):
    return 0.0


def kernel(x):
    return helper(x) + TABLE[0] + PAIR[0] + inner(x) + default(x) + settings.SCALE + settings.scaled(x)
"""
SETTINGS = """
SCALE = 1.0


def scaled(x):
    return x
"""


@pytest.fixture
def module(monkeypatch):
    """Return a module with a kernel that reads things of every kind."""
    settings, made = types.ModuleType("settings"), types.ModuleType("made")
    exec(SETTINGS, vars(settings))
    monkeypatch.setitem(__import__("sys").modules, "settings", settings)
    exec(TEXT, vars(made))
    return made


def other(x):
    return 3.0 * x


def change_cell(module):
    module.inner.__closure__[0].cell_contents = 2.0


CHANGES = {
    "a constant": lambda module: setattr(module, "FACTOR", 2.0),
    "an element of an array": lambda module: module.TABLE.__setitem__(0, 2.0),
    "an item of a list": lambda module: module.PAIR.__setitem__(0, 2.0),
    "a helper": lambda module: setattr(module, "helper", other),
    "the code of a helper": lambda module: setattr(module.helper, "__code__", other.__code__),
    "the default of a helper": lambda module: setattr(module.default, "__defaults__", (2.0,)),
    "the closure of a helper": change_cell,
    "a constant in a module": lambda module: setattr(module.settings, "SCALE", 2.0),
    "a function in a module": lambda module: setattr(module.settings, "scaled", other),
    "a name that is gone": lambda module: delattr(module, "FACTOR"),
}


@pytest.mark.parametrize("jit", [True, False], ids=["compiled", "plain"])
@pytest.mark.parametrize("change", CHANGES)
def test_a_change_of_anything_that_a_kernel_reads_is_seen(module, change, jit):
    specialiser = Specialiser(jit=jit)
    specialiser.bind(module.kernel, entry=True)
    assert specialiser.readings.unchanged(jit=jit)
    module.UNUSED = 1.0
    module.unused.__code__ = other.__code__
    assert specialiser.readings.unchanged(jit=jit)
    CHANGES[change](module)
    assert not specialiser.readings.unchanged(jit=jit)


def test_a_new_overload_of_a_helper_is_seen(module):
    specialiser = Specialiser()
    specialiser.bind(module.kernel, entry=True)

    @numba.extending.overload(module.helper)
    def replaced(x):
        return lambda x: 2.0 * x

    assert specialiser.readings.unchanged(jit=False)
    assert not specialiser.readings.unchanged(jit=True)


LAW = """
from dataclasses import dataclass
from typing import NamedTuple
from percuss import ContactLaw
import numpy as np

FACTOR = 1.0


class Bound(NamedTuple):
    stiffness: np.ndarray


@dataclass(frozen=True)
class Spring(ContactLaw):
    '''A spring.'''

    name = "spring"
    summary = "A spring with a factor"

    def bind(self, points, dt):
        return Bound(0.1 * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = FACTOR * bound.stiffness[p] * max(-trial.gap[p], 0.0)
"""


@pytest.mark.deep
def test_a_run_after_a_change_uses_the_changed_kernel(tmp_path):
    file = tmp_path / "spring.py"
    file.write_text(LAW)
    case = percuss.load(hunek(8, contact="spring", end=1.0), plugins=[file])

    def force():
        return percuss.run(case).arrays["contact_force"]

    first, again = force(), force()
    np.testing.assert_array_equal(first, again)
    type(case.method.contact).multipliers.__globals__["FACTOR"] = 2.0
    doubled = force()
    (pressing, *_) = np.flatnonzero(first)  # up to here both motions are the same
    assert doubled[pressing] == 2.0 * first[pressing]
