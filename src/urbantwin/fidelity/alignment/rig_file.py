"""Writing a pose that was found back into a rig's file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from urbantwin.artefact import replaced_file
from urbantwin.errors import InputError
from urbantwin.geometry import Pose, ypr_from_rotation
from urbantwin.lidar import Rig
from urbantwin.lidar.rig import dataset_frame

__all__ = ["aligned_poses", "write_aligned_rig"]

_PLACE = (
    *("east_m", "north_m", "latitude", "longitude", "height_m", "up_m", "altitude_m"),
    *("yaw_deg", "heading_deg", "pitch_deg", "tilt_deg", "roll_deg"),
)


def aligned_poses(
    rig: Rig,
    site_SE3_frame: Pose,
    points_in: Literal["sensor", "level"] = "sensor",
    only: int | None = None,
) -> list[Pose]:
    """Return the poses of a rig's sensors of which one was found.

    Args:
        rig: as it stood before.
        site_SE3_frame: the pose of the real frame.
        points_in: the frame of the real points: the first sensor's own, or ``level``: its place
            and heading with z against gravity; its tilt is then the rig's.
        only: the number of the sensor that was found, and alone moves; if not given it was the
            first, and the others move with it.
    """
    before = rig.sensors[only or 0].site_SE3_sensor
    move = site_SE3_frame @ dataset_frame(points_in, before).inverse()
    return [
        move @ one.site_SE3_sensor if only in (None, number) else one.site_SE3_sensor
        for number, one in enumerate(rig.sensors)
    ]


def write_aligned_rig(source: Path, target: Path, poses: list[Pose]) -> None:
    """Write a rig's file with its sensors at other poses; it appears whole or not at all.

    Everything else that the file says stays, but for its comments.

    Args:
        source: the rig's file, valid.
        target: the file to write; it may be the same.
        poses: ``site_SE3_sensor`` of each sensor.

    Raises:
        InputError: the rig rides, or ``target`` is a folder.
    """
    document: dict[str, Any] = yaml.safe_load(source.read_text(encoding="utf-8"))
    if document.get("ride") is not None:
        raise InputError("its rig rides", file=source, place="ride", expected="one that stands")
    for entry, pose in zip(document["sensors"], poses, strict=True):
        for name in _PLACE:
            entry.pop(name, None)
        entry.update(_written(pose))
    with replaced_file(target, kind="align", replaces=source) as scratch:
        scratch.write_text(
            yaml.safe_dump(document, sort_keys=False, allow_unicode=True), encoding="utf-8"
        )


def _written(pose: Pose) -> dict[str, float]:
    angles = np.degrees(ypr_from_rotation(pose.rotation))
    values = dict(zip(("east_m", "north_m", "up_m"), pose.translation, strict=True))
    values |= dict(zip(("yaw_deg", "pitch_deg", "roll_deg"), angles, strict=True))
    return {name: round(float(value), 4) + 0.0 for name, value in values.items()}
