"""The shapes that come with percuss."""
