"""The methods that a case means where it names none."""

INTEGRATOR = "wu-predictor-corrector"
CONTACT = "bipenalty"
MASS = "lumped"
MATERIAL = "elastic"
ELEMENT = "bar"
