"""Bodies as arrays: their meshes and masses, the kernels of their cells, supports and loads on their nodes.

`body` has one body of any dimension, `bar` one along a line, `surfaces` the surface of a body at a region, `block` the
bodies of one kind as a step reads them. `cells`, `cell_kernels` and `materials` call the kernels of elements and
materials, `cell_stiffness` takes the stiffness of cells from them. `banded_matrices` is for bars alone, `ritz_values`
for all others. Nothing here knows of contact or of time steps. Whoever adds a shape, an element or a material touches
nothing in this folder.
"""
