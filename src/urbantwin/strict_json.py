"""JSON of strangers: RFC 8259 and no more, with numbers that are numbers."""

from __future__ import annotations

import json
import math
from collections import Counter
from typing import Any

__all__ = ["NotJsonError", "parse_json"]

#: Whole numbers that no ``int64`` holds become floats: nobody counts so far.
_LARGEST = 2**63


class NotJsonError(ValueError):
    """A text is not JSON.

    Args:
        problem: what is wrong with it, in a few words.
        line: where, if that is known.
    """

    def __init__(self, problem: str, line: int | None = None) -> None:
        super().__init__(problem if line is None else f"{problem} in line {line}")
        self.problem = problem
        self.place = None if line is None else f"line {line}"


def parse_json(data: bytes | str, *, once: bool = False) -> Any:  # noqa: ANN401
    """Return what a JSON text holds.

    Args:
        data: the text, or its bytes in UTF-8, UTF-16 or UTF-32, with or without a mark.
        once: refuse a key that is given twice in a mapping.

    Raises:
        NotJsonError: it is not JSON, is nested deeper than Python goes, or holds NaN, Infinity or
            a number that no float can hold.
    """
    text = ""
    try:
        text = data if isinstance(data, str) else data.decode(json.detect_encoding(data))
        return json.loads(
            text.removeprefix("\ufeff"),
            parse_constant=_refused,
            parse_float=_finite,
            parse_int=_whole,
            object_pairs_hook=_once if once else None,
        )
    except json.JSONDecodeError as error:
        raise NotJsonError(error.msg, error.lineno) from None
    except _TwiceError as error:
        raise NotJsonError(f"it gives {str(error)[:40]!r} twice") from None
    except UnicodeDecodeError:
        raise NotJsonError("its bytes are no text") from None
    except _NoNumberError as error:
        found = str(error)
        line = text.count("\n", 0, max(text.find(found), 0)) + 1
        raise NotJsonError(f"it holds {found[:20]}, which is not a finite number", line) from None
    except RecursionError:
        raise NotJsonError("it is nested too deep") from None


class _NoNumberError(ValueError):
    """What stands where a number should."""


class _TwiceError(ValueError):
    """A key that a mapping has already."""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        raise _TwiceError(counts.most_common(1)[0][0])
    return found


def _refused(name: str) -> float:
    raise _NoNumberError(name)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise _NoNumberError(text)
    return value


def _whole(text: str) -> int | float:
    value = int(text) if len(text) <= 20 else _LARGEST  # times in nanoseconds have 19 digits
    return value if -_LARGEST <= value < _LARGEST else _finite(text)
