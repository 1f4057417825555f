"""What numba compiles: loops, bulk updates, the contact equation and the kernels of laws."""
