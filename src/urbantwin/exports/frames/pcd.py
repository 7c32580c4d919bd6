"""PCD: a file per frame with all fields of its points; boxes and poses in lists beside it.

Source: the Point Cloud Library's file format 0.7. ``VIEWPOINT`` is the first sensor's pose in the
points' frame (x, y, z, then the quaternion w, x, y, z).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading import Frame
from urbantwin.dataset.reading.columns import POINT
from urbantwin.exports.frames.lists import Lists
from urbantwin.exports.frames.point_files import write_pcd_file
from urbantwin.exports.frames.source import FrameSource
from urbantwin.progress import Progress

__all__ = ["point_record", "write_pcd"]


def write_pcd(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write ``NAME.pcd`` (binary) for each frame, ``boxes.csv`` and ``frames.csv``."""
    with Lists(source, folder) as lists:
        for frame in source:
            tell(frame.number / len(source), f"frame {frame.name}")
            points = point_record(frame)
            sensor = next(iter(frame.site_SE3_sensors.values()))
            pose = frame.site_SE3_dataset.inverse() @ sensor
            view = (*pose.translation.tolist(), *pose.quaternion())
            viewpoint = " ".join(f"{value:.9g}" for value in view)
            write_pcd_file(folder / f"{frame.name}.pcd", points, viewpoint)
            lists.add(frame)
    return []


def point_record(frame: Frame) -> NDArray[np.void]:
    """Return all fields of points (N,) under their names in a dataset."""
    rays = frame.rays
    kinds = [(name, "<f4") for name in POINT]
    kinds += [(name, rays.dtype[name].newbyteorder("<").str) for name in rays.dtype.names or ()]
    kinds += [("semantic", "<u2"), ("instance", "<u2")]
    record = np.empty(len(frame.points), kinds)
    for axis, name in enumerate("xyz"):
        record[name] = frame.points[:, axis]
    for name in rays.dtype.names or ():
        record[name] = rays[name]
    for name in ("intensity", "semantic", "instance"):
        record[name] = getattr(frame, name)
    return record
