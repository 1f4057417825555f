"""What an optional part of a step is: one file with all that a feature needs of the step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.contact.points import Rows
    from percuss.contact.state_variables import StateVariables
    from percuss.mesh.cell_kernels import Block
    from percuss.methods.interfaces import Array, Floats, Integers
    from percuss.step.actions import Action
    from percuss.step.record import Record
    from percuss.step.records import Step

Data = TypeVar("Data")


@dataclass(frozen=True)
class Setting:
    """What a part is made of: the arrays of one stretch of a run, without its actions.

    Attributes
    ----------
    model
        The model of the run.
    place
        Map from each boundary node to the index of its first boundary degree of freedom.
    order
        Numbers of the contact points in the order of the loop.
    rows
        The rows of the points in this order.
    midpoint
        Time in the middle of a step of the stretch.
    step
        The records of the step.
    record
        The histories of the run.
    variables
        The state variables of the run.
    recorded
        Numbers of the elements of each body whose stress is recorded.
    blocks
        The bodies of one kind of element and material, with an element and a material of this kind.
    made
        The parts made before, in their order.
    """

    model: Model
    place: Mapping[int, int]
    order: Sequence[int]
    rows: Rows
    midpoint: float
    step: Step
    record: Record
    variables: StateVariables
    recorded: Mapping[str, Integers]
    blocks: Sequence[tuple[Block, Any, Any]]
    made: Sequence[Part[Any]]


class Part(Generic[Data]):
    """An optional part of a step.

    A part of a model that needs it enters the step by its actions, and by what it changes in those of the bodies.

    Parameters
    ----------
    data
        The arrays and numbers that its kernels read.
    """

    def __init__(self, data: Data) -> None:
        self.data = data

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part in one stretch of a run, None if the model does not need it.

        Parameters
        ----------
        setting
            The arrays of the stretch.
        before
            The part in the stretch before, whose sums are continued; None in the first one.
        """
        raise NotImplementedError

    def actions(self) -> Iterator[Action]:
        """Yield what the part does in a step, or in a stage of a multi-stage scheme."""
        yield from ()

    def changed(self, action: Action) -> Action | None:
        """Return an action of the bodies, or the contact equation, with this part; None if it acts in its place."""
        return action

    def changing_arrays(self) -> list[Array]:
        """Return the arrays that a step changes, without those of the step itself."""
        return []

    def balance_at_rest(self, u: Floats, v: Floats) -> None:
        """Put what the part moves into balance before the first step; displacements change, velocities do not."""

    def displacement(self, step: int, u: Floats, v: Floats) -> Floats | None:  # noqa: ARG002
        """Return the displacement before a step, (nodes * dim,); None if it is u."""
        return None

    def kinetic_energy(self, v: Floats) -> float | None:  # noqa: ARG002
        """Return the kinetic energy of all bodies; None if it is that of nodal masses."""
        return None

    def impulse(self) -> Floats | None:
        """Return the impulse of the loads of the part so far, (dim,), which a leap-frog scheme does not sum up."""
        return None

    def stop(self, model: Model) -> tuple[int, str, str] | None:  # noqa: ARG002
        """Return node, observation and cause where the part has ended the run; None if it has not."""
        return None

    def sums(self) -> Mapping[str, Floats]:
        """Return what the part has summed up over the steps so far, by name."""
        return {}

    def sums_of_records(self) -> Mapping[str, Floats]:
        """Return what the part has summed up until its last record, by name: with the step behind the last one."""
        return {}

    def results(self) -> Mapping[str, Floats]:
        """Return the histories that the part records, by name."""
        return {}
