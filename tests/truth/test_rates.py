"""Materials that know the time step: the step that they get, and Johnson and Cook's of the page by a root finder."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import logm
from scipy.optimize import brentq

import pages
import percuss
from blocks import alone, block
from percuss import SolidMaterial
from percuss.errors import InputError
from percuss.march.model_of_case import model_of
from percuss.mesh.cells import points_at_rest
from strategies import with_methods


@dataclass(frozen=True)
class Clock(SolidMaterial):
    """Hooke's law in a plane that keeps the time step. Formula: ``s = e``."""

    name = "clock"
    summary = "keeps the time step"
    state, stored_in, plastic_in = 2, 0, 1
    needs_step = True
    rho = 1.0

    def solid_parameters(self, plane):
        return (1.0,)

    def wave_modulus(self, plane):
        return 1.0

    @staticmethod
    def stress_3d(parameters, gradient, before, after):
        a, b, c = (
            0.5 * (gradient[1] + gradient[3]),
            0.5 * (gradient[2] + gradient[6]),
            0.5 * (gradient[5] + gradient[7]),
        )
        stress, total = (gradient[0], a, b, a, gradient[4], c, b, c, gradient[8]), 0.0
        for k in range(9):
            total += 0.5 * stress[k] * stress[k]
        after[0], after[1] = total, parameters[1]
        return stress


def of_clock(integrator):
    body = block(0.0, 0.5, [4, 2]) | {"material": "clock"}
    more = {"time": {"courant": 0.5, "end": 0.5}, "record": {"fields": 3}}
    return alone(body, 1.5, **more, method={"integrator": integrator}, registry=with_methods(Clock))


def test_kernels_get_the_time_step_of_a_run_and_an_infinite_one_at_rest():
    model = model_of(case := of_clock("central-difference"))
    (body,) = model.bodies.values()
    kept = percuss.run(case, compiled=False).fields["plastic_strain"].to_numpy()
    assert kept[-1] == pytest.approx(model.dt, rel=1e-15)
    assert points_at_rest(body.spec.element, body.spec.material, body.view).parameters.tolist() == [1.0, np.inf]


def test_a_scheme_of_stages_is_refused_with_it():
    with pytest.raises(InputError, match="expected a leap-frog scheme with clock, which needs the time step, found"):
        model_of(of_clock("noh-bathe"))


# ------------------------------------------------------------------------------------------------ Johnson and Cook

METAL = {"name": "johnson-cook", "young": 100.0, "density": 1.0, "poisson": 0.3, "a": 0.5, "b": 2.0, "n": 0.3, "c": 0.1}
BULK, SHEAR = 100.0 / 1.2, 100.0 / 2.6


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Return the plug-in of the page."""
    path = tmp_path_factory.mktemp("page") / "johnson_cook.py"
    path.write_text(dict(pages.saved_files())[path.name], encoding="utf-8")
    return path


def flow_stress(alpha, rate):
    return (0.5 + 2.0 * alpha**0.3) * (1.0 + 0.1 * np.log(max(1.0, rate)))


@pytest.mark.parametrize("dt", [1e-4, 0.1, np.inf])
def test_the_flow_is_that_of_a_root_finder(file, dt):
    """From the first flow on, where the slope of the hardening is infinite, at fast, at slow and at no rates."""
    namespace = {"__name__": "johnson_cook"}
    exec(compile(file.read_text(encoding="utf-8"), str(file), "exec"), namespace)
    material = namespace["JohnsonCook"](**{key: value for key, value in METAL.items() if key != "name"})
    numbers, before, deformed = np.array([*material.solid_parameters(""), dt]), np.zeros(9), np.eye(3)
    noise, flowed = np.random.default_rng(1), 0
    for _ in range(100):
        deformed = deformed + 0.002 * noise.normal(size=(3, 3))
        plastic = np.eye(3) + before[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
        strain = 0.5 * np.real(logm(deformed @ plastic @ deformed.T))
        trace, along = np.trace(strain), 2.0 * SHEAR * (strain - np.trace(strain) / 3.0 * np.eye(3))
        size, alpha, more = np.sqrt(1.5 * (along**2).sum()), before[6], 0.0

        def rest(more, size=size, alpha=alpha):
            return size - 3.0 * SHEAR * more - flow_stress(alpha + more, more / dt)

        if rest(0.0) > 0.0:
            more, flowed = brentq(rest, 0.0, size / (3.0 * SHEAR), xtol=1e-18, rtol=1e-14), flowed + 1
        after = before.copy()
        gradient = tuple((deformed - np.eye(3)).ravel().tolist())
        stress = np.reshape(material.stress_3d(numbers, gradient, before, after), (3, 3)) @ deformed.T
        expected = BULK * trace * np.eye(3) + along * (1.0 - 3.0 * SHEAR * more / size)
        assert np.abs(stress - expected).max() < 1e-10
        assert after[6] - alpha == pytest.approx(more, rel=1e-8, abs=1e-13)
        before = after
    assert flowed > 30


@pytest.mark.parametrize("speed", [10.0, 1000.0])
def test_a_cell_that_is_pulled_at_a_constant_rate_has_the_stress_of_this_rate(file, speed):
    """Without hardening, and with free sides; snapshots have the stress of the rate too."""
    material = METAL | {"b": 0.0, "density": 1e-4 / speed**2}
    body = {"block": {"size": [1.0] * 3, "elements": [1] * 3}, "at": [0.0] * 3, "material": material}
    body |= {"fixed": [{"on": "left", "along": "x"}], "element": "hex8-mean"}
    pull = {"prescribed-velocity": speed, "on": "a.right", "along": "x"}
    end = 0.1 / speed
    more = {"time": {"courant": 0.5, "end": end}, "record": {"fields": 2, "every": 10}}
    case = alone(body, loads={"pull": pull}, plugins=[str(file)], **more)
    fields = percuss.run(case, compiled=False).fields
    kirchhoff = (fields["von_mises"] * fields["volume_ratio"]).to_numpy()[-1, 0]
    rate = speed / (1.0 + float(fields["time"][-1]) * speed)
    assert kirchhoff == pytest.approx(flow_stress(0.0, rate), rel=2e-4)
