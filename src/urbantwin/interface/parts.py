"""Which frames of datasets a command may see: those of training, validation or test."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.artefact import kind_of
from urbantwin.dataset.split import PARTS, frames_of_part, is_split_document, read_split_document
from urbantwin.errors import InputError

__all__ = ["ChosenFrames", "chosen_frames", "recording_of_part"]

if TYPE_CHECKING:
    from urbantwin.fidelity.readers import Recording

_ALL = "all"


@dataclass(frozen=True)
class ChosenFrames:
    """Datasets and the frames of each that may be seen.

    Attributes:
        folders: of the datasets.
        names: of the frames of each, all for ``None``.
    """

    folders: tuple[Path, ...]
    names: tuple[tuple[str, ...] | None, ...]

    def digests(self) -> list[str | None]:
        """Return what tells the frames of each from others, ``None`` for all of them."""
        return [
            None if one is None else hashlib.sha256("\n".join(one).encode()).hexdigest()
            for one in self.names
        ]


def chosen_frames(given: Sequence[Path], part: str, *, place: str = "--part") -> ChosenFrames:
    """Return the datasets and frames of a part.

    Args:
        given: datasets, of whose lists (``ImageSets/``) the part is taken; recordings without
            lists, which are all of every part; documents of `split`, of which the datasets of
            the part are taken whole; and campaigns, which stand for their split, or else for
            their datasets.
        part: ``train``, ``val``, ``test`` or ``all``.
        place: the option, for errors.

    Raises:
        InputError: there is no such part, or it is empty.
    """
    if part not in (*PARTS, _ALL):
        raise InputError(
            f"unknown part {part!r:.40}", place=place, expected=", ".join((*PARTS, _ALL))
        )
    folders: list[Path] = []
    names: list[tuple[str, ...] | None] = []
    for path in (one for several in given for one in _of_campaign(several)):
        if is_split_document(path):
            found = read_split_document(path).datasets(part)
            folders += found
            names += [None if part == _ALL else kept for kept in found.values()]
            continue
        listed = None if part == _ALL else frames_of_part(path, part)
        if listed == []:
            raise InputError(
                f"names no frame for {part}", file=path / "ImageSets" / f"{part}.txt",
                expected=f"frames, or {place} {_ALL}; `urbantwin dataset split` divides it anew",
            )  # fmt: skip
        folders.append(path)
        names.append(None if listed is None else tuple(listed))
    return ChosenFrames(tuple(folders), tuple(names))


def _of_campaign(path: Path) -> list[Path]:
    """Return what a campaign stands for; anything else stands for itself."""
    if kind_of(path / "index") != "campaign":
        return [path]
    from urbantwin.experiments.campaign.index import datasets_of

    divided = path / "split.json"
    return [divided] if divided.is_file() else datasets_of(path) or []


def recording_of_part(path: Path, layout: str | None, part: str) -> Recording:
    """Open a recording with the frames of a part alone; see `chosen_frames`.

    Raises:
        InputError: there is no such part, it is empty, or the recording cannot be read.
    """
    from urbantwin.fidelity.readers import open_recording
    from urbantwin.fidelity.readers.own import with_lost_turns

    if is_split_document(path):
        raise InputError("is a list of datasets", file=path, expected="one of them")
    (names,) = chosen_frames([path], part).names
    recording = with_lost_turns(open_recording(path, layout))
    return recording if names is None else recording.only(set(names))
