"""Studies of many runs: the plan, the workers, the file of rows, and resuming after an interruption."""
