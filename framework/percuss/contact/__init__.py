"""Contact points: which there are, the rows of N and S, the bound laws, and the records of all points.

`contact_points` finds the points of bars, `paired_surfaces` those of other bodies, as a pairing makes them.
`contact_rows` makes their rows and records (`points`), `bound_law` binds a law to them. `model_arrays` has bodies,
loads, contacts and laws together, as the rooms above read them. A law and a pairing are plug-ins: whoever adds one
touches nothing in this folder.
"""
