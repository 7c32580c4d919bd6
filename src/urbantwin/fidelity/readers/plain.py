"""A plain folder of clouds, or one cloud, of any mixture of formats."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import FORMATS, is_cloud, read_fields
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.folder import clouds_in
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import boxes_of
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.fidelity.readers.tables import (
    BOX_LIST,
    FRAME_LIST,
    frame_number,
    read_box_list,
    read_frame_list,
)

__all__ = ["is_plain", "open_plain"]

#: Fields of our own clouds that other writers do not have.
_OURS = ("semantic", "instance", "sensor")
#: Intensity in a LAS that stands for 1.
_BRIGHTEST = 65_535


def is_plain(path: Path) -> bool:
    """Return whether a path is a cloud or a folder with one."""
    return is_cloud(path) or bool(clouds_in(path))


def open_plain(path: Path, columns: int | None) -> Recording:
    """Open a folder of clouds, or one cloud; with labels where ``boxes.csv`` is beside it.

    Raises:
        InputError: there is no cloud, or the list is wrong.
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
        # Clouds beside such a list are our own exports: so are their fields.
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
