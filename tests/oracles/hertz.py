"""What a ball does at a rigid wall over what the quasi-static theory of Hertz says of it."""

import numpy as np

WHOLE = 4.0 / 3.0 * np.pi  # mass of a ball of unit radius and density


def hertz(speed, poisson):
    """Return duration, largest force and largest approach of Hertz' ball, of unit radius, density and modulus."""
    stiffness = 1.0 / (1.0 - poisson**2)
    depth = (15.0 / 16.0 * WHOLE * speed**2 / stiffness) ** 0.4
    return 2.94328 * depth / speed, 4.0 / 3.0 * stiffness * depth**1.5, depth


def over_hertz(result, mass, speed, poisson):
    """Return duration, force at the middle, approach of the centre of mass over those of Hertz, and the restitution.

    The force is that of a parabola through the middle 24 % of the duration, as a wave on the surface lies over it.
    """
    time, force, depth = hertz(speed, poisson)
    contact, pressing = result.summary["contacts"]["floor"], result.arrays["contact_force"][:, 0]
    duration = contact["last_open"] - contact["first_closed"]
    place = (result.arrays["time"] - contact["first_closed"]) / duration - 0.5
    middle = np.abs(place) < 0.12
    bend, slope, value = np.polyfit(place[middle], pressing[middle], 2)
    step = result.arrays["time"][1]
    velocity = -speed + np.cumsum(pressing) * step / mass
    approach = -np.cumsum(velocity).min() * step
    return duration / time, (value - slope**2 / (4.0 * bend)) / force, approach / depth, velocity[-1] / speed
