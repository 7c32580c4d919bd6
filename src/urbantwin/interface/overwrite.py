"""The option ``overwrite`` of functions whose outputs are single files."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from urbantwin.artefact import overwriting

__all__ = ["may_overwrite"]

_P = ParamSpec("_P")
_T = TypeVar("_T")


def may_overwrite(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Let a function replace any regular file where its argument ``overwrite`` says so.

    Without it only a file that urbantwin wrote for the same output is replaced
    (`artefact.written_files`).
    """

    @functools.wraps(function)
    def called(*arguments: _P.args, **named: _P.kwargs) -> _T:
        with overwriting(allowed=bool(named.get("overwrite", False))):
            return function(*arguments, **named)

    return called
