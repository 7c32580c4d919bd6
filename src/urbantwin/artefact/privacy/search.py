"""Searching files for what they say of people: in their names, their texts and their metadata."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from urbantwin.artefact.privacy.contents import Marked, Text, content_of_file
from urbantwin.artefact.privacy.rules import in_text, in_value
from urbantwin.errors import InputError
from urbantwin.progress import Progress, untold

__all__ = ["Finding", "search_files"]

#: Findings of a kind that are listed of one file; the rest are counted.
_MOST = 5


@dataclass(frozen=True)
class Finding:
    """A place in a file that may say something of a person, a machine or a moment.

    Attributes:
        file: its name, relative to what was searched.
        place: where in it: a line and a byte, a field, a tag.
        what: kind of thing: ``absolute path``, ``e-mail address``, ``time stamp``, ...
        text: what it says, shortened.
    """

    file: str
    place: str
    what: str
    text: str

    def __str__(self) -> str:
        """Return it as one line."""
        return f"{self.file}: {self.place}: {self.what} ({self.text})"


def search_files(
    path: Path, *, names: Mapping[str, str] | None = None, progress: Progress | None = None
) -> list[Finding]:
    """Search a file, or all files of a folder.

    Without ``names`` the result depends on the files alone, the same on every machine.

    Args:
        path: the file or the folder.
        names: what else to search for -> what it is; see `names_here`.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: it is not there, or a file cannot be read.
    """
    if not path.exists():
        raise InputError("not found", file=path, expected="a file or a folder to search")
    tell = progress or untold
    files = [path] if path.is_file() else list(_files(path))
    found: list[Finding] = []
    for number, file in enumerate(files):
        name = file.name if path.is_file() else file.relative_to(path).as_posix()
        tell(number / max(len(files), 1), f"searching {name}")
        found += _in_file(file, name, names or {})
    return found


def _files(folder: Path) -> Iterator[Path]:
    for above, folders, names in os.walk(folder):
        folders.sort()
        yield from (Path(above) / name for name in sorted(names))


def _in_file(path: Path, name: str, names: Mapping[str, str]) -> list[Finding]:
    found = {
        (what, text): Finding(name, "its name", what, text)
        for _, what, text in in_text(name, names)
    }
    counts: Counter[str] = Counter()
    try:
        content = content_of_file(path)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    for place, what, text in _found_in(content, "", "", names):
        if (what, text) not in found:
            counts[what] += 1
            if counts[what] <= _MOST:
                found[what, text] = Finding(name, place, what, text)
    more = [
        Finding(name, "further places", what, f"{count - _MOST:,} more")
        for what, count in counts.items()
        if count > _MOST
    ]
    return [*found.values(), *more]


def _found_in(
    value: object, place: str, field: str, names: Mapping[str, str]
) -> Iterator[tuple[str, str, str]]:
    """Yield the place, the kind and the text of what a file's content may say of somebody.

    Args:
        value: what `contents` makes of a file, or a part of it.
        place: of that part.
        field: name of the field that it is the value of.
        names: see `search_files`.
    """
    waiting = [(value, place, field)]  # a document may be nested deeper than Python calls
    while waiting:
        value, place, field = waiting.pop()
        if isinstance(value, Marked):
            yield place, value.what, value.text
        elif isinstance(value, datetime):
            yield place, "time stamp", str(value)
        elif isinstance(value, Text):
            for at, what, text in in_text(value.text, names):
                line = value.text.count("\n", 0, at) + 1
                byte = len(value.text[:at].encode(errors="replace"))
                yield f"{place}{place and ': '}line {line} (byte {byte})", what, text
        elif isinstance(value, dict):
            for key in value:
                yield from ((place, what, text) for _, what, text in in_text(str(key), names))
            waiting += [
                (inner, f"{place}{place and '.'}{key}", str(key))
                for key, inner in reversed(value.items())
            ]
        elif isinstance(value, list):
            some = range(len(value))
            # Of long rows of numbers, the first and the last say what they are.
            if len(value) > 16 and all(isinstance(one, int | float) for one in value):
                some = range(0, len(value), len(value) - 1)
            waiting += [(value[k], f"{place}[{k}]", field) for k in reversed(some)]
        else:
            yield from ((place, what, text) for what, text in in_value(field, value))
            if isinstance(value, str):
                yield from ((place, what, text) for _, what, text in in_text(value, names))
