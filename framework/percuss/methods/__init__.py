"""Interfaces of the methods, the registry that finds them, and the checks that admit them."""
