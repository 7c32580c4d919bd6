"""Looking for files by name and SHA-256, in a few folders and not far below them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from urbantwin.artefact import sha256_of

__all__ = ["Search"]

#: So many entries of a folder, with all below it, are looked at.
MOST_ENTRIES = 100_000


class Search:
    """Folders to look in, the nearest first.

    Args:
        folders: each with how many folders deep below it is looked.
    """

    def __init__(self, folders: Iterable[tuple[Path, int]]) -> None:
        self._folders = list(folders)
        self._by_name: dict[str, list[Path]] | None = None
        self._sums: dict[Path, str] = {}

    def named(self, name: str) -> list[Path]:
        """Return the files and folders of a name, in the order of the folders to look in."""
        if self._by_name is None:
            self._by_name = {}
            for folder, depth in self._folders:
                if folder.is_dir():
                    for path in _entries(folder, depth):
                        self._by_name.setdefault(path.name, []).append(path)
        return list(dict.fromkeys(self._by_name.get(name, [])))

    def sha256(self, path: Path) -> str:
        """Return a file's SHA-256, taken once; empty where it cannot be read."""
        if path not in self._sums:
            try:
                self._sums[path] = sha256_of(path)
            except OSError:
                self._sums[path] = ""
        return self._sums[path]

    def file(self, name: str, sha256: str) -> tuple[Path | None, Path | None]:
        """Return the file of a name and a SHA-256, and else one of that name with another."""
        files = [path for path in self.named(name) if path.is_file()]
        found = next((path for path in files if self.sha256(path) == sha256), None)
        return found, None if found or not files else files[0]

    def wrong_beside(self, path: Path, beside: Mapping[str, str]) -> dict[str, str]:
        """Return what is wrong with files that belong to another, or to a folder, by name.

        Readers name them relative to the file, or without a folder where they looked in several.
        """
        root = path if path.is_dir() else path.parent
        below: Search | None = None
        wrong = {}
        for name, digest in sorted(beside.items()):
            straight = root / name
            if straight.is_file() and self.sha256(straight) == digest:
                continue
            if below is None:
                above = list(root.resolve().parents)[:3]
                below = Search([(root, 6), *((one, 0) for one in above), (root.parent, 1)])
                below._sums = self._sums
            candidates = [straight, *below.named(Path(name).name)]
            there = [one for one in candidates if one.is_file()]
            if not any(self.sha256(one) == digest for one in there):
                wrong[name] = "has other content" if there else "is not found"
        return wrong


def _entries(folder: Path, depth: int) -> Iterable[Path]:
    """Yield a folder and what is in it, level by level; nothing hidden, through no links."""
    yield folder.resolve() if folder.name in ("", "..") else folder
    level, count = [folder], 0
    for _ in range(depth + 1):
        deeper = []
        for place in level:
            try:
                with os.scandir(place) as found:
                    entries = sorted(found, key=lambda one: one.name)
            except OSError:
                continue
            for entry in entries:
                count += 1
                if count > MOST_ENTRIES:
                    return
                if entry.name.startswith("."):
                    continue
                yield place / entry.name
                if entry.is_dir(follow_symlinks=False):
                    deeper.append(place / entry.name)
        level = deeper
