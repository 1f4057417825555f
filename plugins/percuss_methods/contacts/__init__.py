"""The contact laws that come with percuss."""
