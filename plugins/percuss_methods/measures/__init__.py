"""The measures that come with percuss, beside those that every comparison shows."""
