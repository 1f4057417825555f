"""Single-file plug-ins in the loop: compiled where they can be, in Python with the reason where they cannot."""

import pytest

import percuss
from strategies import apart, hunek, round_off, run

# What each kernel does beside the same work: the first compiles, the other does not.
EXTRAS = {"compiled": "pass", "plain": "table = {'a': [1.0], 'b': 'text'}; table['a'] = 'text'"}
SPRING = '''
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
from percuss.methods.interfaces import ContactLaw

FACTOR = 1.0


class Bound(NamedTuple):
    stiffness: np.ndarray


def pushed(stiffness, gap):
    return FACTOR * stiffness * max(-gap, 0.0)


@dataclass(frozen=True)
class Spring(ContactLaw):
    """A penalty written as a kernel."""

    name = "spring"
    summary = "Penalty as a kernel"
    beta_s: float = 0.25

    def bind(self, points, dt):
        return Bound(self.beta_s * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        EXTRA
        for p in range(multiplier.size):
            multiplier[p] = pushed(bound.stiffness[p], trial.gap[p])
'''
HOOKE = '''
from dataclasses import dataclass
from percuss.methods.interfaces import Material


@dataclass(frozen=True)
class Own(Material):
    """Hooke's law, which does not say that it is linear."""

    name = "own"
    summary = "Hooke's law"
    modulus: float = 1.0
    rho: float = 1.0

    def parameters(self):
        return (self.modulus,)

    @staticmethod
    def stress(parameters, strain):
        EXTRA
        return parameters[0] * strain

    @staticmethod
    def energy_density(parameters, before, after):
        return 0.5 * parameters[0] * before * after
'''
PENALTY = {"name": "penalty", "beta_s": 0.25}


def written(folder, text, extra="compiled"):
    file = folder / "mine.py"
    file.write_text(text.replace("EXTRA", EXTRAS[extra]), encoding="utf-8")
    return file


def run_with(file, case, **kwargs):
    return percuss.run(percuss.load(case, plugins=[file]), **kwargs)


def assert_nearly_equal(case, one, other):
    allowed = round_off(case, one)
    for name, value in apart(one, other).items():
        assert value <= allowed[name], name


def assert_compiled(result, name, extra):
    assert result.summary["compiled"] is (extra == "compiled"), result.summary["compiled_why"]
    assert all(name in why for why in result.summary["compiled_why"])


def struck(law):
    case = hunek(12, integrator="central-difference", contact=law, end=0.5)
    case["bodies"]["long"]["material"] = {"young": 160.0, "density": 0.013}
    case["bodies"]["short"]["velocity"] = -0.1
    case["contacts"]["foot"] = {"body": "short.left", "wall": -0.001}
    return case


@pytest.mark.deep
@pytest.mark.parametrize("extra", EXTRAS)
def test_bodies_of_unlike_materials_in_any_order(tmp_path, extra):
    """Groups of bodies run through code of their own; a group is not a run of neighbours."""
    file, case = written(tmp_path, HOOKE, extra), hunek(20, end=0.3)
    case["bodies"]["third"] = {
        "bar": {"length": 5.0, "elements": 11}, "at": -5.0, "area": 1.3, "material": None, "velocity": 0.2,
    }  # fmt: skip
    case["contacts"]["behind"] = {"between": ["third.right", "short.left"]}
    for k, body in enumerate(case["bodies"].values()):
        body["material"] = {"young": 100.0 - 20.0 * k, "density": 0.01}
    elastic = dict(case["bodies"]["long"]["material"])
    case["bodies"]["long"]["material"] = {"name": "own", "modulus": elastic["young"], "rho": elastic["density"]}
    result = run_with(file, case)
    assert_compiled(result, "own", extra)
    assert result.summary["momentum"]["error"] < 1e-12
    assert result.summary["contacts"]["behind"]["impulse"] > 0
    first, *others = case["bodies"].items()
    for other in (case, {**case, "bodies": dict([*others, first])}):
        for changes in ({}, {"bodies.long.material": elastic}):
            compared = percuss.run(percuss.load(other, changes, plugins=[file]), compiled=False)
            assert max(apart(result, compared).values()) < 1e-11


@pytest.mark.deep
@pytest.mark.parametrize("other", ["lagrange", "bipenalty", "penalty"])
def test_laws_of_both_kinds_work_side_by_side(tmp_path, other):
    """A kernel at one end of the bar, rows at the other; and both at one end, where they are coupled."""
    truth_case, case = struck(PENALTY), struck("spring")
    for one in (truth_case, case):
        one["contacts"]["foot"]["method"] = other
        one["contacts"]["third"] = {"body": "short.right", "wall": 10.00002, "method": other}
    truth = run(truth_case)
    assert truth.summary["contacts"]["third"]["impulse"] > 0
    assert_nearly_equal(truth_case, truth, run_with(written(tmp_path, SPRING), case))
