"""Datasets as training takes them: their frames levelled and kept, and what is in them."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from urbantwin.artefact import write_json
from urbantwin.artefact.checksum import sha256_of
from urbantwin.artefact.document import read_json_value
from urbantwin.artefact.inventory import INVENTORY
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.labelled_view import view_of
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.learn.augmentation.pasting import ObjectBank, bank_of, read_bank, write_bank
from urbantwin.learn.frames import (
    BEYOND_M,
    LevelFrame,
    level_frame_from,
    levelled,
    read_level_frame,
    refuse_upside_down,
    write_level_frame,
)
from urbantwin.learn.model import Design
from urbantwin.progress import Progress, between, each
from urbantwin.taxonomy import semantic_classes

__all__ = ["LabelledFrames", "digest_of", "labelled_frames", "unlabelled_frames"]

_INDEX = "frames.json"
_BANK = "objects.npz"
#: Semantic classes that say nothing: unlabelled, outlier.
_UNKNOWN = (0, 1)
#: Intensities are told from 0 to 1.
_MOST_INTENSITY = 1.0


@dataclass(frozen=True)
class LabelledFrames:
    """Levelled frames in a folder.

    Attributes:
        folder: of their files.
        rigs: (frames,) the number of each frame's dataset.
        objects: how many of each class count, in the order of the classes.
        points: how many points there are of each semantic class that is known.
    """

    folder: Path
    rigs: tuple[int, ...]
    objects: tuple[int, ...]
    points: Mapping[str, int]

    def __len__(self) -> int:
        """Return how many frames there are."""
        return len(self.rigs)

    def frame(self, number: int) -> LevelFrame:
        """Read one."""
        return read_level_frame(_file(self.folder, number))

    @property
    def bank(self) -> ObjectBank:
        """Objects that are cut out of them."""
        return read_bank(self.folder / _BANK)


def digest_of(dataset: Path) -> str:
    """Return what tells a dataset from another: the SHA-256 of its list of checksums.

    Of a recording without one, that of the names and sizes of its files.
    """
    sums = dataset / INVENTORY
    if sums.is_file():
        return sha256_of(sums)
    files = sorted(one for one in dataset.rglob("*") if one.is_file())
    text = "\n".join(f"{one.relative_to(dataset)} {one.stat().st_size}" for one in files)
    return hashlib.sha256(text.encode()).hexdigest()


def unlabelled_frames(
    recordings: Sequence[Path],
    design: Design,
    folder: Path,
    tell: Progress,
    *,
    names: Sequence[Collection[str] | None] | None = None,
) -> LabelledFrames:
    """Return the frames of recordings without labels, levelled; see `labelled_frames`.

    Args:
        recordings: that `open_recording` reads; no label of them is looked at.
        design: how far it looks, and whether it is told of intensities.
        folder: where levelled frames are kept.
        tell: called with the share that is done.
        names: of the frames of each recording, all for ``None``.

    Raises:
        InputError: a recording cannot be used.
    """
    index = folder / _INDEX
    if index.is_file():
        told = read_json_value(index, "an index of levelled frames")
        return LabelledFrames(folder, tuple(told["rigs"]), (), {})
    folder.mkdir(parents=True, exist_ok=True)
    rigs: list[int] = []
    for rig, path in enumerate(recordings):
        recording = _chosen(path, rig, names)
        share = between(tell, rig / len(recordings), (rig + 1) / len(recordings))
        for number in each(range(len(recording)), share, f"reading {path.name}"):
            frame = recording.read(number)
            if design.intensity:
                _check_intensity(frame, path)
            refuse_upside_down(frame, path)
            level = levelled(frame, design.range_m + BEYOND_M, intensity=design.intensity)
            write_level_frame(_file(folder, len(rigs)), level.frame)
            rigs.append(rig)
    write_json(index, {"rigs": rigs})
    return LabelledFrames(folder, tuple(rigs), (), {})


def labelled_frames(
    datasets: Sequence[Path],
    design: Design,
    folder: Path,
    tell: Progress,
    *,
    known: Collection[str] = (),
    names: Sequence[Collection[str] | None] | None = None,
) -> LabelledFrames:
    """Return the frames of datasets, levelled; what a folder already has is not made again.

    Args:
        datasets: labelled: ours, or any that `open_recording` reads.
        design: the classes, and how far it looks.
        folder: where levelled frames are kept.
        tell: called with the share that is done.
        known: classes that need not be there: the model that is begun with has learned them.
        names: of the frames of each dataset that may be seen, all for ``None``.

    Raises:
        InputError: a dataset cannot be used, or has no box of a class.
    """
    index = folder / _INDEX
    if index.is_file():
        told = read_json_value(index, "an index of levelled frames")
        return LabelledFrames(folder, tuple(told["rigs"]), tuple(told["objects"]), told["points"])
    folder.mkdir(parents=True, exist_ok=True)
    rigs: list[int] = []
    objects = np.zeros(len(design.classes), np.int64)
    points = np.zeros(256, np.int64)
    for rig, dataset in enumerate(datasets):
        recording = _chosen(dataset, rig, names)
        view = view_of(recording)
        share = between(tell, rig / len(datasets), (rig + 1) / len(datasets))
        for number in each(range(len(recording)), share, f"reading {dataset.name}"):
            frame = recording.read(number)
            if design.intensity:
                _check_intensity(frame, dataset)
            marks = None if frame.boxes is None else frame.boxes.ignored
            level = level_frame_from(
                frame,
                design.classes,
                design.range_m,
                file=dataset,
                intensity=design.intensity,
                ignored=None if marks is None else np.array([one != "" for one in marks], bool),
                labelled=view.covers,
            )
            write_level_frame(_file(folder, len(rigs)), level)
            objects += np.bincount(level.number[level.number >= 0], minlength=len(objects))
            points += np.bincount(level.semantic, minlength=256)
            rigs.append(rig)
    for name, count in zip(design.classes, objects, strict=True):
        if not count and name not in known:
            others = " ".join(
                f"--class {one}" for one, n in zip(design.classes, objects, strict=True) if n
            )
            raise InputError(
                f"no box of class {name} in {len(rigs)} frames",
                file=", ".join(map(str, datasets)),
                expected=f"boxes of every class asked for; there are some with `{others}`",
            )
    of_points = {one.name: int(points[one.id]) for one in semantic_classes().values()
                 if points[one.id] and one.id not in _UNKNOWN}  # fmt: skip
    found = LabelledFrames(folder, tuple(rigs), tuple(int(one) for one in objects), of_points)
    # A bank holds some hundred objects of each class and rig: of long datasets a part is looked at.
    some = np.unique(np.linspace(0, len(rigs) - 1, 400).astype(int))
    bank = bank_of([(found.frame(k), rigs[k]) for k in some], len(design.classes))
    write_bank(folder / _BANK, bank)
    write_json(index, {"rigs": rigs, "objects": list(found.objects), "points": of_points})
    return found


def _chosen(path: Path, number: int, names: Sequence[Collection[str] | None] | None) -> Recording:
    """Open a recording with the frames that may be seen.

    Raises:
        InputError: it cannot be read, or has none of them.
    """
    recording = open_recording(path)
    wanted = None if names is None else names[number]
    if wanted is None:
        return recording
    found = recording.only(set(wanted))
    if not len(found):
        raise InputError(
            "has no frame of its list",
            file=path,
            expected="names of its frames in ImageSets, or --part all",
        )
    return found


def _file(folder: Path, number: int) -> Path:
    return folder / f"{number:06}.npz"


def _check_intensity(frame: Frame, dataset: Path) -> None:
    if frame.intensity is None:
        raise InputError(
            "has no intensities", file=dataset, place=f"frame {frame.name}", expected="0 to 1"
        )
    most = float(np.nanmax(frame.intensity, initial=0.0))
    if most > _MOST_INTENSITY:
        raise InputError(
            f"has intensities up to {most:g}",
            file=dataset,
            place=f"frame {frame.name}",
            expected="0 to 1",
        )
