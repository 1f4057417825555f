"""From YAML text to a checked case, every value with its line and column."""
