"""The elements that come with percuss."""
