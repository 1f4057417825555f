"""The materials that come with percuss."""
