"""Marks on functions of the loop that set how they are compiled."""

from __future__ import annotations

from typing import Any, TypeVar

Function = TypeVar("Function", bound=Any)


def called(function: Function) -> Function:
    """Mark a function that is compiled once and called; copied into its callers it would compile for too long."""
    function.called = True
    return function


def not_kept(function: Function) -> Function:
    """Mark a function whose machine code is not kept on disk by itself.

    It is handed tuples of plug-ins that neither it nor the functions it calls read. Machine code on disk names the
    modules of such tuples, and a run with other plug-ins lacks them.
    """
    function.not_kept = True
    return function
