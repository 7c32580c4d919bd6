"""Functions that run on the nodes of a cluster, in processes started by Ray."""

from __future__ import annotations

import pickle
import platform
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from urbantwin import __version__
from urbantwin.errors import InputError
from urbantwin.processes import calculate_as_worker

__all__ = ["Agreed", "answer", "begin_and_work", "difference", "told_here"]

#: Function that returns the values that must be equal on all nodes, for equal bytes.
Agreed = Callable[[], Mapping[str, Any]]

_begun: str | None = None


def told_here(agreed: Agreed | None) -> dict[str, str]:
    """Return the values that must be equal on all nodes, as UrbanTwin's version."""
    told = {"UrbanTwin": __version__}
    for name, value in ({} if agreed is None else agreed()).items():
        if isinstance(value, Mapping):
            told |= {str(key): str(one) for key, one in value.items()}
        else:
            told[name] = str(value)
    return told


def difference(here: Mapping[str, str], there: Mapping[str, str]) -> str | None:
    """Return the first difference: ``numpy 2.1 (2.2 here)``."""
    for name, value in here.items():
        if there.get(name) != value:
            return f"{name} {there.get(name, 'missing')} ({value} here)"
    return None


def answer(packed: bytes) -> bytes:
    """Call a packed function with its arguments; return the result or the error, packed."""
    try:
        function, arguments = pickle.loads(packed)
        return _packed(True, function(*arguments))
    except Exception as error:
        return _packed(False, error)


def begin_and_work(handed: Sequence[Any], packed: bytes) -> bytes:
    """Run a task; the first time in this process, run the start function before.

    Args:
        handed: a reference to the shared start data, which Ray keeps on every node once: a packed
            ``(start, arguments, agreed, told)``.
        packed: the function and its argument.

    Returns:
        See `answer`.
    """
    global _begun  # noqa: PLW0603 - what this process has begun with is its only state
    import ray

    try:
        calculate_as_worker()
        if _begun != handed[0].hex():
            _begun = None
            # Unpickled per process, as on one machine: arrays shared by Ray are read-only.
            start, arguments, agreed, told = pickle.loads(ray.get(handed[0]))
            other = difference(told, told_here(agreed))
            if other is not None:
                raise InputError(
                    f"has {other}", place=f"node {platform.node()}", expected="the same versions"
                )
            start(*arguments)
            _begun = handed[0].hex()
    except Exception as error:
        return _packed(False, error)
    return answer(packed)


def _packed(well: bool, what: object) -> bytes:
    if isinstance(what, Exception) and not well and not isinstance(what, InputError):
        what.add_note("".join(traceback.format_exception(what)))  # lost between processes
    try:
        packed = pickle.dumps((well, what), pickle.HIGHEST_PROTOCOL)
        pickle.loads(packed)  # errors of libraries may not be picklable
    except Exception:
        why = f"{type(what).__name__}: {what}" if not well else f"{type(what).__name__} as a result"
        return pickle.dumps((False, RuntimeError(why)), pickle.HIGHEST_PROTOCOL)
    return packed
