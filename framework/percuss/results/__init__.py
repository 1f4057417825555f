"""The energy ledger, true errors, results, and the run that makes them."""
