"""Reading of a YAML text into a checked case, with the line and column of every value."""
