"""The solver: arrays of a checked case, and time steps on them."""
