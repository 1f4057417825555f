"""percuss: a bench on which explicit contact-impact methods are compared."""

__version__ = "0.1.0"
