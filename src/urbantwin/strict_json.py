"""JSON of strangers: RFC 8259 and no more, with numbers that are numbers."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from typing import Any

__all__ = ["NotJsonError", "parse_json"]

#: Whole numbers that no ``int64`` holds become floats: nobody counts so far.
_LARGEST = 2**63


class NotJsonError(ValueError):
    """A text is not JSON.

    Args:
        problem: what is wrong with it, in a few words.
        place: where, if that is known: the line, the column and the byte.
    """

    def __init__(self, problem: str, place: str | None = None) -> None:
        super().__init__(problem if place is None else f"{problem} in {place}")
        self.problem = problem
        self.place = place


def parse_json(data: bytes | str, *, once: bool = False) -> Any:  # noqa: ANN401
    """Return what a JSON text holds.

    Args:
        data: the text, or its bytes in UTF-8, UTF-16 or UTF-32, with or without a mark.
        once: refuse a key that is given twice in a mapping.

    Raises:
        NotJsonError: it is not JSON, is nested deeper than Python goes, or holds NaN, Infinity or
            a number that no float can hold.
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
    """Return the line, the column and, from 0, the byte of a letter of a text."""
    line, begin = text.count("\n", 0, at) + 1, text.rfind("\n", 0, at) + 1
    # A mark that the codec took away when it read, it writes again.
    byte = len(text[:at].encode(coding, "surrogatepass"))
    return f"line {line}, column {at - begin + 1} (byte {byte})"


def _outside_strings(text: str, word: str) -> int:
    """Return where a word first stands that is no part of a string."""
    for found in re.finditer(rf'"(?:[^"\\]|\\.)*"|{re.escape(word)}', text, re.DOTALL):
        if not found[0].startswith('"'):
            return found.start()
    return 0


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
