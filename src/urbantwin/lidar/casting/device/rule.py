"""Plain functions, which numba compiles too, as functions of Warp's."""

from collections.abc import Callable
from types import FunctionType
from typing import Any

import warp as wp

__all__ = ["on_device"]


def on_device(rule: Callable[..., Any], *kinds: object) -> wp.Function:
    """Return a plain function as one of Warp's.

    Args:
        rule: of numbers; the float constants that it names become double precision.
        kinds: Warp's type of each argument.
    """
    assert isinstance(rule, FunctionType)
    names = {
        name: wp.constant(wp.float64(value)) if isinstance(value, float) else value
        for name, value in rule.__globals__.items()
    }
    copy = FunctionType(rule.__code__, names, rule.__name__)
    copy.__module__, copy.__doc__ = rule.__module__, rule.__doc__
    arguments = rule.__code__.co_varnames[: rule.__code__.co_argcount]
    copy.__annotations__ = dict(zip(arguments, kinds, strict=True))
    return wp.func(copy)
