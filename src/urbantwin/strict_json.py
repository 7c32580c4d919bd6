"""Strict JSON of untrusted files: RFC 8259, with finite numbers only."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from typing import Any

__all__ = ["NotJsonError", "parse_json"]

#: Integers beyond ``int64`` become floats.
_LARGEST = 2**63


class NotJsonError(ValueError):
    """A text is not JSON.

    Args:
        problem: description of the error.
        place: line, column and byte, if known.
    """

    def __init__(self, problem: str, place: str | None = None) -> None:
        super().__init__(problem if place is None else f"{problem} in {place}")
        self.problem = problem
        self.place = place


def parse_json(data: bytes | str, *, once: bool = False) -> Any:  # noqa: ANN401
    """Return the value of a JSON text.

    Args:
        data: the text, or its bytes in UTF-8, UTF-16 or UTF-32, with or without a byte order mark.
        once: reject duplicate keys.

    Raises:
        NotJsonError: the text is not JSON, is nested too deeply for Python, or holds NaN, Infinity
            or a number out of range.
    """
    text, coding = "", "utf-8"
    try:
        if isinstance(data, bytes):
            coding = json.detect_encoding(data)
        text = data if isinstance(data, str) else data.decode(coding)
        return json.loads(
            text.removeprefix("\ufeff"),
            parse_constant=_refused,
            parse_float=_finite,
            parse_int=_whole,
            object_pairs_hook=_once if once else None,
        )
    except json.JSONDecodeError as error:
        marked = text.startswith("\ufeff")
        raise NotJsonError(error.msg, _place(text, error.pos + marked, coding)) from None
    except _TwiceError as error:
        raise NotJsonError(f"it gives {str(error)[:40]!r} twice") from None
    except UnicodeDecodeError as error:
        marks = {"utf-8-sig": 3}.get(coding, 0)  # the codec counts from behind the mark
        raise NotJsonError("its bytes are no text", f"byte {error.start + marks}") from None
    except _NoNumberError as error:
        found = str(error)
        problem = f"it holds {found[:20]}, which is not a finite number"
        raise NotJsonError(problem, _place(text, _outside_strings(text, found), coding)) from None
    except RecursionError:
        raise NotJsonError("it is nested too deep") from None


def _place(text: str, at: int, coding: str) -> str:
    """Return line, column and byte (from 0) of a character position."""
    line, begin = text.count("\n", 0, at) + 1, text.rfind("\n", 0, at) + 1
    # Re-encoding adds the byte order mark again, which decoding removed.
    byte = len(text[:at].encode(coding, "surrogatepass"))
    return f"line {line}, column {at - begin + 1} (byte {byte})"


def _outside_strings(text: str, word: str) -> int:
    """Return the first position of a word outside of strings."""
    for found in re.finditer(rf'"(?:[^"\\]|\\.)*"|{re.escape(word)}', text, re.DOTALL):
        if not found[0].startswith('"'):
            return found.start()
    return 0


class _NoNumberError(ValueError):
    """A text in place of a number."""


class _TwiceError(ValueError):
    """A duplicate key."""


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
