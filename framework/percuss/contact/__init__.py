"""Contact points: which there are, the rows of N and S, the bound laws, and the model that holds all of it.

`pairs` finds the points where ends of bars meet, and those that a pairing makes of surfaces. `points` has them as
arrays, with their rows of N and S, and makes the records that the step reads. `laws` binds all laws to their points,
each by `bound_law`, with the `limits` of stable stiffness. `model` is the record of a case as arrays that the rooms
above read; `march.model_of_case` makes it. A law and a pairing are plug-ins: whoever adds one touches nothing in this
folder.
"""
