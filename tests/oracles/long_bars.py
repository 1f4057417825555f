"""Critical steps of uniform bars in closed form, without a mesh or a matrix: the bars are taken as infinitely long.

A harmonic that decays into such a bar of elements h holds its end with the stiffness ``(EA/h)(2/C) sqrt(1/C^2 - 1)`` at
the step dt = C h/c. Central difference is stable as long as the stiffness of both ends in series is at least
``eps_s - 4 eps_m / dt^2``. Wu's predictor-corrector is stable for ``theta <= 1``, with s the sum of 1/m over both
sides, ``m = (EA/h) (h/c)^2 / 2`` the mass at an end.
"""

import numpy as np
from scipy.optimize import brentq


def critical_step(ends, stiffness, inertia=0.0, *, predicted=False):
    """Return the critical step of one contact, at most that of the free bars, 2/omega.

    Parameters
    ----------
    ends
        EA/h and h/c of the bar on each side; one at a wall.
    stiffness, inertia
        eps_s and eps_m.
    predicted
        Whether the law is evaluated at the predicted gap.
    """
    free = min(h_over_c for _, h_over_c in ends)
    if predicted:
        s = sum(2.0 / (k * h_over_c**2) for k, h_over_c in ends)
        return min(free, np.sqrt((1.0 + inertia * s) / (stiffness * s)))

    def reserve(dt):
        held = [k * 2.0 * h_over_c / dt * np.sqrt(max((h_over_c / dt) ** 2 - 1.0, 0.0)) for k, h_over_c in ends]
        series = 1.0 / sum(1.0 / k for k in held) if min(held) > 0.0 else 0.0
        return series - (stiffness - 4.0 * inertia / dt**2)

    return free if reserve(free) >= 0.0 else brentq(reserve, 1e-9 * free, free, xtol=1e-15 * free)
