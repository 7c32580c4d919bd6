"""LAS 1.4 and LAZ: a file per frame in the site frame, georeferenced by its CRS.

Source: ASPRS LAS 1.4 R15, point format 6 and its standard classes. Extra dimensions hold other
fields: ring, column, sensor, semantic (SemanticKITTI's number) and instance. Coordinates are in
steps of 0.1 mm, intensities in steps of 1/65,535; the GPS time field holds seconds from the start
of the motion, in double precision.
"""

from __future__ import annotations

from datetime import date
from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS

from urbantwin import __version__
from urbantwin.dataset.reading import Frame
from urbantwin.exports.frames.lists import Lists
from urbantwin.exports.frames.source import FrameSource
from urbantwin.progress import Progress
from urbantwin.taxonomy import classes_in, semantic_classes

__all__ = ["write_las", "write_laz"]

SCALE_M = 1e-4
_BRIGHTEST = 65_535
#: A fixed date for the header, so that the bytes are reproducible.
_DAY = date(2000, 1, 1)
_EXTRA = ("ring", "column", "sensor", "semantic", "instance")


def write_las(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write ``NAME.las`` for each frame, ``boxes.csv`` and ``frames.csv``."""
    return _write(source, folder, tell, ".las")


def write_laz(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write ``NAME.laz`` for each frame, ``boxes.csv`` and ``frames.csv``."""
    return _write(source, folder, tell, ".laz")


def _write(source: FrameSource, folder: Path, tell: Progress, ending: str) -> list[str]:
    crs = CRS.from_user_input(source.site.proj_with_datum)
    with Lists(source, folder, in_site=True) as lists:
        for frame in source:
            tell(frame.number / len(source), f"frame {frame.name}")
            _las_of(frame, crs).write(
                folder / f"{frame.name}{ending}", do_compress=ending == ".laz"
            )
            lists.add(frame)
    return [
        "points stand in the site's frame, rounded to 0.1 mm, intensity to 1/65535: "
        "frames.csv has the sensors' poses"
    ]


def _las_of(frame: Frame, crs: CRS) -> laspy.LasData:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, SCALE_M)
    header.offsets = np.zeros(3)
    header.creation_date = _DAY
    header.system_identifier = "UrbanTwin"
    header.generating_software = f"UrbanTwin {__version__}"
    header.add_crs(crs)
    known = frame.rays.dtype.names or ()
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams(name, "u1" if name == "sensor" else "u2")
            for name in _EXTRA
            if name in known or name in ("semantic", "instance")
        ]
    )
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = frame.site_SE3_dataset.apply(frame.xyz.astype(np.float64)).T
    cloud.intensity = np.rint(np.clip(frame.intensity, 0, 1) * _BRIGHTEST).astype(np.uint16)
    cloud.classification = _standard_classes()[frame.semantic]
    for name in ("ring", "column", "sensor"):
        if name in known:
            cloud[name] = frame.rays[name]
    cloud["semantic"], cloud["instance"] = frame.semantic, frame.instance
    if "time" in known:
        cloud.gps_time = frame.time_s + frame.rays["time"].astype(np.float64)
    echo = frame.rays["echo"] if "echo" in known else np.zeros(len(frame.points), np.uint8)
    cloud.return_number = echo + 1
    cloud.number_of_returns = echo + 1
    return cloud


def _standard_classes() -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    """Return the standard's number of each of ours, by our number."""
    ours = semantic_classes()
    table = np.zeros(max(one.id for one in ours.values()) + 1, np.uint8)
    for name, number in classes_in("las1.4", "point").items():
        table[ours[name].id] = int(number or 0)
    return table
