"""A plain folder of clouds, or one cloud: npy, bin, pcd, ply, las, laz, mixed as they come."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import FORMATS, is_cloud, read_fields
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.box_list import BOX_LIST, frame_number, read_box_list
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.frame_list import FRAME_LIST, read_frame_list
from urbantwin.fidelity.readers.labels import boxes_of
from urbantwin.fidelity.readers.recording import Recording

__all__ = ["clouds_in", "is_plain", "open_plain"]

#: What our own clouds say of points besides the names that all writers share.
_OURS = ("semantic", "instance", "sensor")
#: Intensity in a LAS, where ours is 1.
_BRIGHTEST = 65_535


def clouds_in(folder: Path, *suffixes: str) -> list[Path]:
    """Return the clouds of a folder as people count: ``frame_200`` before ``frame_1000``.

    Args:
        folder: empty for none if it is not there.
        suffixes: of names, in lower case; all formats where none is given.
    """
    if not folder.is_dir():
        return []
    wanted = suffixes or FORMATS
    found = (p for p in folder.iterdir() if is_cloud(p) and p.name.lower().endswith(wanted))
    return sorted(found, key=counting_order)


def is_plain(path: Path) -> bool:
    """Return whether there is at least one cloud."""
    return is_cloud(path) or bool(clouds_in(path))


def open_plain(path: Path, columns: int | None) -> Recording:
    """Open a folder of clouds, or one cloud; labelled where a list of boxes is beside it.

    Raises:
        InputError: there is no cloud, or the list is not right.
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
        found = boxes.get(frame_number(file.name))
        fields = read_fields(file, columns)
        told = listed_frames.get(file.stem)
        if told is None:
            return frame_of(file, fields, name=file.name, boxes=found)
        # Beside such a list stand our own clouds: their fields are ours, too.
        given = {name: fields[name] for name in _OURS if name in fields}
        if "gps_time" in fields:
            given["time_s"] = fields["gps_time"].astype(np.float64) - told.time_s
            given["intensity"] = fields["intensity"].astype(np.float64) / _BRIGHTEST
        elif "time" in fields:
            given["time_s"] = fields["time"]
        return frame_of(
            file,
            fields,
            name=file.stem,
            given=given,
            boxes=found if found is not None or not boxes else boxes_of([]),
            world_SE3_frame=told.site_SE3_frame,
            sensor_places=told.sensor_places,
        )

    return Recording(
        path=path,
        layout="plain",
        names=tuple(file.name for file in files),
        read_frame=read,
        notes=(f"Holds files of several formats: {mixed}.",) if len(kinds) > 1 else (),
    )
