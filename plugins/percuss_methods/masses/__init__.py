"""The mass matrices that come with percuss."""
