"""Runs whose accounts close."""

import percuss


def ran(case, **changes):
    """Return the run of a case, with some values replaced."""
    return percuss.run(percuss.load(case, changes))


def balanced(result):
    """Return a result whose accounts close to round-off, without a note on it."""
    summary = result.summary
    assert summary["energy"]["ledger_error"] < 1e-13
    assert summary["momentum"]["error"] < 1e-12
    assert not [note for note in summary["notes"] if "not a valid result" in note]
    return result
