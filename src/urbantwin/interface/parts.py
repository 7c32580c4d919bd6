"""Selection of datasets and frames by part of a split: training, validation or test."""

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
    """Datasets with the selected frames of each.

    Attributes:
        folders: folders of the datasets.
        names: names of the frames of each dataset, ``None`` for all.
    """

    folders: tuple[Path, ...]
    names: tuple[tuple[str, ...] | None, ...]

    def digests(self) -> list[str | None]:
        """Return a SHA-256 of each dataset's frame names, ``None`` for all frames."""
        return [
            None if one is None else hashlib.sha256("\n".join(one).encode()).hexdigest()
            for one in self.names
        ]


def chosen_frames(given: Sequence[Path], part: str, *, place: str = "--part") -> ChosenFrames:
    """Return the datasets and frames of a part.

    Args:
        given: datasets, which are filtered by their lists (``ImageSets/``); recordings without
            lists, which belong to every part as a whole; documents of `split`, which give the
            datasets of the part; and campaigns, which are replaced by their split or else by their
            datasets.
        part: ``train``, ``val``, ``test`` or ``all``.
        place: the option, for errors.

    Raises:
        InputError: the part is unknown or empty.
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
    """Return a campaign's split document or datasets; any other path is returned as it is."""
    if kind_of(path / "index") != "campaign":
        return [path]
    from urbantwin.experiments.campaign.index import datasets_of

    divided = path / "split.json"
    return [divided] if divided.is_file() else datasets_of(path) or []


def recording_of_part(path: Path, layout: str | None, part: str) -> Recording:
    """Open a recording with the frames of a part only; see `chosen_frames`.

    Raises:
        InputError: the part is unknown or empty, or the recording cannot be read.
    """
    from urbantwin.fidelity.readers import open_recording
    from urbantwin.fidelity.readers.own import with_lost_turns

    if is_split_document(path):
        raise InputError("is a list of datasets", file=path, expected="one of them")
    (names,) = chosen_frames([path], part).names
    recording = with_lost_turns(open_recording(path, layout))
    return recording if names is None else recording.only(set(names))
