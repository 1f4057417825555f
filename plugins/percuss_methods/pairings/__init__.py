"""The pairings that come with percuss."""
