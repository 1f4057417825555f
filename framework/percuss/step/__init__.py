"""One time step: the loop of leap-frog schemes, the stages of multi-stage schemes, and how kernels are bound in.

`loop` is the page of the step and `stages` that of a stage; `bulk` advances the bodies; each optional feature is a
file in `parts`. `build` binds the kernels of a run, `linked`, `linking` and `calls` call them by address. A new feature
of the step is a new file in `parts`; the loop itself stays as it is.
"""
