"""Single-file plug-ins in the loop: compiled where they can be, in Python with the reason where they cannot."""

import numpy as np
import pytest

import percuss
from strategies import apart, hunek, round_off, run

IMPORTS = """
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
from percuss.methods.interfaces import ContactLaw, Element, Material, Load


class Bound(NamedTuple):
    stiffness: np.ndarray
    ahead: float


@dataclass(frozen=True)
class Spring(ContactLaw):
    \"\"\"A penalty written as a kernel.\"\"\"

    name = "spring"
    summary = "Penalty as a kernel"
    beta_s: float = 0.25
    ahead: float = 1.0

    def bind(self, points, dt):
        return Bound(self.beta_s * points.stiffness, self.ahead)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        gap = trial.gap + bound.ahead * (trial.predicted_gap - trial.gap)
        BODY
"""

PLAIN_BODY = """for p in range(multiplier.size):
            multiplier[p] = bound.stiffness[p] * max(-gap[p], 0.0)"""

# what each kernel does beside the same spring: the first ones compile, the others do not
BODIES = {
    "loop": PLAIN_BODY,
    "helper": "helped(bound.stiffness, gap, multiplier)",
    "dict of lists": """table = {"gap": [float(g) for g in gap]}
        table["stiffness"] = list(bound.stiffness)
        table[1] = "a key of another type"
        for p in range(multiplier.size):
            multiplier[p] = table["stiffness"][p] * max(-table["gap"][p], 0.0)""",
}
COMPILES = ("loop", "helper")

HELPER = """

def helped(stiffness, gap, multiplier):
    for p in range(multiplier.size):
        multiplier[p] = FACTOR * stiffness[p] * max(-gap[p], 0.0)


FACTOR = 1.0
"""


def write(folder, text, name="mine.py"):
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def spring(folder, body="loop"):
    return write(folder, IMPORTS.replace("BODY", BODIES[body]) + HELPER)


def run_with(file, case, **kwargs):
    return percuss.run(percuss.load(case, plugins=[file]), **kwargs)


def nearly_equal(case, one, other):
    allowed = round_off(case, one)
    for name, value in apart(one, other).items():
        assert value <= allowed[name], name


def struck(law, integrator="wu-predictor-corrector"):
    case = hunek(12, integrator=integrator, contact=law, end=0.5)
    case["bodies"]["long"]["material"] = {"young": 160.0, "density": 0.013}
    case["bodies"]["short"]["velocity"] = -0.1
    case["contacts"]["foot"] = {"body": "short.left", "wall": -0.001}
    return case


@pytest.mark.deep
@pytest.mark.parametrize("body", BODIES)
def test_a_penalty_written_as_a_kernel_is_the_penalty(tmp_path, body):
    file = spring(tmp_path, body)
    for integrator, ahead in (("wu-predictor-corrector", 1.0), ("central-difference", 0.0)):
        truth_case = struck({"name": "penalty", "beta_s": 0.25}, integrator)
        truth = run(truth_case)
        assert truth.summary["contacts"]["foot"]["impulse"] > 0
        case = struck({"name": "spring", "ahead": ahead}, integrator)
        result = run_with(file, case)
        nearly_equal(truth_case, truth, result)
        assert result.summary["compiled"] is (body in COMPILES), result.summary["compiled_why"]
        if body not in COMPILES:
            assert len(result.summary["compiled_why"]) == 1
            assert "spring" in result.summary["compiled_why"][0]
        plain = run_with(file, case, compiled=False)
        nearly_equal(truth_case, result, plain)
        assert plain.summary["compiled"] is False
        assert result.summary["energy"]["ledger_error"] < 1e-12


# ---------------------------------------------------------------------------------------------------- materials

MATERIAL = """
import math
from dataclasses import dataclass
import numpy as np
from percuss.methods.interfaces import Material

SCALE = 1.0


def tanh(x):
    return math.tanh(SCALE * x) / SCALE


@dataclass(frozen=True)
class Softening(Material):
    \"\"\"stress = E e0 tanh(e / e0): softer the more it is stretched.\"\"\"

    name = "softening"
    summary = "Softens"
    linear = False
    young: float
    density: float
    knee: float

    @property
    def rho(self):
        return self.density

    @property
    def modulus(self):
        return self.young

    def parameters(self):
        return (self.young, self.knee)

    @staticmethod
    def stress(parameters, strain):
        EXTRA
        return parameters[0] * parameters[1] * tanh(strain / parameters[1])

    @staticmethod
    def energy_density(parameters, before, after):
        middle = 0.5 * (before + after)
        return parameters[0] * parameters[1] ** 2 * math.log(math.cosh(middle / parameters[1]))
"""
UNCOMPILED = 'table = {"a": [1.0], "b": "text"}; table["a"] = parameters'


def soft(knee, young=100.0, density=0.01):
    return {"name": "softening", "young": young, "density": density, "knee": knee}


@pytest.fixture(scope="module", params=["pass", UNCOMPILED], ids=["compiled", "plain"])
def softening(request, tmp_path_factory):
    """A file with a material, and whether it can be compiled."""
    file = write(tmp_path_factory.mktemp("material"), MATERIAL.replace("EXTRA", request.param))
    return file, request.param == "pass"


@pytest.mark.slow
def test_a_material_that_is_nearly_linear_is_nearly_the_elastic_one(softening):
    file, compiles = softening
    case = hunek(20)
    truth = run(hunek(20))
    # tanh x = x (1 - x^2 / 3): the strains are at most 5e-4
    for knee, within in ((1.0, 1e-6), (1e-3, 0.3)):
        for body in case["bodies"].values():
            body["material"] = soft(knee)
        result = run_with(file, case)
        assert result.summary["compiled"] is compiles
        if not compiles:
            (why,) = result.summary["compiled_why"]
            assert "softening" in why
        off = np.abs(result.arrays["contact_force"] - truth.arrays["contact_force"]).mean() / 0.05
        assert off < within
        assert result.summary["momentum"]["error"] < 1e-12
    assert off > 1e-3, "the knee is not felt: the material is not used"


@pytest.mark.deep
def test_bodies_of_unlike_materials_in_any_order(softening):
    """Groups of bodies run through code of their own; a group is not a run of neighbours."""
    file, compiles = softening
    case = hunek(20, end=0.3)
    case["bodies"]["third"] = {
        "bar": {"length": 5.0, "elements": 11}, "at": -5.0, "area": 1.3, "material": None, "velocity": 0.2,
    }  # fmt: skip
    case["contacts"]["behind"] = {"between": ["third.right", "short.left"]}
    for k, body in enumerate(case["bodies"].values()):
        young = 100.0 - 20.0 * k
        body["material"] = soft(1e-3, young) if k == 1 else {"young": young, "density": 0.01}
    result = run_with(file, case)
    plain = run_with(file, case, compiled=False)
    for name, value in apart(result, plain).items():
        assert value < 1e-11, name
    assert result.summary["compiled"] is compiles
    assert result.summary["momentum"]["error"] < 1e-12
    assert result.summary["contacts"]["behind"]["impulse"] > 0
    # the same bodies in another order are other groups
    first, *others = case["bodies"].items()
    swapped = {**case, "bodies": dict([*others, first])}
    for name, value in apart(result, run_with(file, swapped, compiled=False)).items():
        assert value < 1e-11, name


# ------------------------------------------------------------------------------------------- edited plug-ins


def peak(file):
    result = run_with(file, hunek(10, contact="spring"))
    assert result.summary["compiled"] is True
    return result.arrays["contact_force"].max()


@pytest.mark.deep
def test_an_edit_is_seen_by_the_next_run(tmp_path):
    file = spring(tmp_path, "helper")
    before = peak(file)
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("FACTOR = 1.0", "FACTOR = 2.0"), encoding="utf-8")
    after = peak(file)
    assert after != before
    # twice the stiffness is the built-in penalty at twice the stiffness
    truth = run(hunek(10, contact={"name": "penalty", "beta_s": 0.5})).arrays["contact_force"].max()
    assert after == pytest.approx(truth, rel=1e-12)
    file.write_text(text, encoding="utf-8")
    assert peak(file) == before


@pytest.mark.deep
def test_laws_of_both_kinds_work_side_by_side(tmp_path):
    """A kernel at one end of the bar, rows at the other; and both at one end, where they are coupled."""
    file = spring(tmp_path)
    for other in ("lagrange", "bipenalty", "penalty"):
        truth_case = struck({"name": "penalty", "beta_s": 0.25})
        truth_case["contacts"]["foot"]["method"] = other
        truth_case["contacts"]["third"] = {"body": "short.right", "wall": 10.00002, "method": other}
        case = struck("spring")
        case["contacts"] = truth_case["contacts"]
        truth = run(truth_case)
        assert truth.summary["contacts"]["third"]["impulse"] > 0
        nearly_equal(truth_case, truth, run_with(file, case))
