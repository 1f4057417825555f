"""Other programs on an impact of two bars: scripts for the Python of each program, without percuss.

``python SCRIPT --version`` prints the version of the program; ``python SCRIPT PROBLEM RESULT`` reads one JSON file and
writes another. A problem has `bars` (`at`, `length`, `elements`, `young`, `density`, `area`, `velocity`), of which the
second is fixed at its right end, `dt`, `steps` and `penalty`, the stiffness of a contact spring. A result has the CPU
time `seconds` of all steps, the contact `force`, compression positive, with the middle `time` of the step on which each
acts, the final `displacement` of all nodes, and `before`, that of one step earlier, or else the final `velocity`.
"""
