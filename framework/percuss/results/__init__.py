"""Runs of a case and their results: histories, energy ledger, true errors, and storage as NetCDF-4."""
