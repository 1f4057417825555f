"""Bodies as arrays: their meshes and masses, the kernels of their cells, supports and loads on their nodes.

`body` has one body of any dimension (a bar is a body along a line), `bodies` all of them, `surfaces` the surface of a
body at a region, `spots` a point of it. `cells`, `cell_kernels` and `materials` call the kernels of elements and
materials; a `Block` of `cell_kernels` has the bodies of one kind as a step reads them. `element_probe` asks the same
kernels for one element after the other: `cell_stiffness` takes the stiffness of cells from it, `stresses` the stress
field of a body.
`eigenvalues` finds the highest frequency of bodies from their matrices. `masses` knows which ends are in contact, and
`loads` when a load acts in a step; else nothing here knows of contact or of time steps. Whoever adds a shape, an
element or a material touches nothing in this folder.
"""
