"""Verification of artefacts: every file present and unchanged, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from urbantwin.artefact.inventory import INVENTORY, Damage, damages
from urbantwin.artefact.output import KINDS, kind_of
from urbantwin.errors import InputError
from urbantwin.progress import Progress, untold

__all__ = ["Verified", "is_artefact", "verify"]


@dataclass(frozen=True)
class Verified:
    """Outcome of the verification of an artefact.

    Attributes:
        folder: folder of the artefact, or of its requested part.
        kind: kind of the artefact.
        files: number of checked files.
        damages: damaged, missing and foreign files.
    """

    folder: Path
    kind: str
    files: int
    damages: tuple[Damage, ...]


def verify(
    path: Path,
    *,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[Verified]:
    """Compare every artefact at a path with its inventory.

    Args:
        path: an artefact, its manifest or another file of it, a part of a dataset of several
            sensors, or a folder of artefacts, or of folders of them, as written by
            ``urbantwin run`` or ``urbantwin experiment run``.
        workers: number of threads for checksums.
        progress: called with the fraction done and a description.

    Raises:
        InputError: there is no artefact, or its inventory cannot be read.
    """
    if not path.exists():
        raise InputError("not found", file=path, expected="an artefact")
    found = list(_artefacts(path))
    if not found:
        raise InputError(
            "is not an artefact and contains none",
            file=path,
            expected=f"a folder that urbantwin wrote: {', '.join(KINDS)}",
        )
    tell = progress or untold
    verified = []
    for number, (folder, below) in enumerate(found):

        def step(share: float, doing: str, number: int = number, name: str = folder.name) -> None:
            tell((number + share) / len(found), f"{name}: {doing}")

        files, wrong = damages(folder, below=below, workers=workers, progress=step)
        kind = kind_of(folder)
        verified.append(Verified(folder / below, kind or "damaged", files, tuple(wrong)))
    return verified


def is_artefact(path: Path) -> bool:
    """Return whether there is an artefact at a path, above it or in it."""
    return path.exists() and any(True for _ in _artefacts(path))


def _artefacts(path: Path) -> Iterator[tuple[Path, str]]:
    """Yield the folder of each artefact, and the requested subfolder of it (``""`` for all)."""
    inside = path.resolve()
    if inside.is_file():
        inside = inside.parent
    around = [folder for folder in (inside, *inside.parents) if _is_artefact(folder)]
    if around:
        # A part of an artefact has a manifest but no inventory.
        folder = next((one for one in around if (one / INVENTORY).is_file()), around[0])
        below = inside.relative_to(folder).as_posix()
        yield folder, "" if below == "." else below
        return
    for entry in sorted(inside.iterdir()) if inside == path.resolve() else ():
        if not entry.is_dir() or entry.name.startswith("."):
            continue
        if _is_artefact(entry):
            yield entry, ""
        else:  # nested folders: the datasets of a campaign
            inside_it = (one for one in sorted(entry.iterdir()) if one.is_dir())
            named = (one for one in inside_it if not one.name.startswith("."))
            yield from ((one, "") for one in named if _is_artefact(one))


def _is_artefact(folder: Path) -> bool:
    """Return whether a folder is an artefact, even if its inventory is missing."""
    return (folder / INVENTORY).is_file() or kind_of(folder) is not None
