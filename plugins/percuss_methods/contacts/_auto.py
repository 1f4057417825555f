"""The rule by which ``beta_s: auto`` chooses the penalty stiffness from the bars and the time step."""

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

EpsilonS = Annotated[float, Gt(0), Unit("force/length"), Doc("stiffness; instead of beta_s")] | None

MOST_BETA_S = 0.5
MOST_THETA = 0.8
MOST_OF_UNLIKE_SIDES = 0.5  # largest ``x - 4 y`` between unlike sides, see `choose_beta_s`
DRAWN = (
    "energy gained by 400 random rows of 2 to 4 different bars (tests/benchmarks/gain.py, seed 0), each until its "
    "contacts closed ten times or for 64 transits: "
)
WHY_MOST = "the most that auto gives"


class Choice(NamedTuple):
    """The chosen beta_s of each contact point, (P,), and in words the bound that determines it."""

    beta_s: Floats
    why: tuple[str, ...]


def choose_beta_s(points: ContactPoints, dt: float, own_mass: Any = 0.0, share: Any = 0.0) -> Choice:
    """Return ``beta_s = 1/2``, or less where theta or the critical step of central difference in contact requires it.

    A law does not know its integrator, so both limits are kept. With ``x = dt^2 eps_s s`` and ``y = eps_m s``, s the
    sum of the absolute entries of a point's row of S: ``theta = x / (1 + y) <= 0.8`` for Wu's predictor-corrector. For
    central difference ``eps_s - 4 eps_m / dt^2`` is at most half the stiffness limit of the point, and between unlike
    sides ``x - 4 y <= 1/2``. The stiffness limit is `percuss.ContactPoints.stiffness_limit`; between two half-infinite
    equal bars it is reached at ``x - 4 y = 4 sqrt(1 - C^2)``.
    Contacts that share an end and obey different laws may require less; the certificate reports it.

    Above 1/2, with central difference, the force of the penalty method oscillates, and bipenalty overshoots and gains
    energy as contacts open and close; below 1/2, bodies overlap more and the force is delayed.

    Parameters
    ----------
    points, dt
        Contact points and time step, as in `ContactLaw.bind`.
    own_mass, share
        Parts of the penalty mass ``own_mass + share eps_s``, each a number or (P,) [mass, time^2].
    """
    s = points.delassus * points.coupling
    x, y = dt**2 * points.stiffness * s, share * points.stiffness * s  # for beta_s = 1
    own = own_mass * s
    limit = dt**2 * s * points.stiffness_limit
    closed = np.where(points.equal_sides, 0.5 * limit, np.minimum(0.5 * limit, MOST_OF_UNLIKE_SIDES))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        by_theta = np.where(x > MOST_THETA * y, MOST_THETA * (1.0 + own) / (x - MOST_THETA * y), np.inf)
        by_closed = np.where(x > 4.0 * y, (closed + 4.0 * own) / (x - 4.0 * y), np.inf)
    bounds = np.stack([np.full(x.shape, MOST_BETA_S), by_theta, by_closed])
    reasons = (
        WHY_MOST,
        f"so that theta <= {MOST_THETA:g}",
        "so that central difference keeps its step",
    )
    return Choice(bounds.min(axis=0), tuple(reasons[k] for k in bounds.argmin(axis=0)))


def described(choice: Choice, origin: str = "auto") -> Mapping[str, str]:
    """Return the description of a choice for `ContactLaw.chosen`: its range over the points and the reasons."""
    low, high = choice.beta_s.min(), choice.beta_s.max()
    values = f"{low:.3g}" if high <= low * (1.0 + 1e-9) else f"{low:.3g} to {high:.3g}"
    return {"beta_s": f"{origin}: {values}, {' or '.join(dict.fromkeys(choice.why))}"}


def refuse_several(law: ContactLaw, names: tuple[str, ...], quantity: str) -> None:
    """Raise `ValueError` if more than one of the options `names`, which all give the same quantity, is given."""
    given = [name for name in names if getattr(law, name) is not None]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)} {'both' if len(given) == 2 else 'all'} give the {quantity}: keep one")


def limited_stiffness(law: Any, points: ContactPoints, dt: float) -> Any:
    """Return eps_s of a law by its options epsilon_s and beta_s, (P,) [force/length]; auto is `choose_beta_s`."""
    if law.epsilon_s is not None:
        return law.epsilon_s * points.weight
    beta_s = choose_beta_s(points, dt).beta_s if law.beta_s in {None, "auto"} else law.beta_s
    return beta_s * points.stiffness


def limited_stiffness_described(law: Any, points: ContactPoints, dt: float) -> Mapping[str, str]:
    """Return the description of the automatic stiffness of `limited_stiffness`, or nothing where one is given."""
    automatic = law.epsilon_s is None and law.beta_s in {None, "auto"}
    return described(choose_beta_s(points, dt)) if automatic else {}


def stiffness_with_default(law: Any, points: ContactPoints, default: Any) -> Any:
    """Return eps_s of a law by its options epsilon_s and beta_s, (P,) [force/length].

    Where neither is given, or beta_s is auto, it follows from `default`, a beta_s.
    """
    if law.epsilon_s is not None:
        return law.epsilon_s * points.weight
    return (default if law.beta_s in {None, "auto"} else law.beta_s) * points.stiffness


def any_stiffness(law: Any, points: ContactPoints) -> Any:
    """Return eps_s of a law whose stiffness no step limits, (P,) [force/length]; auto is the most that auto gives."""
    return stiffness_with_default(law, points, MOST_BETA_S)


def any_stiffness_described(law: Any) -> Mapping[str, str]:
    """Return the description of the automatic stiffness of `any_stiffness`, or nothing where one is given."""
    automatic = law.epsilon_s is None and law.beta_s in {None, "auto"}
    return {"beta_s": f"auto: {MOST_BETA_S:g}, {WHY_MOST}"} if automatic else {}


def quarter_stiffness(law: Any, points: ContactPoints) -> Any:
    """Return eps_s of a law by its options epsilon_s and beta_s, a quarter unless given, (P,) [force/length]."""
    return stiffness_with_default(law, points, 0.25)


def both_forms(stiffness: Any, points: ContactPoints) -> Mapping[str, Any]:
    """Return eps_s and its dimensionless form beta_s, by name."""
    return {"epsilon_s": stiffness, "beta_s": stiffness / points.stiffness}
