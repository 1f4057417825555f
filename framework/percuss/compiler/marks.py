"""Marks on functions of the loop that set how they are compiled."""

from __future__ import annotations

from typing import Any, TypeVar

Function = TypeVar("Function", bound=Any)


def called(function: Function) -> Function:
    """Mark a function that is compiled once and called; copied into its callers it would compile for too long."""
    function.called = True
    return function


def fused(function: Function) -> Function:
    """Mark a function in which products are added without being rounded first, if the processor can do so.

    Each of its sums may contain one product only, so that the compiler has no choice: it computes the same bits in
    every copy, whether for one number or for several at once.
    """
    function.fused = True
    return function
