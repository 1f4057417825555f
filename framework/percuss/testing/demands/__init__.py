"""The checks of the conformance kit, with one file for each group of components."""
