"""The inputs of a dataset: which are needed, where they are found, which are missing."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from urbantwin.artefact import sha256_of
from urbantwin.dataset.reproduction.source_manifest import NamedFile, SourceManifest, value_at
from urbantwin.site import ImagerySpec

__all__ = ["Found", "Search", "found_inputs", "places_to_look"]


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


#: How many folders deep is looked below those that were named, and below the usual ones.
DEEP, SHALLOW = 6, 1
_PACKED = (".3tz",)
_Kind = Literal["site", "rig", "background"]


@dataclass(frozen=True)
class Found:
    """An input, and where it lies.

    Attributes:
        document: what names it: the site, the rig or the list of backgrounds.
        at: where in that.
        kind: ``osm``, ``dem``, ``geometry``, ``sensor``, ...
        name: its own.
        sha256: that it must have.
        licence: on what terms it may be used; empty where that is not known.
        attribution: who made it.
        path: where it lies; an address or a pattern of tiles; ``None`` where it does not.
        problem: why it cannot be used, or ``None``.
        remark: what is uncertain though it can be.
    """

    document: _Kind
    at: tuple[str | int, ...]
    kind: str
    name: str
    sha256: str
    licence: str = ""
    attribution: str = ""
    path: str | None = None
    problem: str | None = None
    remark: str | None = None

    def told(self) -> dict[str, Any]:
        """Return the JSON object."""
        values = {
            "kind": self.kind,
            "name": self.name,
            "sha256": self.sha256,
            "licence": self.licence,
            "attribution": self.attribution,
            "path": self.path,
            "is": self.problem or self.remark or "found",
        }
        return {key: value for key, value in values.items() if value}


def places_to_look(source: SourceManifest, given: Sequence[Path]) -> Search:
    """Return where inputs are looked for: what a person named, around the dataset, and here."""
    folder = source.file.parent.resolve()
    around = [folder, *folder.parents[:2]]
    beside = [one / "site" for one in around]
    return Search(
        [(one, DEEP) for one in given] + [(one, SHALLOW) for one in (*around, *beside, Path.cwd())]
    )


def found_inputs(source: SourceManifest, search: Search, *, twin_given: bool) -> list[Found]:
    """Look for everything that a dataset is made from.

    Args:
        source: the dataset's manifest.
        search: where to look.
        twin_given: the twin is there, so that what it was made from is not needed.
    """
    found = []
    if not twin_given:
        sources = source.twin.made_from
        found += [_found(search, one, "site", sources.site) for one in sources.files]
    record = source.record
    found += [_found(search, one, "rig", record.rig) for one in record.files if one.of is None]
    for number, one in enumerate(record.background):
        path, other = search.file(one.name, one.sha256)
        problem = None if path else _why(other, search)
        where = None if path is None else _absolute(path)
        at = ("background", number)
        found.append(
            Found("background", at, "background", one.name, one.sha256, path=where, problem=problem)
        )
    return found


def _found(search: Search, one: NamedFile, document: _Kind, value: Mapping[str, Any]) -> Found:
    at = tuple(one.at)
    kind = "sensor" if at[-1] == "model" else str(at[-1] if at[-1] in _PARTS else at[0])
    entry = value_at(value, at[:-1])
    terms = {
        name: str(entry[name])[:200]
        for name in ("licence", "attribution")
        if isinstance(entry, dict) and entry.get(name)
    }
    path, problem, remark = _located(search, one, entry)
    return Found(
        document, at, kind, one.name, one.sha256, path=path, problem=problem, remark=remark, **terms
    )


_PARTS = ("footprints", "control_points")


def _located(
    search: Search, one: NamedFile, entry: Mapping[str, Any]
) -> tuple[str | None, str | None, str | None]:
    """Return where an input lies, what is wrong with it, and what is uncertain."""
    if one.is_address:
        if one.shortened:
            return None, "is an address whose query or user was not kept: give --twin", None
        if entry.get("key_env") is not None:  # which a stranger may have written
            return (
                None,
                "is an address that needs a key, which reproduce never sends: give --twin",
                None,
            )
        return one.name, None, "an address, fetched again: what it gives may have changed"
    if one.are_tiles:
        return _tiles(search, one, entry)
    if not one.sha256:
        return _folder(search, one)
    return _file(search, one)


def _file(search: Search, one: NamedFile) -> tuple[str | None, str | None, str | None]:
    path, other = search.file(one.name, one.sha256)
    if path is None:
        return None, _why(other, search), None
    beside = {name: digest for name, digest in one.beside.items() if name != one.name}
    if beside and path.suffix.lower() not in _PACKED:
        same = (place for place in search.named(one.name) if search.sha256(place) == one.sha256)
        path, wrong = _best(search, same, beside)
        if wrong:
            return None, _of_several(path, wrong), None
    return _absolute(path), None, None


def _tiles(
    search: Search, one: NamedFile, entry: Mapping[str, Any]
) -> tuple[str | None, str | None, str | None]:
    """Return the pattern of local tiles whose first folder is there."""
    first = one.name.partition("/")[0]
    if first == "{z}":
        first = str(entry.get("zoom", ImagerySpec.model_fields["zoom"].default))
    for folder in search.named(first):
        if folder.is_dir():
            remark = "a pattern of tiles, which are compared by their pixels once they are read"
            return _absolute(folder.parent / one.name), None, remark
    return None, "is not found", None


def _folder(search: Search, one: NamedFile) -> tuple[str | None, str | None, str | None]:
    folders = [path for path in search.named(one.name) if path.is_dir()]
    if not folders:
        return None, "is not found", None
    path, wrong = _best(search, folders, one.beside)
    if wrong:
        return None, _of_several(path, wrong), None
    return _absolute(path), None, None


def _best(
    search: Search, places: Iterable[Path], beside: Mapping[str, str]
) -> tuple[Path, dict[str, str]]:
    """Return the place where most of what belongs to it is right, and what is wrong there."""
    wrongs = [(path, search.wrong_beside(path, beside)) for path in places]
    return min(wrongs, key=lambda item: len(item[1]))


def _of_several(path: Path, wrong: Mapping[str, str]) -> str:
    name, problem = next(iter(wrong.items()))
    more = f", and {len(wrong) - 1} more of its files" if len(wrong) > 1 else ""
    return f"is at {path}, but {name} that belongs to it {problem}{more}"


def _absolute(path: Path) -> str:
    # Not through links: a file's own name goes into manifests.
    return os.path.abspath(path)  # noqa: PTH100


def _why(other: Path | None, search: Search) -> str:
    if other is None:
        return "is not found"
    return f"was found with other content ({other}, SHA-256 {search.sha256(other)[:12]}...)"
