"""The stop of a run before its end: step, node and reason."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

NOT_STARTED = "the certificate says unstable, so the run was not started"


Kind = Literal["contact work", "energy", "not solved", "kernel", "not started"]


@dataclass(frozen=True)
class Stop:
    """The reason for a stop of a run before its end, with the step and the node.

    Attributes
    ----------
    step
        The step after which the run was stopped.
    node
        The node at which the reason shows most.
    kind
        ``"contact work"`` or ``"energy"`` of the bodies where that grew beyond all energy put in, ``"not solved"`` for
        the contact equation, ``"kernel"`` for a fault of a plug-in, or ``"not started"``.
    what
        The observation, in words.
    cause
        The cause, if the time loop itself knows it; if empty, it is sought in the certificate.
    """

    step: int
    node: int
    kind: Kind
    what: str
    cause: str = ""
