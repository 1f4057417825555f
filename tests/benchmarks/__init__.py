"""Measurements. A package, as some distributions install one of the same name."""
