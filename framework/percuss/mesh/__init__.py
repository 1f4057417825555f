"""Bodies as arrays: their meshes and masses, the kernels of their cells, supports and loads on their nodes.

`body` has one body, `block` the bodies of one kind as a step reads them; `cells`, `cell_kernels` and `materials` call
the kernels of elements and materials. `banded_matrices` is for lines alone. Nothing here knows of contact or of time
steps. Whoever adds an element or a material touches nothing in this folder.
"""
