"""What a model says of its optional features: facts for everything that does not know these by name."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.mesh.loads import NodalForce
    from percuss.methods.interfaces import Floats

Verdict = Literal["yes", "marginal", "no", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Feature:
    """The facts about an optional feature that a model has; each default is that of a model without it.

    Attributes
    ----------
    name
        By which other features know it.
    goes_without
        Why the features of these names do not go with it, in words that they complete to a sentence.
    balanced
        Contact points whose force follows from a static balance; what the feature does not go with concerns these
        alone, if there are any.
    records
        Returns the `LAW` records of a law at such points, from those at other points and the diagonal of S.
    delassus
        What stands in S at such points instead of ``N^T M^-1 N``.
    leaps
        Number of steps from one action of the internal forces of each body to the next.
    limit_ratio
        Largest stable step over that of central difference.
    forces
        Forces on nodes that depend on the motion of these, and change the step of bodies without contact, too.
    springs
        Returns what such forces add to the stiffness of the ends of bars, by node.
    beyond_pencil, effect_unknown
        Return why the pencil, and why no criterion, covers such a force; empty if one does.
    no_row_kernel
        Whether the kernel for bars of equal elements, which knows nothing but these, cannot advance them.
    built_for_bars
        Whether it is built for bars alone.
    sums_internal_work, dissipates
        Whether the energy ledger counts the work of the internal forces instead of the elastic energy, and whether
        linear bodies dissipate what they do not store of it.
    loses_energy
        The warning, up to a percentage, where internal forces did other work than the bodies store; the ledger may then
        be closed all the same.
    not_guaranteed
        Why energy is not guaranteed to stay bounded as contacts open and close.
    of_all_laws
        Whether that is so with any contact law, even one of which nothing is known.
    no_springs
        Why closed contacts do not act in the step as the springs of a mesh do.
    unlike_plain_bars
        What sets the model apart from linear bars under a leap-frog scheme, of which closed forms are known.
    no_closed_form, no_waves
        Why no critical step in closed form, and no wave at a closed contact, is known of it.
    by_pencil_alone, unknown_above_theta_of_one
        Why the step itself is not examined, and why short bars above theta = 1 are not.
    examined
        With which laws alone it is examined.
    no_critical_step
        Why the model has no critical step, or none that can be found by a search.
    unknown
        Returns why no criterion covers the model; empty if one does.
    cure
        What helps against an unstable step whose critical step is not known.
    explained
        The lines about the step of the integrator in an explanation.
    """

    name: str
    goes_without: Mapping[str, str] = field(default_factory=dict)
    balanced: frozenset[int] = frozenset()
    records: Callable[[BoundLaw, Any, Floats], Any] | None = None
    delassus: str = ""
    leaps: tuple[int, ...] = ()
    limit_ratio: float = 1.0
    forces: tuple[NodalForce, ...] = ()
    springs: Callable[[], Mapping[int, float]] = dict
    beyond_pencil: Callable[[], str] = str
    effect_unknown: Callable[[], str] = str
    no_row_kernel: bool = False
    built_for_bars: bool = False
    sums_internal_work: bool = False
    dissipates: bool = False
    loses_energy: str = ""
    not_guaranteed: str = ""
    of_all_laws: bool = False
    no_springs: str = ""
    unlike_plain_bars: str = ""
    no_closed_form: str = ""
    no_waves: str = ""
    by_pencil_alone: str = ""
    unknown_above_theta_of_one: str = ""
    examined: str = ""
    no_critical_step: str = ""
    unknown: Callable[[], str] = str
    cure: str = ""
    explained: tuple[str, ...] = ()

    def why_without(self, name: str, where: Sequence[int] = ()) -> str:
        """Return why the feature `name` does not go with it at the contact points `where`; empty if it does."""
        concerned = not self.balanced or not self.balanced.isdisjoint(where)
        return self.goes_without.get(name, "") if concerned else ""


def together(features: Iterable[Feature]) -> Feature:
    """Return the facts of all features as those of one; of a fact that several of them say the first one counts."""
    neutral = vars(Feature(name=""))
    said = ({name: fact for name in neutral if (fact := vars(one)[name]) != neutral[name]} for one in features)
    return Feature(**{**neutral, **ChainMap(*said)})
