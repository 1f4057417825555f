"""The march of a run: the checked model, the steppers, the driver that makes chunks of steps, and why it stopped.

`model` makes the arrays of a case and refuses what does not work together; `features` has the tables of all optional
features; `march` drives a `stepper`, which is `leapfrog` or `multistage`; `recording` lays out the
histories; `diagnosis` and `stop` say why a run ended early. Results and certificate ask `Model` and `March`; both may
be called from Python at any time.
"""
