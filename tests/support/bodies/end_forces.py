"""A law that sees and pushes any multiple of the end force."""

from dataclasses import dataclass
from typing import Annotated, Literal

from percuss import ContactLaw, Doc, Gt, LinearLaw, Unit


@dataclass(frozen=True)
class AnyEndForce(ContactLaw):
    """A spring of the gap and the end force F.

    Formula: ``lambda / gamma = -g - a F / gamma``, pushed by ``P = N + b Sigma / gamma``; ``c Sigma F / gamma`` always.
    """

    name = "any-end-force"
    summary = "Any multiples of the end force"
    references = ("none",)

    gamma: Annotated[float, Gt(0), Unit("1"), Doc("stiffness over kappa")] = 2.0
    a: Annotated[float, Unit("1"), Doc("what is seen")] = 1.0
    b: Annotated[float, Unit("1"), Doc("what is pushed")] = 1.0
    c: Annotated[float, Unit("1"), Doc("what always acts")] = 1.0
    at: Annotated[Literal["explicit", "end"], Doc("time of evaluation")] = "end"
    until: Annotated[float, Unit("time"), Doc("time at which it stops to act; 0 for never")] = 0.0

    def bind(self, points, dt):
        share = 1.0 / (self.gamma * points.trace_stiffness)
        return LinearLaw(
            at=self.at,
            sigma=share,
            active="all",
            sign=">= 0",
            sees=self.a * share,
            pushes=self.b * share,
            softens=self.c * share,
            during=[(-1.0, self.until)] if self.until else None,
        )

    def resolved(self, points, dt):
        return {"gamma": self.gamma * points.trace_stiffness}
