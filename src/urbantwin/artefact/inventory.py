"""Inventory of an artefact: its files with checksums, in the format of ``sha256sum -c``."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from urbantwin.artefact.checksum import sha256_of
from urbantwin.errors import InputError

__all__ = [
    "INVENTORY",
    "Damage",
    "damages",
    "digest_of",
    "foreign_entry",
    "read_inventory",
    "write_inventory",
]

#: File name, as is common with GNU coreutils.
INVENTORY = "SHA256SUMS"
_LINE = re.compile(r"(\\?)([0-9a-f]{64}) [ *](.+)")
_ESCAPES = {"\\\\": "\\", "\\n": "\n", "\\r": "\r"}


@dataclass(frozen=True)
class Damage:
    """A damaged file of an artefact.

    Attributes:
        name: name of the file, relative to the artefact.
        problem: ``damaged``, ``missing`` or ``foreign``.
    """

    name: str
    problem: str


def write_inventory(
    folder: Path,
    *,
    known: Mapping[str, str] | None = None,
    without: Sequence[str] = (),
    elsewhere: bool = False,
) -> None:
    """Write ``SHA256SUMS`` of all files in a folder, sorted by name.

    Args:
        folder: the artefact's folder.
        known: checksums computed while files were written, by name.
        elsewhere: whether known files are listed even if they are not in the folder.
        without: names of folders, at any level, to exclude.
    """
    scratch = folder / f".{INVENTORY}.part"
    scratch.unlink(missing_ok=True)  # left by a killed run
    sums = known or {}
    lines = []
    for name in sorted({*_files(folder), *(sums if elsewhere else ())}):
        if name != INVENTORY and not set(without).intersection(name.split("/")[:-1]):
            escaped = _escaped(name)
            said = "" if escaped == name else "\\"  # sha256sum(1) marks escaped names
            lines.append(f"{said}{sums.get(name) or sha256_of(folder / name)}  {escaped}")
    with scratch.open("w", errors="surrogateescape", newline="\n", encoding="utf-8") as stream:
        stream.writelines(f"{line}\n" for line in lines)
        stream.flush()
        os.fsync(stream.fileno())  # the file is reliable even after a loss of power
    scratch.replace(folder / INVENTORY)


def digest_of(folder: Path) -> str:
    """Return a hash that identifies an artefact: the SHA-256 of its inventory.

    Without an inventory, that of the names and sizes of its files.
    """
    inventory = folder / INVENTORY
    if inventory.is_file():
        return sha256_of(inventory)
    files = sorted(one for one in folder.rglob("*") if one.is_file())
    text = "\n".join(f"{one.relative_to(folder)} {one.stat().st_size}" for one in files)
    return hashlib.sha256(text.encode()).hexdigest()


def read_inventory(folder: Path) -> dict[str, str]:
    """Return the checksum of every file of an artefact, by name.

    Raises:
        InputError: the inventory is missing or damaged.
    """
    path = folder / INVENTORY
    try:
        text = path.read_text(errors="surrogateescape", encoding="utf-8")
    except FileNotFoundError:
        raise InputError("not found", file=path, expected="the artefact's inventory") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    sums, byte = {}, 0
    for number, line in enumerate(text.removesuffix("\n").split("\n") if text else [], start=1):
        found = _LINE.fullmatch(line)
        if not found:
            raise InputError(
                "is damaged",
                file=path,
                place=f"line {number} (byte {byte})",
                expected="a SHA-256 and a name",
            )
        byte += len(line.encode(errors="surrogateescape")) + 1
        name = found[3]
        if found[1]:
            name = re.sub(r"\\[\\nr]", lambda one: _ESCAPES[one[0]], name)
        sums[name] = found[2]
    return sums


def foreign_entry(folder: Path, named: Mapping[str, str]) -> str | None:
    """Return the first entry of a folder that is missing in an inventory, or ``None``.

    Folders count: one that is not a parent of a listed file is foreign.
    """
    ways = {"/".join(name.split("/")[:k]) for name in named for k in range(1, name.count("/") + 1)}
    for name, entry in _entries(folder):
        if entry.is_dir(follow_symlinks=False):
            if name not in ways:
                return f"{name}/"
        elif name not in named and name != INVENTORY:
            return name
    return None


def damages(
    folder: Path,
    *,
    below: str = "",
    workers: int = 1,
    progress: Callable[[float, str], None] | None = None,
) -> tuple[int, list[Damage]]:
    """Compare an artefact with its inventory.

    Args:
        folder: the artefact's folder.
        below: subfolder to check only.
        workers: number of threads for checksums.
        progress: called with the fraction done and a description.

    Returns:
        The number of checked files, and the damages, by name.

    Raises:
        InputError: the inventory is missing or damaged.
    """
    inside = f"{below}/" if below else ""
    sums = {
        name: digest for name, digest in read_inventory(folder).items() if name.startswith(inside)
    }
    found = [
        Damage(name, "foreign")
        for name in _files(folder)
        if name.startswith(inside) and name not in sums and name != INVENTORY
    ]
    with ThreadPoolExecutor(workers) as pool:
        states = pool.map(lambda item: _state(folder, *item), sums.items())
        for number, (name, state) in enumerate(zip(sums, states, strict=True), start=1):
            if state:
                found.append(Damage(name, state))
            if progress:
                progress(number / len(sums), f"{number} of {len(sums)} files")
    return len(sums), sorted(found, key=lambda one: one.name)


def _state(folder: Path, name: str, digest: str) -> str | None:
    path = folder / name
    if name.startswith("/") or ".." in Path(name).parts:
        return "foreign"
    if path.is_symlink() or not path.is_file():
        return "missing"
    try:
        return None if sha256_of(path) == digest else "damaged"
    except OSError:
        return "damaged"


def _files(folder: Path) -> Iterator[str]:
    """Yield the name of everything in a folder that is not a folder."""
    for name, entry in _entries(folder):
        if not entry.is_dir(follow_symlinks=False):
            yield name


def _entries(folder: Path, above: str = "") -> Iterator[tuple[str, os.DirEntry[str]]]:
    with os.scandir(folder) as found:
        entries = sorted(found, key=lambda one: one.name)
    for entry in entries:
        name = above + entry.name
        yield name, entry
        if entry.is_dir(follow_symlinks=False):
            yield from _entries(folder / entry.name, f"{name}/")


def _escaped(name: str) -> str:
    return name.replace("\\", "\\\\").replace("\n", "\\n").replace("\r", "\\r")
