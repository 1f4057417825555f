"""Optional features of a step, one file each: what it refuses, its arrays, and what it does in the loop."""
