"""Default methods of a case, by family."""

DEFAULTS = {
    "integrators": "wu-predictor-corrector",
    "contacts": "bipenalty",
    "masses": "lumped",
    "pairings": "gauss-points",
    "materials": "elastic",
    "elements": "bar",
    "solutions": "bars-in-a-row",
}
