"""The rule by which ``beta_s: auto`` chooses the stiffness of a penalty from bars and step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from percuss import ContactLaw, ContactPoints, Doc, Floats, Gt, Unit

BetaS = (
    Annotated[float, Gt(0), Unit("1"), Doc("stiffness over EA/h of the softer side; auto unless given")]
    | Literal["auto"]
    | None
)

MOST_BETA_S = 0.5
MOST_THETA = 0.8
UNLIKE = 0.5
DRAWN = "energy gained by 400 drawn rows of 2 to 4 unlike bars (tests/benchmarks/gain.py, seed 0), each until its \
contacts closed ten times or for 64 transits: "


class Choice(NamedTuple):
    """The chosen beta_s of each point, (P,), and what bounds it there, in words."""

    beta_s: Floats
    why: tuple[str, ...]


def chosen(points: ContactPoints, dt: float, own_mass: Any = 0.0, share: Any = 0.0) -> Choice:
    """Return ``beta_s = 1/2``, lowered where theta or the closed step of central difference asks for it.

    A law does not know its integrator, so both are kept. With ``x = dt^2 eps_s s`` and ``y = eps_m s``, s the sum of
    the absolute entries of a point's row of S: ``theta = x / (1 + y) <= 0.8`` for Wu's predictor-corrector. For central
    difference ``eps_s - 4 eps_m / dt^2`` is at most half the stiffness limit of the point, and between unlike sides
    ``x - 4 y <= 1/2``. The stiffness limit is `percuss.ContactPoints.stiffness_limit`; of two half-infinite equal bars
    it is where ``x - 4 y = 4 sqrt(1 - C^2)``.
    Contacts that share an end and obey different laws may ask for less; the certificate tells.

    Stiffer than 1/2, penalty rings and bipenalty overshoots and gains energy as contacts switch, with central
    difference; softer, bodies overlap the more and the force comes late.

    Parameters
    ----------
    points, dt
        As in `ContactLaw.bind`.
    own_mass, share
        The penalty mass is ``own_mass + share eps_s``, each a number or (P,).
    """
    s = points.delassus * points.coupling
    x, y = dt**2 * points.stiffness * s, share * points.stiffness * s  # of beta_s = 1
    own = own_mass * s
    limit = dt**2 * s * points.stiffness_limit
    closed = np.where(points.equal_sides, 0.5 * limit, np.minimum(0.5 * limit, UNLIKE))
    with np.errstate(divide="ignore", invalid="ignore"):
        by_theta = np.where(x > MOST_THETA * y, MOST_THETA * (1.0 + own) / (x - MOST_THETA * y), np.inf)
        by_closed = np.where(x > 4.0 * y, (closed + 4.0 * own) / (x - 4.0 * y), np.inf)
    bounds = np.stack([np.full(x.shape, MOST_BETA_S), by_theta, by_closed])
    words = (
        "the most that auto gives",
        f"so that theta <= {MOST_THETA:g}",
        "so that central difference keeps its step",
    )
    return Choice(bounds.min(axis=0), tuple(words[k] for k in bounds.argmin(axis=0)))


def told(choice: Choice) -> Mapping[str, str]:
    """Return a choice as `ContactLaw.chosen` gives it."""
    low, high = choice.beta_s.min(), choice.beta_s.max()
    values = f"{low:.3g}" if high <= low * (1.0 + 1e-9) else f"{low:.3g} to {high:.3g}"
    return {"beta_s": f"auto: {values}, {' or '.join(dict.fromkeys(choice.why))}"}


def keep_one(law: ContactLaw, names: tuple[str, ...], what: str) -> None:
    """Raise where more than one of the options `names` is given."""
    given = [name for name in names if getattr(law, name) is not None]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)} {'both' if len(given) == 2 else 'all'} give the {what}: keep one")
