"""The march of a run: the making of its model, the steppers, the driver that makes chunks of steps, and why it stopped.

`model` makes the model of a case, and models of it with another step or other laws; `refusals` says what does not work
together; `features` has the tables of all optional features; `march` drives a `stepper`, which is `leapfrog` or
`multistage`; `recording` lays out the histories; `diagnosis` and `stop` say why a run ended early. Results and
certificate ask `model_of` and `March`; both may be called from Python at any time.
"""
