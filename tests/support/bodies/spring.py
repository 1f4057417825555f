"""A law as a user writes it in a file of his own, which tests copy and edit."""

from dataclasses import dataclass

from percuss import ContactLaw, LinearLaw


@dataclass(frozen=True)
class Spring(ContactLaw):
    """A penalty spring."""

    name = "spring"
    summary = "Penalty spring"

    def bind(self, points, dt):
        return LinearLaw("explicit", 1 / (0.25 * points.stiffness))
