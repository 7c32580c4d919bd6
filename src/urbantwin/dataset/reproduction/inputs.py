"""The inputs of a dataset: which are needed, where they are found, which are missing."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Literal

from urbantwin.artefact import sha256_of
from urbantwin.dataset.reproduction.source_manifest import NamedFile, SourceManifest, value_at
from urbantwin.site import ImagerySpec

__all__ = ["Found", "Search", "found_inputs", "places_to_look"]

#: Largest number of entries of a folder, with all below it, that are searched.
_MOST_ENTRIES = 100_000
#: Depth of the search below folders that were given, and below the usual ones.
_DEEP, _SHALLOW = 6, 1
_PACKED = (".3tz",)


@dataclass(frozen=True)
class Found:
    """An input, and where it is.

    Attributes:
        document: what names it: ``site``, ``rig`` or ``background``, the list of these.
        at: where in that.
        kind: ``osm``, ``dem``, ``geometry``, ``sensor``, ...
        name: its own.
        sha256: that it must have.
        licence: on what terms it may be used; empty where that is not known.
        attribution: its author.
        path: where it is; an address or a pattern of tiles; ``None`` where it is not found.
        problem: why it cannot be used, or ``None``.
        remark: what is uncertain though it can be.
    """

    document: Literal["site", "rig", "background"]
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
        names = ("kind", "name", "sha256", "licence", "attribution", "path")
        values = {name: getattr(self, name) for name in names}
        values["is"] = self.problem or self.remark or "found"
        return {key: value for key, value in values.items() if value}


class Search:
    """Folders to search, the nearest first.

    Args:
        folders: each with the depth of the search below it.
    """

    def __init__(self, folders: Iterable[tuple[Path, int]]) -> None:
        self._folders = list(folders)
        self._by_name: dict[str, list[Path]] | None = None
        self._sums: dict[Path, str] = {}

    def named(self, name: str) -> list[Path]:
        """Return the files and folders of a name, in the order of the folders to search."""
        if self._by_name is None:
            self._by_name = {}
            for folder, depth in self._folders:
                for path in islice(_entries(folder, depth), _MOST_ENTRIES):
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
        above = [(one, 0) for one in list(root.resolve().parents)[:3]]
        below = Search([(root, _DEEP), *above, (root.parent, 1)])
        below._sums = self._sums
        wrong = {}
        for name, digest in sorted(beside.items()):
            straight = root / name
            if straight.is_file() and self.sha256(straight) == digest:
                continue
            there = [one for one in (straight, *below.named(Path(name).name)) if one.is_file()]
            if not any(self.sha256(one) == digest for one in there):
                wrong[name] = "has other content" if there else "is not found"
        return wrong


def _entries(folder: Path, depth: int) -> Iterator[Path]:
    """Yield a folder and what is in it, level by level; nothing hidden, through no links."""
    yield folder.resolve() if folder.name in ("", "..") else folder
    level = [folder]
    for _ in range(depth + 1):
        deeper = []
        for place in level:
            try:
                entries = sorted(place.iterdir())
            except OSError:
                continue
            shown = [one for one in entries if not one.name.startswith(".")]
            yield from shown
            deeper += [one for one in shown if one.is_dir() and not one.is_symlink()]
        level = deeper


def places_to_look(source: SourceManifest, given: Sequence[Path]) -> Search:
    """Return where inputs are searched: in given folders, around the dataset, and here."""
    folder = source.file.parent.resolve()
    around = [folder, *folder.parents[:2]]
    usual = [*around, *(one / "site" for one in around), Path.cwd()]
    return Search([*((one, _DEEP) for one in given), *((one, _SHALLOW) for one in usual)])


def found_inputs(source: SourceManifest, search: Search, *, twin_given: bool) -> list[Found]:
    """Search for everything that a dataset is made from.

    Args:
        source: the dataset's manifest.
        search: where to search.
        twin_given: the twin is there, so that what it was made from is not needed.
    """
    sources, record = source.twin.made_from, source.record
    found = [] if twin_given else [_found(search, k, "site", sources.site) for k in sources.files]
    found += [_found(search, one, "rig", record.rig) for one in record.files if one.of is None]
    for number, one in enumerate(record.background):
        path, other = search.file(one.name, one.sha256)
        at = ("background", number)
        found.append(
            Found("background", at, "background", one.name, one.sha256, path=_absolute(path),
                  problem=None if path else _why(other, search))
        )  # fmt: skip
    return found


def _found(
    search: Search, one: NamedFile, document: Literal["site", "rig"], value: Mapping[str, Any]
) -> Found:
    at = tuple(one.at)
    kind = str(at[-1] if at[-1] in ("footprints", "control_points") else at[0])
    entry = value_at(value, at[:-1])
    terms = {
        name: str(entry[name])[:200]
        for name in ("licence", "attribution")
        if isinstance(entry, dict) and entry.get(name)
    }
    path, problem, remark = _located(search, one, entry)
    return Found(
        document, at, "sensor" if at[-1] == "model" else kind, one.name, one.sha256,
        path=path, problem=problem, remark=remark, **terms,
    )  # fmt: skip


def _located(
    search: Search, one: NamedFile, entry: Mapping[str, Any]
) -> tuple[str | None, str | None, str | None]:
    """Return where an input is, what is wrong with it, and what is uncertain."""
    if one.is_address:
        if one.shortened:
            return None, "is an address whose query or user was not kept: give --twin", None
        if entry.get("key_env") is not None:  # which a stranger may have written
            problem = "is an address that needs a key, which reproduce never sends: give --twin"
            return None, problem, None
        return one.name, None, "an address, fetched again: what it gives may have changed"
    return _tiles(search, one, entry) if one.are_tiles else _on_disk(search, one)


def _tiles(
    search: Search, one: NamedFile, entry: Mapping[str, Any]
) -> tuple[str | None, str | None, str | None]:
    """Return the pattern of local tiles whose first folder is there."""
    first = one.name.partition("/")[0]
    if first == "{z}":
        first = str(entry.get("zoom", ImagerySpec.model_fields["zoom"].default))
    folder = next((path for path in search.named(first) if path.is_dir()), None)
    if folder is None:
        return None, "is not found", None
    remark = "a pattern of tiles, which are compared by their pixels once they are read"
    return _absolute(folder.parent / one.name), None, remark


def _on_disk(search: Search, one: NamedFile) -> tuple[str | None, str | None, None]:
    """Return the file or the folder with all that belongs to it."""
    if one.sha256:
        path, other = search.file(one.name, one.sha256)
        if path is None:
            return None, _why(other, search), None
        beside = {name: digest for name, digest in one.beside.items() if name != one.name}
        if not beside or path.suffix.lower() in _PACKED:
            return _absolute(path), None, None
        places = [there for there in search.named(one.name) if search.sha256(there) == one.sha256]
    else:
        beside, places = one.beside, [path for path in search.named(one.name) if path.is_dir()]
        if not places:
            return None, "is not found", None
    # The place where most of what belongs to it is right.
    wrongs = [(place, search.wrong_beside(place, beside)) for place in places]
    path, wrong = min(wrongs, key=lambda item: len(item[1]))
    if wrong:
        name, problem = next(iter(wrong.items()))
        more = f", and {len(wrong) - 1} more of its files" if len(wrong) > 1 else ""
        return None, f"is at {path}, but {name} that belongs to it {problem}{more}", None
    return _absolute(path), None, None


def _absolute(path: Path | None) -> str | None:
    # Not through links: a file's own name goes into manifests.
    return None if path is None else os.path.abspath(path)  # noqa: PTH100


def _why(other: Path | None, search: Search) -> str:
    if other is None:
        return "is not found"
    return f"was found with other content ({other}, SHA-256 {search.sha256(other)[:12]}...)"
