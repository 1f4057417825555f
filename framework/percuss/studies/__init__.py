"""Many runs: the plan of a study, its workers, its store, and going on with it."""
