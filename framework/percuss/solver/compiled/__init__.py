"""Functions compiled by numba: loops over steps, bulk updates, the contact equation and the calls of law kernels."""
