"""The exact solutions that come with percuss."""
