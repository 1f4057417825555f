"""Single-file plug-ins in the loop: compiled where they can be, in Python with the reason where they cannot."""

import itertools
import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest

import percuss
from strategies import INTEGRATORS, apart, hunek, round_off, run

IMPORTS = """
from dataclasses import dataclass
from typing import NamedTuple
import numpy as np
from percuss.contracts import ContactLaw, Element, Material, Load


class Bound(NamedTuple):
    stiffness: np.ndarray


@dataclass(frozen=True)
class Spring(ContactLaw):
    \"\"\"A penalty written as a kernel.\"\"\"

    name = "spring"
    summary = "Penalty as a kernel"
    beta_s: float = 0.25

    def bind(self, points, dt):
        return Bound(self.beta_s * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        BODY
"""

PLAIN_BODY = """for p in range(multiplier.size):
            multiplier[p] = bound.stiffness[p] * max(-GAP[p], 0.0)"""

# what each kernel does beside the same spring: the first ones compile, the others do not
BODIES = {
    "loop": PLAIN_BODY,
    "vectors": "multiplier[:] = bound.stiffness * np.maximum(-GAP, 0.0)",
    "allocates": """work = np.zeros(multiplier.size)
        for p in range(multiplier.size):
            work[p] = bound.stiffness[p] * max(-GAP[p], 0.0)
        multiplier[:] = work.copy()""",
    "helper": "helped(bound.stiffness, GAP, multiplier)",
    "dict of lists": """table = {"gap": [float(g) for g in GAP], "stiffness": list(bound.stiffness), "note": "mixed"}
        for p in range(multiplier.size):
            multiplier[p] = table["stiffness"][p] * max(-table["gap"][p], 0.0)""",
    "try": """for p in range(multiplier.size):
            try:
                multiplier[p] = bound.stiffness[p] * max(-GAP[p], 0.0)
            except (KeyError, ArithmeticError) as error:
                print(f"{error!r}")
                raise""",
    "sparse": """from scipy.sparse import diags
        multiplier[:] = diags(bound.stiffness) @ np.maximum(-GAP, 0.0)""",
}
COMPILES = ("loop", "vectors", "allocates", "helper")

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


def spring(folder, body="loop", integrator="wu-predictor-corrector", name="mine.py"):
    gap = "trial.predicted_gap" if integrator == "wu-predictor-corrector" else "trial.gap"
    return write(folder, IMPORTS.replace("BODY", BODIES[body]).replace("GAP", gap) + HELPER, name)


def run_with(file, case, **kwargs):
    return percuss.run(percuss.load(case, plugins=[file]), **kwargs)


def nearly_equal(case, one, other):
    allowed = round_off(case, one)
    for name, value in apart(one, other).items():
        assert value <= allowed[name], name


def struck(law, integrator="wu-predictor-corrector"):
    case = hunek(20, integrator=integrator, contact=law)
    case["bodies"]["long"]["material"] = {"young": 160.0, "density": 0.013}
    case["bodies"]["short"]["velocity"] = -0.1
    case["contacts"]["foot"] = {"body": "short.left", "wall": -0.001}
    return case


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("body", BODIES)
def test_a_penalty_written_as_a_kernel_is_the_penalty(tmp_path, body, integrator):
    file = spring(tmp_path, body, integrator)
    truth_case = struck({"name": "penalty", "beta_s": 0.25}, integrator)
    truth = run(truth_case)
    assert truth.summary["contacts"]["foot"]["impulse"] > 0
    result = run_with(file, struck("spring", integrator))
    nearly_equal(truth_case, truth, result)
    assert result.summary["compiled"] is (body in COMPILES), result.summary["compiled_why"]
    if body not in COMPILES:
        assert len(result.summary["compiled_why"]) == 1
        assert "spring" in result.summary["compiled_why"][0]
    plain = run_with(file, struck("spring", integrator), compiled=False)
    nearly_equal(truth_case, result, plain)
    assert plain.summary["compiled"] is False
    assert result.summary["energy"]["ledger_error"] < 1e-12


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


def test_two_laws_of_ones_own_at_once(tmp_path):
    text = spring(tmp_path).read_text(encoding="utf-8")
    second = text[text.index("@dataclass") : text.index("def helped")].replace("Spring", "Coil").replace('"spring"', '"coil"')
    file = write(tmp_path, text + "\n\n" + second)
    truth_case = struck({"name": "penalty", "beta_s": 0.25})
    case = struck("spring")
    case["contacts"]["foot"]["method"] = {"name": "coil", "beta_s": 0.5}
    truth_case["contacts"]["foot"]["method"] = {"name": "penalty", "beta_s": 0.5}
    result = run_with(file, case)
    assert result.summary["compiled"] is True
    nearly_equal(truth_case, run(truth_case), result)


# ---------------------------------------------------------------------------------------------------- materials

MATERIAL = """
import math
from dataclasses import dataclass
import numpy as np
from percuss.contracts import Material

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


@pytest.mark.parametrize("extra", ["pass", UNCOMPILED], ids=["compiled", "plain"])
def test_a_material_that_is_nearly_linear_is_nearly_the_elastic_one(tmp_path, extra):
    file = write(tmp_path, MATERIAL.replace("EXTRA", extra))
    case = hunek(20)
    truth = run(hunek(20))
    # tanh x = x (1 - x^2 / 3): the strains are at most 5e-4
    for knee, within in ((1.0, 1e-5), (1e-3, 0.1)):
        for body in case["bodies"].values():
            body["material"] = soft(knee)
        result = run_with(file, case)
        assert result.summary["compiled"] is (extra == "pass")
        if extra != "pass":
            (why,) = result.summary["compiled_why"]
            assert "softening" in why
        off = np.abs(result.arrays["contact_force"] - truth.arrays["contact_force"]).max() / 0.05
        assert off < within
        assert result.summary["momentum"]["error"] < 1e-12
    assert off > 1e-3, "the knee is not felt: the material is not used"


@pytest.mark.parametrize("kinds", list(itertools.product(["elastic", "soft"], repeat=3)), ids="-".join)
@pytest.mark.parametrize("extra", ["pass", UNCOMPILED], ids=["compiled", "plain"])
def test_bodies_of_unlike_materials_in_any_order(tmp_path, kinds, extra):
    """Groups of bodies run through code of their own; a group is not a run of neighbours."""
    file = write(tmp_path, MATERIAL.replace("EXTRA", extra))
    case = hunek(20, end=0.3)
    case["bodies"]["third"] = {
        "bar": {"length": 5.0, "elements": 11}, "at": -5.0, "area": 1.3, "material": None, "velocity": 0.2,
    }  # fmt: skip
    case["contacts"]["behind"] = {"between": ["third.right", "short.left"]}
    for k, (kind, body) in enumerate(zip(kinds, case["bodies"].values(), strict=True)):
        young = 100.0 - 20.0 * k
        body["material"] = soft(1e-3, young) if kind == "soft" else {"young": young, "density": 0.01}
    result = run_with(file, case)
    plain = run_with(file, case, compiled=False)
    for name, value in apart(result, plain).items():
        assert value < 1e-11, name
    assert result.summary["compiled"] is (extra == "pass" or "soft" not in kinds)
    assert result.summary["momentum"]["error"] < 1e-12
    assert result.summary["contacts"]["behind"]["impulse"] > 0
    # the same bodies in another order are other groups
    swapped = {**case, "bodies": dict(reversed(case["bodies"].items()))}
    for name, value in apart(result, run_with(file, swapped)).items():
        assert value < 1e-11, name


# ------------------------------------------------------------------------------------------- edited plug-ins


def impulse(file):
    result = run_with(file, hunek(10, contact="spring"))
    assert result.summary["compiled"] is True
    return result.arrays["contact_force"].max()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("FACTOR = 1.0", "FACTOR = 2.0"),
        ("FACTOR * stiffness[p]", "2.0 * FACTOR * stiffness[p]"),
        ("helped(bound.stiffness,", "helped(2.0 * bound.stiffness,"),
    ],
    ids=["constant", "helper", "kernel"],
)
def test_an_edit_is_seen_by_the_next_run(tmp_path, old, new):
    file = spring(tmp_path, "helper")
    before = impulse(file)
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace(old, new), encoding="utf-8")
    assert text.count(old) == 1
    after = impulse(file)
    assert after != before
    # twice the stiffness is the built-in penalty at twice the stiffness
    truth = run(hunek(10, contact={"name": "penalty", "beta_s": 0.5})).arrays["contact_force"].max()
    assert after == pytest.approx(truth, rel=1e-12)
    file.write_text(text, encoding="utf-8")
    assert impulse(file) == before


def test_machine_code_on_disk_is_no_trap_after_an_edit_that_changes_nothing(tmp_path):
    """It is kept with the classes of its arguments, which are those of the file as it was."""
    file = spring(tmp_path)
    before = impulse(file)
    file.write_text(file.read_text(encoding="utf-8") + "# a remark\n", encoding="utf-8")
    code = (
        "import sys; from pathlib import Path; import percuss; from strategies import hunek;"
        "case = percuss.load(hunek(10, contact='spring'), plugins=[sys.argv[1]]);"
        "print(repr(float(percuss.run(case).arrays['contact_force'].max())))"
    )
    here = os.path.dirname(os.path.abspath(__file__))
    command = [sys.executable, "-c", code, str(file)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=here, check=False)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == before


@pytest.mark.parametrize("kind", ["law", "material"])
def test_an_edit_is_seen_by_another_process(tmp_path, kind):
    """Machine code is kept on disk between processes: it must not outlive the source it is from."""
    if kind == "law":
        text = spring(tmp_path, "helper").read_text(encoding="utf-8")
        edits = ("FACTOR = 1.0", "FACTOR = 2.0")
        case = hunek(10, contact="spring")
    else:
        text, edits = MATERIAL.replace("EXTRA", "pass"), ("SCALE = 1.0", "SCALE = 2.0")
        case = hunek(10)
        for body in case["bodies"].values():
            body["material"] = soft(1e-3)
    code = textwrap.dedent(
        """
        import sys, json, percuss
        case = json.loads(sys.argv[2])
        result = percuss.run(percuss.load(case, plugins=[sys.argv[1]]))
        print(json.dumps([result.summary["compiled"], result.arrays["contact_force"].max()]))
        """
    )
    file = write(tmp_path, text, "mine.py")
    cache = tmp_path / "cache"
    cache.mkdir()
    import json

    def fresh():
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
        command = [sys.executable, "-c", code, str(file), json.dumps(case)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
        compiled, peak = json.loads(done.stdout)
        assert compiled is True
        return peak

    first = fresh()
    kept = list(cache.rglob("*.nbc"))
    assert kept, "nothing was kept on disk: there is nothing to test"
    assert run_with(file, case).arrays["contact_force"].max() == first
    file.write_text(text.replace(*edits), encoding="utf-8")
    second = fresh()
    assert second != first
    assert run_with(file, case).arrays["contact_force"].max() == second
    assert set(kept) < set(cache.rglob("*.nbc"))


def test_a_kernel_that_fails_in_python_too_says_so(tmp_path):
    """Falling back is for what cannot be compiled; a mistake is still a mistake."""
    text = IMPORTS.replace("BODY", "multiplier[:] = bound.no_such_thing") + HELPER
    file = write(tmp_path, text)
    with pytest.raises(Exception, match="no_such_thing"):
        run_with(file, hunek(10, contact="spring"))


def test_a_law_that_is_neither_rows_nor_a_kernel_is_refused(tmp_path):
    text = IMPORTS.split("    @staticmethod", maxsplit=1)[0]
    file = write(tmp_path, text)
    with pytest.raises(percuss.PluginError, match="multipliers"):
        run_with(file, hunek(10, contact="spring"))
