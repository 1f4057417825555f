"""Marks that tell the compiler how to treat a function of the loop."""

from __future__ import annotations

from typing import Any, TypeVar

Function = TypeVar("Function", bound=Any)


def called(function: Function) -> Function:
    """Mark a function that is called rather than copied into its callers, which would take the compiler long."""
    function.called = True
    return function
