"""The summary of a run: the numbers by which runs are compared, as plain mappings with typed keys."""

from __future__ import annotations

from typing import NotRequired, TypedDict

from percuss.certificate.verdict import Certificate


class StopSummary(TypedDict):
    """Where and why a run stopped: step, time, node and likely cause."""

    step: int
    time: float
    node: int
    body: str
    node_in_body: int
    position: list[float]
    what: str
    cause: str


class PenetrationSummary(TypedDict):
    """Overlap of the bodies at a contact, and the energy that it stores."""

    largest: float
    time_mean: float
    energy: float


class ContactSummary(TypedDict):
    """Impulse, peak force, times of first closing and last opening, and penetration of a contact.

    The times are None if it never closed, that of the opening also if it is still closed at the end. With friction in
    the case: its work, the energy that it has dissipated, the energy that stick stores, the longest slide of a point.
    Of a wall that moves: its work. Of surfaces that slide far: how often a point came back inside, and the energy that
    the renewal of rows may bring.
    """

    impulse: float
    peak_force: float
    first_closed: float | None
    last_open: float | None
    closed_time: float
    penetration: PenetrationSummary
    friction_work: NotRequired[float]
    friction_dissipated: NotRequired[float]
    friction_stored: NotRequired[float]
    contact_slip: NotRequired[float]
    wall_work: NotRequired[float]
    returned_points: NotRequired[int]
    renewal: NotRequired[float | None]
    stiffness_bound: NotRequired[float]


class BodySummary(TypedDict):
    """Velocity of the centre of mass and spin of a body, before the first and after the last step.

    A body in two dimensions has one spin, anticlockwise, one in three dimensions one about each axis. Bars and bodies
    of revolution have none.
    """

    velocity_x: float
    velocity_x_first: float
    velocity_y: NotRequired[float]
    velocity_y_first: NotRequired[float]
    velocity_z: NotRequired[float]
    velocity_z_first: NotRequired[float]
    spin: NotRequired[float]
    spin_first: NotRequired[float]
    spin_x: NotRequired[float]
    spin_x_first: NotRequired[float]
    spin_y: NotRequired[float]
    spin_y_first: NotRequired[float]
    spin_z: NotRequired[float]
    spin_z_first: NotRequired[float]


class EnergySummary(TypedDict):
    """Energies and works of a run, and the error with which its ledger closes."""

    initial: float
    final: float
    max: float
    external_work: float
    contact_work: float
    external_work_max: float
    contact_work_max: float
    internal_work: float | None
    dissipated: float | None
    damped: NotRequired[float]
    bodies_error: float | None
    ledger_error: float
    ledger_allowed: float | None
    ledger_closed: bool | None
    renewal: NotRequired[float | None]


class SupportSummary(TypedDict):
    """Impulse of a support or prescribed motion on its body over the run."""

    impulse_x: float
    impulse_y: NotRequired[float]
    impulse_z: NotRequired[float]


class StretchSummary(TypedDict):
    """The cell of finite strain whose highest frequency came nearest to what the step allows.

    ``largest`` is that frequency over the one at the start, and ``time`` when it was found; ``courant`` is the Courant
    number of the cell at the start, ``courant_stretched`` that times ``largest``.
    """

    largest: float
    body: str
    cell: int
    time: float
    courant: float
    courant_stretched: float


class StretchEntries(TypedDict):
    """The entry of a summary about the stretch, which a case without bodies of finite strain lacks."""

    stretch: NotRequired[StretchSummary]


class SupportEntries(TypedDict):
    """The entry of a summary about supports, which a case without them lacks.

    A support is a region of a body under ``fixed``, by the name ``body.region``, or a load that prescribes a velocity.
    """

    supports: NotRequired[dict[str, SupportSummary]]


class MomentumSummary(TypedDict):
    """Momenta before the first and after the last step, the impulses in between, and the error of their balance.

    The angular ones count about the centre of mass of all bodies at the start, with the places at the start, of bodies
    of finite strain with those of each step; theirs are the moments of contacts instead of the impulses of walls. The
    couple of contacts is that of the pairs of forces between bodies, one of them of finite strain: their moment is no
    error where two places that press have a gap between them.
    """

    initial: list[float]
    final: list[float]
    impulse_of_loads: list[float]
    impulse_of_supports: list[float]
    impulse_of_walls: NotRequired[list[float]]
    impulse_of_contacts: NotRequired[list[float]]
    impulse_of_damping: NotRequired[list[float]]
    couple_of_contacts: NotRequired[list[float]]
    error: float
    balanced: bool | None


class GrowthSummary(TypedDict):
    """Energy growth of a run, and whether it is within the guarantee of its pair of methods.

    Attributes
    ----------
    guarantee
        Energy guarantee of the certificate.
    quantity
        The measured energy in words.
    largest, step, time
        Largest rise above the smallest value so far, over the largest energy of the run, and where it ends.
    between_switchings
        Largest sum of changes over steps in which no contact whose law uses the current gap opens or closes, over the
        largest energy of the run.
    allowed, kept
        Allowed growth, and whether it is kept; None where nothing is guaranteed or nothing can be verified.
    """

    guarantee: str
    quantity: str
    largest: float
    step: int | None
    time: float | None
    between_switchings: float
    allowed: float | None
    kept: bool | None


class ContactErrors(TypedDict):
    """Errors of the force history of one contact, and the intervals in which the exact contact is closed.

    An error is None where it is not known; all of them are if not every step is recorded.

    Attributes
    ----------
    force_error_l1, force_error_l2, impulse_error
        Relative errors of the force in L1 and L2, and of the impulse.
    noise
        Total variation of the force over that of the exact force: 1 is exact.
    overshoot
        Largest force over the largest exact one, less 1. None against a finer run, whose peak is off too.
    closing_error, opening_error
        Delay of the middle of the first and of the last step with a contact force, known to half a step.
    exact_impulse
        Largest impulse of the exact force up to a step.
    closed
        Intervals in which the exact contact is closed.
    """

    force_error_l1: float | None
    force_error_l2: float | None
    impulse_error: float | None
    noise: float | None
    overshoot: float | None
    closing_error: float | None
    opening_error: float | None
    exact_impulse: float | None
    closed: list[list[float]]


class ExactErrors(TypedDict):
    """True errors of a run, by contact and of the displacement, and the exact solution that told them.

    Attributes
    ----------
    reached, until
        Time up to which the solution of the whole run holds, and of a run that it covers in part.
    second, apart
        Of estimates by two finer runs: the errors against the second, and those of the second against the first.
    """

    solution: str
    fronts: int
    contacts: dict[str, ContactErrors]
    reached: NotRequired[float]
    until: NotRequired[float]
    displacement_error: NotRequired[float | None]
    second: NotRequired[ExactErrors]
    apart: NotRequired[ExactErrors]


class ExactEntries(TypedDict):
    """The entries of a summary about the exact solution.

    Attributes
    ----------
    exact
        True errors of the whole run, None if they are not known.
    exact_reason
        Reason why they are not known.
    exact_covered
        True errors of the part that the exact solution covers, if it ends before the run.
    estimated
        Errors against a finer run, which stand for the true errors where the case asks for them.
    """

    exact: ExactErrors | None
    exact_reason: str | None
    exact_covered: ExactErrors | None
    estimated: ExactErrors | None


class Summary(ExactEntries, SupportEntries, StretchEntries):
    """The summary of a run; angular momentum is counted of solids."""

    status: str
    stop: StopSummary | None
    steps: int
    stages: int
    nodes: int
    dt: float
    end: float
    courant: float
    certificate: Certificate
    fragile: bool | None
    contacts: dict[str, ContactSummary]
    bodies: dict[str, BodySummary]
    energy: EnergySummary
    momentum: MomentumSummary
    angular_momentum: MomentumSummary | None
    energy_growth: GrowthSummary
    compiled: bool
    compiled_why: list[str]
    threads: int
    notes: list[str]
    seconds: dict[str, float]
