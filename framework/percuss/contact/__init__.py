"""Contact points: the pairs that meet, the rows of N and S, the bound laws, and the records of all points.

`contact_points` finds the pairs, `contact_rows` makes their rows and records (`points`), `bound_law` binds a law to
them. `model_arrays` has bodies, loads, contacts and laws together, as the rooms above read them. A law is a plug-in:
whoever adds one touches nothing in this folder.
"""
