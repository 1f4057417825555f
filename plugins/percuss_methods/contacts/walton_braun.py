"""The hysteretic spring of Walton and Braun."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from percuss import ContactLaw, ContactPoints, Doc, Gt, Le, Unit
from percuss_methods.contacts._auto import quarter_stiffness, refuse_several

if TYPE_CHECKING:
    from percuss import Floats, Trial


class Springs(NamedTuple):
    """Stiffnesses of the spring while it is loaded, and while it is unloaded or loaded again, (P,) each."""

    loading: Floats
    unloading: Floats


@dataclass(frozen=True)
class WaltonBraun(ContactLaw):
    """Hysteretic spring of Walton and Braun: stiffer while unloading than while loading.

    Formula: ``lambda = max(k_2 d - (k_2 - k_1) d_m, 0)``, ``k_2 = k_1 / e^2``, with the overlap d = <-g> and the
    greatest overlap d_m since the contact closed: ``k_1 d`` while the overlap grows beyond d_m, and
    ``k_2 (d - d_0)``, ``d_0 = (1 - k_1/k_2) d_m``, elsewhere.

    The spring gives back the share ``e^2`` of the work that loads it up to d_m. Two rigid bodies therefore separate at
    e times the speed at which they met. Where the overlap ends, the contact forgets d_m. Elastic bodies lose less or
    more, as waves load and unload the contact many times.

    With central difference a closed contact lowers the critical step as a penalty of stiffness k_2 does. The step
    itself is examined on both lines: above the critical step of k_2 the certificate is `no`, and below it `unknown`,
    because contacts change from one line to the other.
    """

    name = "walton-braun"
    summary = "Hysteretic spring, stiffer while unloading; restitution e"
    references = (
        "Walton, Braun: Viscosity, granular-temperature, and stress calculations for shearing assemblies of inelastic, "
        "frictional disks, Journal of Rheology 30 (1986) 949-980, doi 10.1122/1.549893",
    )
    examples = ({}, {"beta_s": 0.1, "restitution": 0.7})
    stiffening = ("beta_s", "epsilon_s")
    guarantees = ("never pulls",)
    state = 3  # greatest overlap since the contact closed, energy stored and energy dissipated
    stored_in = 1
    dissipated_in = 2

    beta_s: Annotated[float, Gt(0), Unit("1"), Doc("k_1 over EA/h of the softer side; 1/4 unless given")] | None = None
    epsilon_s: Annotated[float, Gt(0), Unit("force/length"), Doc("k_1; instead of beta_s")] | None = None
    restitution: Annotated[float, Gt(0), Le(1), Unit("1"), Doc("e of rigid bodies")] = 0.9

    def __post_init__(self) -> None:
        refuse_several(self, ("beta_s", "epsilon_s"), "stiffness")

    def bind(self, points: ContactPoints, dt: float) -> Springs:  # noqa: ARG002
        """Return both stiffnesses of each point."""
        loading = quarter_stiffness(self, points)
        return Springs(loading, loading / self.restitution**2)

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return the stiffnesses k_1, and k_2 per area where points have one."""
        loading = quarter_stiffness(self, points)
        return {"epsilon_s": loading, "unloading": loading / self.restitution**2 / points.weight}

    @staticmethod
    def multipliers(bound: Springs, trial: Trial, multiplier: Floats) -> None:
        """Set the force of each point, and follow its greatest overlap and its energies."""
        for p in range(multiplier.size):
            loading, unloading = bound.loading[p], bound.unloading[p]
            overlap = max(-trial.gap[p], 0.0)
            before = trial.before[p, 0] if overlap > 0.0 else 0.0
            greatest = max(before, overlap)
            force = max(unloading * overlap - (unloading - loading) * greatest, 0.0)
            lost = 0.5 * loading * (1.0 - loading / unloading) * (greatest**2 - before**2)
            multiplier[p] = force
            trial.after[p, 0] = greatest
            trial.after[p, 1] = 0.5 * force**2 / unloading
            trial.after[p, 2] = trial.before[p, 2] + lost
