"""What a method must say of itself, where methods are found, and whether they are sound."""
