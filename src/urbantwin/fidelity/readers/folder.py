"""Datasets that are folders of clouds with labels and poses beside them, and plain folders."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import boxes_of, letters
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.fidelity.readers.tables import (
    BOX_LIST,
    FRAME_LIST,
    frame_number,
    read_box_list,
    read_frame_list,
)
from urbantwin.geometry import Pose
from urbantwin.io.points import FORMATS, Fields, is_cloud, read_fields

__all__ = ["FolderDataset", "Labels", "clouds_in", "is_plain", "open_plain"]


def clouds_in(folder: Path, *suffixes: str) -> list[Path]:
    """Return the clouds of a folder in numeric order: ``frame_200`` before ``frame_1000``.

    Args:
        folder: the folder; if missing, the list is empty.
        suffixes: suffixes of file names, in lower case; all formats if none is given.
    """
    if not folder.is_dir():
        return []
    wanted = suffixes or FORMATS
    found = (p for p in folder.iterdir() if is_cloud(p) and p.name.lower().endswith(wanted))
    return sorted(found, key=counting_order)


class Labels(NamedTuple):
    """The labels of a recording.

    Attributes:
        read: reads the labels of a cloud, given its file, its index and its fields (which it may
            change); returns keyword arguments of `frame_of`.
        notes: notes about the whole recording.
    """

    read: Callable[[Path, int, Fields], dict[str, Any]]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class FolderDataset:
    """A dataset in which a frame is a file of points, with labels and poses in other files.

    Attributes:
        name: name of the layout.
        title: display name.
        detect: returns whether a path has this layout, by the names of files.
        clouds: returns the point files of a path in order; raises InputError for several sensors.
        labels: opens the labels of a path and its point files.
        verified: whether the reader was checked on real files of the dataset; otherwise it follows
            the published description and the development kit alone.
        pose: opens the poses: returns the pose of a cloud in the world, by its file and index.
        classes: names of object classes, in lower-case letters, that map to another class than in
            other datasets.
        columns: default number of values per row of ``.bin`` files.
        notes: notes about every recording of the dataset.
    """

    name: str
    title: str
    detect: Callable[[Path], bool]
    clouds: Callable[[Path], list[Path]]
    labels: Callable[[Path, list[Path]], Labels]
    verified: bool
    pose: Callable[[Path, list[Path]], Callable[[Path, int], Pose | None]] | None = None
    classes: Mapping[str, str] = field(default_factory=dict)
    columns: int | None = 4
    notes: tuple[str, ...] = ()

    def open(self, path: Path, columns: int | None = None) -> Recording:
        """Open the recording at a path.

        Args:
            path: a path of this layout.
            columns: values per row of ``.bin`` files.

        Raises:
            InputError: the path holds several sensors, or a file of labels or poses is invalid.
        """
        files = self.clouds(path)
        labels = self.labels(path, files)
        pose = None if self.pose is None else self.pose(path, files)

        def read(index: int) -> Frame:
            file = files[index]
            fields = read_fields(file, columns or self.columns)
            known = labels.read(file, index, fields)
            if pose is not None:
                known["world_SE3_frame"] = pose(file, index)
            if self.classes and known.get("boxes") is not None:
                boxes = known["boxes"]
                pairs = zip(boxes.source_names, boxes.class_names, strict=True)
                names = tuple(self.classes.get(letters(name), ours) for name, ours in pairs)
                known["boxes"] = replace(boxes, class_names=names)
            return frame_of(file, fields, name=file.stem, **known)

        names = tuple(file.stem for file in files)
        return Recording(path, self.name, names, read, (*self.notes, *labels.notes))


#: Fields that only our own clouds have.
_OURS = ("semantic", "instance", "sensor")
#: Intensity in a LAS file that represents 1.
_BRIGHTEST = 65_535


def is_plain(path: Path) -> bool:
    """Return whether a path is a cloud or a folder with one."""
    return is_cloud(path) or bool(clouds_in(path))


def open_plain(path: Path, columns: int | None) -> Recording:
    """Open a folder of clouds, or one cloud, with labels if there is a ``boxes.csv``.

    Raises:
        InputError: there is no cloud, or the list is invalid.
    """
    files = [path] if path.is_file() else clouds_in(path)
    if not files:
        raise InputError("holds no clouds", file=path, expected=f"{', '.join(FORMATS)} files")
    kinds = Counter(file.suffix.lower()[1:] for file in files)
    listed = files[0].parent / BOX_LIST
    boxes = read_box_list(listed) if listed.is_file() else {}
    mixed = " and ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))

    listing = files[0].parent / FRAME_LIST
    listed_frames = read_frame_list(listing) if listing.is_file() else {}

    def read(index: int) -> Frame:
        file = files[index]
        labelled = boxes.get(frame_number(file.name))
        fields = read_fields(file, columns)
        listed_frame = listed_frames.get(file.stem)
        if listed_frame is None:
            return frame_of(file, fields, name=file.name, boxes=labelled)
        # clouds beside such a list are our own exports, with our fields
        given = {name: fields[name] for name in _OURS if name in fields}
        if "gps_time" in fields:
            given["time_s"] = fields["gps_time"].astype(np.float64) - listed_frame.time_s
            given["intensity"] = fields["intensity"].astype(np.float64) / _BRIGHTEST
        elif "time" in fields:
            given["time_s"] = fields["time"]
        return frame_of(
            file,
            fields,
            name=file.stem,
            given=given,
            boxes=labelled if labelled is not None or not boxes else boxes_of([]),
            world_SE3_frame=listed_frame.site_SE3_frame,
            sensor_places=listed_frame.sensor_places,
        )

    return Recording(
        path=path,
        layout="plain",
        names=tuple(file.name for file in files),
        read_frame=read,
        notes=(f"Holds files of several formats: {mixed}.",) if len(kinds) > 1 else (),
    )
