"""One time step: that of leap-frog schemes, the stages of multi-stage schemes, and how kernels are bound in.

`loop` is the page of the step, `stages` that of a stage; `equation`, `loads`, `account`, `record` are its paragraphs.
Bodies (`bulk`), laws with a kernel and optional parts (`parts`) enter as `actions`; `build` binds them, `linked`,
`linking` and `calls` call them by address. A new feature is a new file in `parts`; the loop stays as it is.
"""
