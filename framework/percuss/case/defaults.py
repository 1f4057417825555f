"""Default methods of a case, by family."""

DEFAULTS = {
    "integrators": "wu-predictor-corrector",
    "contacts": "bipenalty",
    "masses": "lumped",
    "pairings": "mortar",
    "frictions": "none",
    "materials": "elastic",
    "elements": "bar",
    "solutions": "bars-in-a-row",
}
# Of a case with bodies that are no bars, in place of those above.
WITHOUT_BARS = {"contacts": "lagrange"}
# Of the finer run that judges a case: contact without compliance, and a pairing that passes the patch test.
OF_REFERENCE = {"contacts": "lagrange", "pairings": "mortar"}
OF_SLIDING = "node-to-segment"  # where surfaces slide far in space, of a finer run too: mortar does not there
