"""From a checked case to arrays, and from arrays to time steps."""
