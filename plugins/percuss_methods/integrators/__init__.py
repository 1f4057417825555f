"""The time integrators that come with percuss."""
