"""Marks on functions of the loop that set how they are compiled."""

from __future__ import annotations

from typing import Any, TypeVar

Function = TypeVar("Function", bound=Any)


def called(function: Function) -> Function:
    """Mark a function that is compiled once and called; copied into its callers it would compile for too long."""
    function.called = True
    return function
