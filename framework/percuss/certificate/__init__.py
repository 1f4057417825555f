"""Stability of the closed step: critical steps, causes and cures, stability maps, and waves at an interface."""
