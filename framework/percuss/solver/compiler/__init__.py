"""Binding and compilation of kernels, and storage of the machine code for the next process."""
