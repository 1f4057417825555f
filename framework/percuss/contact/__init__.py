"""Contact points: which there are, the rows of N and S, the bound laws, and the records of all points.

`contact_points` finds the points of bars, `paired_surfaces` those of other bodies, as a pairing makes them.
`point_rows` and `contact_rows` make their rows and records (`points`), `binding` binds all laws to them, each by
`bound_law`. `model_arrays` has bodies, loads, contacts and laws together, as the rooms above read them. A law and a
pairing are plug-ins: whoever adds one touches nothing in this folder.
"""
