"""Searching files for what they say of people: in their names, their texts and their metadata."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from urbantwin.artefact.privacy.contents import Told, told_in
from urbantwin.artefact.privacy.rules import in_text, in_value
from urbantwin.errors import InputError
from urbantwin.progress import Progress, untold

__all__ = ["Finding", "search_files"]

#: Of one file so many findings of a kind are told, and of the rest how many there are.
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
        names: what else to look for -> what it is; see `this_machine.names_here`.
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
        for one in told_in(path):
            for at, what, text in _of_told(one, names):
                if (what, text) in found:
                    continue
                counts[what] += 1
                if counts[what] <= _MOST:
                    found[what, text] = Finding(name, _place(one, at), what, text)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    more = [
        Finding(name, "further places", what, f"{count - _MOST:,} more")
        for what, count in counts.items()
        if count > _MOST
    ]
    return [*found.values(), *more]


def _of_told(one: Told, names: Mapping[str, str]) -> Iterator[tuple[int, str, str]]:
    """Yield what a text or a number says of somebody: where in it, what kind of thing, what."""
    if one.what:
        yield 0, one.what, str(one.value)
        return
    if one.field:
        for what, text in in_value(one.field, one.value):
            yield 0, what, text
    if isinstance(one.value, str):
        yield from in_text(one.value, names)


def _place(one: Told, at: int) -> str:
    """Return the line and the byte of a letter in a text that is all of a file, or the place."""
    if not isinstance(one.value, str) or not one.lines:
        return one.place
    line = one.value.count("\n", 0, at) + 1
    byte = len(one.value[:at].encode(errors="replace"))
    return f"{one.place}{', ' if one.place else ''}line {line} (byte {byte})"
