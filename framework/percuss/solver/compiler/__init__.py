"""How kernels are bound together, compiled, and kept for the next process."""
