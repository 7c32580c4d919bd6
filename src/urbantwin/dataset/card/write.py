"""Writing cards: into a folder that is being made, and into a dataset that is there."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from urbantwin.artefact import INVENTORY, replaced_folder, sha256_of, write_inventory
from urbantwin.artefact.inventory import read_inventory
from urbantwin.artefact.privacy import Finding, search_files
from urbantwin.dataset.card.page import (
    CARD,
    EXPORTED,
    PICTURE_OF_SPLIT,
    PICTURES,
    card_of_dataset,
    card_of_export,
    card_of_folder,
)
from urbantwin.dataset.card.statistics import read_statistics
from urbantwin.dataset.description import parts_of
from urbantwin.dataset.layout import FOLDERS
from urbantwin.errors import InputError

__all__ = [
    "carded_folders",
    "renew_cards",
    "renewed_folder",
    "told_of",
    "write_cards",
    "write_index",
]

_EXPECTED = "a dataset of `urbantwin record`, an export of one, or a folder of such"


def carded_folders(path: Path) -> dict[Path, str]:
    """Return the folders at a path that cards are of -> kind of each.

    Args:
        path: a dataset, the part of one of a sensor, an exported dataset, or a folder of them.

    Raises:
        InputError: there is none.
    """
    if not path.is_dir():
        raise InputError("is not a folder", file=path, expected=_EXPECTED)
    found = {path: kind} if (kind := _kind(path)) else {}
    above = path.resolve().parent
    if kind == "dataset" and not (path / INVENTORY).is_file() and _kind(above) == "dataset":
        return {above: "dataset"}
    for one in sorted(path.iterdir()) if not found else ():
        if one.is_dir() and not one.name.startswith(".") and (kind := _kind(one)):
            found[one] = kind
    if not found:
        raise InputError("holds no dataset", file=path, expected=_EXPECTED)
    return found


def write_cards(folder: Path, kind: str = "dataset", to: Path | None = None) -> list[Path]:
    """Write the card of a dataset; of one of several sensors, one for each and one for all.

    Args:
        folder: the dataset, or an exported one.
        kind: which of these it is.
        to: the folder to write into, which may have pictures for it; the dataset's own if not
            given.

    Returns:
        The cards.

    Raises:
        InputError: a manifest or a table is damaged.
    """
    place = folder if to is None else to
    if kind == EXPORTED:
        return [_written(place, card_of_export(folder, _privacy_of(folder)))]
    parts, cards = parts_of(folder), []
    for part in parts:
        own = place / part.relative_to(folder)
        boxes = read_statistics(part) if (part / "boxes.parquet").is_file() else None
        cards.append(_written(own, card_of_dataset(part, boxes, _privacy_of(part), own)))
    if parts != [folder]:
        cards.append(_written(place, card_of_folder(folder, parts)))
    return cards


def write_index(folder: Path, datasets: Iterable[Path], to: Path) -> Path:
    """Write the card of a folder of datasets, which links to theirs.

    Args:
        folder: that they are in.
        datasets: their folders; of one with a dataset for each sensor, these are listed.
        to: the folder to write into, in which their cards lie as the datasets in ``folder``.

    Raises:
        InputError: a manifest is damaged.
    """
    parts = [part for one in datasets for part in parts_of(one)]
    return _written(to, card_of_folder(folder, parts))


@contextmanager
def renewed_folder(folder: Path, kind: str) -> Iterator[Path]:
    """Yield a copy of an artefact without its card, which takes its place when the block succeeds.

    Files are not copied where the file system can give them a second name. Checksums of all that
    stays are kept, also of files that are damaged.

    Args:
        folder: the artefact.
        kind: its kind.

    Raises:
        InputError: it has no inventory, it holds other files, or its card was changed by hand.
        StageError: the disk is full.
    """
    if not (folder / INVENTORY).is_file():
        raise InputError(
            f"has no inventory ({INVENTORY}): nothing in it is replaced",
            file=folder,
            expected="another place for the card (-o)",
        )
    sums = read_inventory(folder)
    cards = [name for name in sums if name.rpartition("/")[2] == CARD]
    for name in cards:
        path = folder / name
        if path.is_file() and sha256_of(path) != sums[name]:
            raise InputError(
                f"{name} was changed by hand, which would be lost",
                file=folder,
                expected="another place for the card (-o), or the file moved away",
            )
    with replaced_folder(folder, kind=kind) as scratch:
        kept = {name: digest for name, digest in sums.items() if name not in cards}
        for name in kept:
            (scratch / name).parent.mkdir(parents=True, exist_ok=True)
            if (folder / name).is_file():
                _second_name(folder / name, scratch / name)
        with told_of(folder, scratch):
            yield scratch
        drawn = {f"pictures/{name}" for name in PICTURES}
        known = {
            name: digest
            for name, digest in kept.items()
            if not any(name.endswith(one) for one in drawn)
        }
        write_inventory(scratch, known=known)


@contextmanager
def told_of(folder: Path, scratch: Path) -> Iterator[None]:
    """Name the file of an artefact in errors, not the second name that it has in scratch."""
    try:
        yield
    except InputError as error:
        file = None if error.file is None else Path(error.file)
        if file is None or not file.is_relative_to(scratch):
            raise
        raise InputError(
            error.problem,
            file=folder / file.relative_to(scratch),
            place=error.place,
            expected=error.expected,
        ) from None


def renew_cards(folder: Path, sums: Mapping[str, str], redraw: Callable[[Path], None]) -> set[str]:
    """Write what tells the split of a dataset anew: its cards, and a picture of each.

    What is not there is not written, and a card that was changed by hand stays.

    Args:
        folder: the dataset; its files may have other names, which keep what they are.
        sums: checksums of its files before.
        redraw: draws the picture of a dataset that tells its split.

    Returns:
        The names of the files that were written.

    Raises:
        InputError: a table is damaged.
    """
    written = set()
    for part in parts_of(folder):
        name = (part / "pictures" / PICTURE_OF_SPLIT).relative_to(folder).as_posix()
        if name in sums:
            redraw(part)
            written.add(name)
    cards = [name for name in sums if name.rpartition("/")[2] == CARD]
    if cards and all(sha256_of(folder / name) == sums[name] for name in cards):
        for name in cards:
            (folder / name).unlink()
        written |= {one.relative_to(folder).as_posix() for one in write_cards(folder)}
    return written


def _written(folder: Path, text: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / CARD).write_text(text, encoding="utf-8")
    return folder / CARD


def _second_name(old: Path, new: Path) -> None:
    try:
        os.link(old, new, follow_symlinks=False)
    except OSError:  # a file system without links
        shutil.copy2(old, new)


def _kind(folder: Path) -> str | None:
    return next((one for one in ("dataset", EXPORTED) if (folder / f"{one}.json").is_file()), None)


def _privacy_of(dataset: Path) -> list[Finding]:
    """Search a dataset for what its files say of people, the same on every machine.

    Of the files of frames, which hold numbers and names of classes, nothing is searched.

    Raises:
        InputError: a file cannot be read.
    """
    found: list[Finding] = []
    for path in sorted(dataset.iterdir()):
        if path.name in (*FOLDERS, CARD, "done") or path.name.startswith("."):
            continue
        inside = search_files(path)
        if path.is_dir():
            inside = [
                Finding(f"{path.name}/{one.file}", one.place, one.what, one.text) for one in inside
            ]
        found += inside
    return found
