"""Aligning a rig: a real frame read, its pose found, the rig's file written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.alignment.align import Alignment, Guess, align
from urbantwin.fidelity.alignment.picture import draw_alignment
from urbantwin.fidelity.alignment.pose_average import averaged
from urbantwin.fidelity.alignment.rig_file import aligned_poses, write_aligned_rig
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import ypr_from_rotation
from urbantwin.lidar import Rig
from urbantwin.lidar.mounted import dataset_frame
from urbantwin.twin import Twin

__all__ = ["Wish", "align_rig", "frame_numbers"]

#: Of several frames, at least this share must be found.
_ENOUGH = 0.5


@dataclass(frozen=True)
class Wish:
    """What is asked of an alignment: the sensor's rough pose, and which frames to use.

    Attributes:
        guess: east and north in metres, and the heading of the points' x axis in degrees
            counter-clockwise from east; what the rig says if not given.
        anywhere: search the whole region in place of a guess.
        within: how far off the guess may be, metres and degrees.
        level: the points are in the sensor's place and heading, but level with gravity.
        frames: numbers of frames of the recording, from 0; their mean pose is taken. Without any
            given, all.
        sensor: the name of the rig's sensor that recorded; only that one moves. If not given, it
            is the first, and the others move with it.
    """

    guess: tuple[float, float, float] | None = None
    anywhere: bool = False
    within: tuple[float, float] = (3.0, 15.0)
    level: bool = False
    frames: tuple[int, ...] | None = (0,)
    sensor: str | None = None


def frame_numbers(text: str) -> tuple[int, ...] | None:
    """Return the numbers that ``0,5,10`` lists; None for ``all``.

    Raises:
        InputError: it is neither.
    """
    if text.strip().lower() == "all":
        return None
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and len(part) < 10 for part in parts):
        raise InputError(f"frames are {text!r}", expected="numbers like 0,5,10, or all")
    return tuple(dict.fromkeys(int(part) for part in parts))


def align_rig(
    real: Path,
    twin: Twin,
    rig: Rig,
    source: Path,
    target: Path,
    wish: Wish | None = None,
    progress: Callable[[float, str], None] | None = None,
    picture: Path | None = None,
) -> Alignment:
    """Find the pose of a rig's sensor from real frames, and write the rig.

    Args:
        real: a recording of that sensor.
        twin: where it stands.
        rig: as it stands now.
        source: the rig's file.
        target: the file to write; nothing is written where the place is not found.
        wish: what is known about where it is.
        progress: called with the fraction done (0..1) and what is being done.
        picture: a PNG of the points over the twin to write beside it.

    Raises:
        InputError: see `align.align`, of more than half of the frames; frames from different
            places; a frame or a sensor that is not there; two contradictory wishes; a rig
            that rides; a target inside a twin, whose files are sealed.
    """
    wish = wish or Wish()
    guess, within = wish.guess, wish.within
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
    number = _number(rig, wish.sensor, source)
    recording = open_recording(real)
    frames = wish.frames if wish.frames is not None else tuple(range(len(recording)))
    missing = [frame for frame in frames if not 0 <= frame < len(recording)]
    if missing or not frames:
        raise InputError(
            f"has no frame {missing[0]}" if missing else "has no frames",
            file=real,
            expected=f"0 to {len(recording) - 1}",
        )
    points_in: Literal["sensor", "level"] = "level" if wish.level else "sensor"
    rough = None
    if not wish.anywhere:
        if guess is None:
            pose = dataset_frame(points_in, rig.sensors[number].site_SE3_sensor)
            yaw = float(np.degrees(ypr_from_rotation(pose.rotation)[0]))
            guess = (float(pose.translation[0]), float(pose.translation[1]), yaw)
        rough = Guess(*guess, *within)
    found: list[Alignment] = []
    first: Frame | None = None
    failed: InputError | None = None
    for done, frame in enumerate(frames):

        def tell(share: float, text: str, done: int = done) -> None:
            if progress is not None:
                progress((done + share) / len(frames), text)

        try:
            read = recording.read(frame)
            one = align(
                read,
                twin.mesh,
                guess=rough,
                region=twin.region,
                surface=twin.surface_materials,
                file=f"{real}: {recording.names[frame]}",
                progress=tell,
            )
        except InputError as error:
            failed = failed or error
            continue
        found.append(one)
        first = first or read
    if failed is not None and (first is None or len(found) < _ENOUGH * len(frames)):
        raise failed
    assert first is not None
    mean = averaged(found, str(real))
    poses = aligned_poses(rig, mean.pose, points_in, None if wish.sensor is None else number)
    write_aligned_rig(source, target, poses)
    if picture is not None:
        draw_alignment(first, twin, mean, picture)
    return replace(mean, left_out=len(frames) - len(found))


def _number(rig: Rig, name: str | None, source: Path) -> int:
    names = [one.name for one in rig.sensors]
    if name is None:
        return 0
    if name not in names:
        raise InputError(f"has no sensor {name!r}", file=source, expected=" or ".join(names))
    return names.index(name)
