"""Writing the card of a dataset into a folder that is being made."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from urbantwin.artefact.privacy import Finding, search_files
from urbantwin.dataset.card.page import CARD, card_of_dataset, card_of_folder
from urbantwin.dataset.card.statistics import read_statistics
from urbantwin.dataset.layout import FOLDERS

__all__ = ["privacy_of", "write_cards"]


def write_cards(folder: Path, parts: Sequence[Path]) -> None:
    """Write ``README.md`` of each dataset and, of several, of the folder that they are in.

    Args:
        folder: a dataset, or a folder with one for each sensor.
        parts: the folders of the datasets; ``folder`` itself where it is the only one.

    Raises:
        InputError: a manifest or a table is damaged.
    """
    for part in parts:
        text = card_of_dataset(part, read_statistics(part), privacy_of(part))
        (part / CARD).write_text(text)
    if list(parts) != [folder]:
        (folder / CARD).write_text(card_of_folder(folder, parts))


def privacy_of(dataset: Path) -> list[Finding]:
    """Search a dataset for what its files say of people, the same on every machine.

    Of the files of frames, which hold numbers and names of classes, nothing is searched.

    Raises:
        InputError: a file cannot be read.
    """
    found: list[Finding] = []
    for path in sorted(dataset.iterdir()):
        if path.name in (*FOLDERS, CARD) or path.name.startswith(".") or path.name == "done":
            continue
        inside = search_files(path)
        if path.is_dir():
            inside = [_below(path.name, one) for one in inside]
        found += inside
    return found


def _below(folder: str, one: Finding) -> Finding:
    return Finding(f"{folder}/{one.file}", one.place, one.what, one.text)
