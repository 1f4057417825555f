"""The methods that come with percuss, found by walking this package: a new method is one file and no list.

Each class of a module that is a finished method, with a `name` of its own, is registered; see
`percuss.methods.registry`. A package of somebody else may do the same, or have hooks that return its classes.
"""
