"""Search of files for personal data, in names, texts and metadata."""

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

#: Most findings of a kind listed per file; the rest are counted.
_MOST = 5


@dataclass(frozen=True)
class Finding:
    """A place in a file that may reveal a person, a machine or a time.

    Attributes:
        file: file name, relative to the searched path.
        place: place in the file: line and byte, field, tag.
        what: kind: ``absolute path``, ``e-mail address``, ``time stamp``, ...
        text: the text, shortened.
    """

    file: str
    place: str
    what: str
    text: str

    def __str__(self) -> str:
        """Return the finding as one line."""
        return f"{self.file}: {self.place}: {self.what} ({self.text})"


def search_files(
    path: Path, *, names: Mapping[str, str] | None = None, progress: Progress | None = None
) -> list[Finding]:
    """Search a file, or all files of a folder.

    Without ``names`` the result depends on the files alone, the same on every machine.

    Args:
        path: the file or the folder.
        names: further texts to search for -> their kind; see `names_here`.
        progress: called with the fraction done and a description.

    Raises:
        InputError: the path does not exist, or a file cannot be read.
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
    """Yield place, kind and text of possible personal data in a file's content.

    Args:
        value: content from `contents`, or a part of it.
        place: place of that part.
        field: name of the field with that value.
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
            # For long rows of numbers, the first and the last are sufficient.
            if len(value) > 16 and all(isinstance(one, int | float) for one in value):
                some = range(0, len(value), len(value) - 1)
            waiting += [(value[k], f"{place}[{k}]", field) for k in reversed(some)]
        else:
            yield from ((place, what, text) for what, text in in_value(field, value))
            if isinstance(value, str):
                yield from ((place, what, text) for _, what, text in in_text(value, names))
