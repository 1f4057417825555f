"""Materials that know the time step: the step that they get, and Johnson and Cook's of the page by a root finder."""

from dataclasses import dataclass

import numpy as np
import pytest

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
    kept = percuss.run(case).fields["plastic_strain"].to_numpy()
    assert kept[-1] == pytest.approx(model.dt, rel=1e-15)
    assert points_at_rest(body.spec.element, body.spec.material, body.view).parameters.tolist() == [1.0, np.inf]


def test_a_scheme_of_stages_is_refused_with_it():
    with pytest.raises(InputError, match="expected a leap-frog scheme with clock, which needs the time step, found"):
        model_of(of_clock("noh-bathe"))
