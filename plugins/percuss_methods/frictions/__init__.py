"""The frictions that come with percuss."""
