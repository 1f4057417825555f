"""The compiler of kernels: binds them into templates, compiles these with numba and stores the machine code.

`specialise` binds and `compile_function` compiles; `machine_code` stores and loads what is called by address;
`fingerprint` and `readings` tell whether stored code is still that of its sources. Only `compile_function`
touches numba itself. The step asks `Specialiser` and nothing else.
"""
