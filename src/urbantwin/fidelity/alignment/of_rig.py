"""Aligning a rig: a real frame read, its pose found, the rig's file written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.alignment.align import Alignment, Guess, align
from urbantwin.fidelity.alignment.rig_file import aligned_poses, write_aligned_rig
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import ypr_from_rotation
from urbantwin.lidar import Rig
from urbantwin.lidar.mounted import dataset_frame
from urbantwin.twin import Twin

__all__ = ["Wish", "align_rig"]


@dataclass(frozen=True)
class Wish:
    """What a person says about where a sensor is.

    Attributes:
        guess: east and north in metres, and the heading of the points' x axis in degrees
            counter-clockwise from east; what the rig says if not given.
        anywhere: search the whole region in place of a guess.
        within: how far off the guess may be, metres and degrees.
        level: the points are in the sensor's place and heading, but level with gravity.
        frame_number: of the recording, from 0.
    """

    guess: tuple[float, float, float] | None = None
    anywhere: bool = False
    within: tuple[float, float] = (3.0, 15.0)
    level: bool = False
    frame_number: int = 0


def align_rig(
    real: Path,
    twin: Twin,
    rig: Rig,
    source: Path,
    target: Path,
    wish: Wish | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Alignment:
    """Find the pose of a rig's first sensor from one real frame, and write the rig.

    Args:
        real: a recording of that sensor.
        twin: where it stands.
        rig: as it stands now.
        source: the rig's file.
        target: the file to write; nothing is written where the place is not found.
        wish: what is known about where it is.
        progress: told the share done (0..1) and what is being done.

    Raises:
        InputError: see `align.align`; a frame that is not there; two contradictory wishes; a rig
            that rides; a target inside a twin, whose files are sealed.
    """
    wish = wish or Wish()
    guess, within, frame_number = wish.guess, wish.within, wish.frame_number
    if guess is not None and wish.anywhere:
        raise InputError("a guess and anywhere are both given", expected="one of them")
    if not (0 < within[0] <= 200 and 0 < within[1] <= 180):
        raise InputError(
            f"the span of the search is {within[0]:g} m and {within[1]:g} degrees",
            expected="up to 200 m and 180 degrees, above 0",
        )
    if rig.ride is not None:
        raise InputError("its rig rides", file=source, place="ride", expected="one that stands")
    if (target.parent / "twin.json").exists():
        raise InputError("would change a twin", file=target, expected="a file elsewhere")
    recording = open_recording(real)
    if frame_number >= len(recording):
        raise InputError(
            f"has no frame {frame_number}", file=real, expected=f"0 to {len(recording) - 1}"
        )
    points_in: Literal["sensor", "level"] = "level" if wish.level else "sensor"
    rough = None
    if not wish.anywhere:
        if guess is None:
            pose = dataset_frame(points_in, rig.sensors[0].site_SE3_sensor)
            yaw = float(np.degrees(ypr_from_rotation(pose.rotation)[0]))
            guess = (float(pose.translation[0]), float(pose.translation[1]), yaw)
        rough = Guess(*guess, *within)
    found = align(
        recording.read(frame_number),
        twin.mesh,
        guess=rough,
        region=twin.region,
        surface=twin.surface_materials,
        file=f"{real}: {recording.names[frame_number]}",
        progress=progress,
    )
    write_aligned_rig(source, target, aligned_poses(rig, found.pose, points_in))
    return found
