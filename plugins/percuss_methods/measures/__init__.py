"""The measures that come with percuss, in addition to those that every comparison shows."""
