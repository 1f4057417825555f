"""Default methods of a case."""

INTEGRATOR = "wu-predictor-corrector"
CONTACT = "bipenalty"
MASS = "lumped"
PAIRING = "gauss-points"
MATERIAL = "elastic"
ELEMENT = "bar"
SOLUTION = "bars-in-a-row"
