"""What a model says of its optional features: facts for everything that does not know these by name."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.mesh.loads import NodalForce
    from percuss.methods.interfaces import Floats

Verdict = Literal["yes", "marginal", "no", "unknown"]
# What a feature may alter of a plain step, and another one may need.
EVERY_STEP = "internal forces that act in every step"
ELASTIC = "internal forces that follow from the strain alone"
# What other rooms ask about the features of a model.
Question = Literal[
    # of a certificate: why ...
    "springs",  # closed contacts do not act in the step as the springs of a mesh do
    "linear laws",  # the linear laws do not cover it
    "black box",  # the black box does not examine it
    "criterion",  # no criterion covers the model
    "certificate",  # its effect on the verdict is not known
    "critical step",  # there is no critical step, or none that a search can find
    "energy",  # energy is not guaranteed to stay bounded as contacts open and close
    "waves",  # no wave at a closed contact is known
    "plain bars",  # it is no case of linear bars under a leap-frog scheme
    # of a reader: ...
    "cure",  # what helps against an unstable step whose critical step is not known
    "lost energy",  # the warning, up to a percentage, where internal forces did other work than the bodies store
    "delassus",  # what stands in S, at ends in static balance, instead of N^T M^-1 N
    "step",  # what is special about the step of the integrator
]
Reason = str | Callable[[Any], str]  # a function is given the model


def no_springs(model: object) -> Mapping[int, float]:  # noqa: ARG001
    """Return no stiffness."""
    return {}


@dataclass(frozen=True, kw_only=True)
class Feature:
    """The facts about an optional feature that a model has; each default is that of a model without it.

    Attributes
    ----------
    name
        The method or load of the case that brings it.
    alters
        What it alters of a plain step, `EVERY_STEP` or `ELASTIC`; empty if neither.
    balanced
        Contact points whose force follows from a static balance.
    records
        Returns the `LAW` records of a law at such points, from those at other points and the diagonal of S.
    leaps
        Number of steps from one action of the internal forces of each body to the next.
    limit_ratio
        Largest stable step over that of central difference.
    forces
        Forces on nodes that depend on the motion of these, and change the step of bodies without contact, too.
    springs
        Returns what such forces add to the stiffness of the ends of bars of a model, by node.
    no_row_kernel
        Whether the kernel for bars of equal elements, which knows nothing but these, cannot advance them.
    built_for_bars
        Whether it is built for bars alone.
    sums_internal_work, dissipates
        Whether the energy ledger counts the work of the internal forces instead of the elastic energy, and whether
        linear bodies dissipate what they do not store of it.
    of_all_laws
        Whether its answer about energy holds with any contact law, even one of which nothing is known.
    held
        Returns the model with further rows in which closed contacts may hold their bodies, which a certificate examines
        too. It replaces the answer about the certificate where that model or the one without them is unstable.
    held_words
        When its contacts hold them so, in words, and the names of that state and of the one of which nothing is known.
    reasons
        Its answers, in words, to what other rooms ask; `percuss.contact.model.Model.why` returns them.
    """

    name: str
    alters: str = ""
    balanced: frozenset[int] = frozenset()
    records: Callable[[BoundLaw, Any, Floats], Any] | None = None
    leaps: tuple[int, ...] = ()
    limit_ratio: float = 1.0
    forces: tuple[NodalForce, ...] = ()
    springs: Callable[[Any], Mapping[int, float]] = no_springs
    no_row_kernel: bool = False
    built_for_bars: bool = False
    sums_internal_work: bool = False
    dissipates: bool = False
    of_all_laws: bool = False
    held: Callable[[Any], Any] | None = None
    held_words: tuple[str, str, str] = ("", "", "")
    reasons: Mapping[Question, Reason] = field(default_factory=dict)

    def why(self, question: Question, model: Any) -> str:
        """Return its answer to a question about a model, in words; empty if it has none."""
        reason = self.reasons.get(question, "")
        return reason(model) if callable(reason) else reason


def together(features: Iterable[Feature]) -> Feature:
    """Return the facts of all features as those of one; of a fact that several of them say the first one counts."""
    neutral = vars(Feature(name=""))
    said = ({name: fact for name in neutral if (fact := vars(one)[name]) != neutral[name]} for one in features)
    return Feature(**{**neutral, **ChainMap(*said)})
