"""Discovery in a recording on disk: its frames read, the results written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.errors import InputError
from urbantwin.fidelity.discovery.blind_sectors import Losses, losses_of
from urbantwin.fidelity.discovery.discover import discover
from urbantwin.fidelity.discovery.picture import draw_discovery
from urbantwin.fidelity.discovery.result import Discovery
from urbantwin.fidelity.discovery.written import write_frames, write_rig
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.sampling import evenly
from urbantwin.geometry import row_keys
from urbantwin.progress import Progress, between, each
from urbantwin.reconstruct.recording import LEAST_FRAMES, Looks, RecordedFrames
from urbantwin.reconstruct.recording.beams import recorded_beams

__all__ = ["discover_recording"]

#: Most frames that are used; of longer recordings, so many that are spread evenly.
_MOST_FRAMES = 12


def discover_recording(
    real: Path,
    rig: Path,
    picture: Path,
    frames_out: Path | None,
    tell: Progress,
) -> tuple[Discovery, dict[str, Any]]:
    """Find the sensors of a recording, and write rig, picture and, if asked for, frames.

    Args:
        real: any recording that `readers.open_recording` takes; only its points are looked at.
        rig: the ``rig.yaml`` to write.
        picture: the PNG to write.
        frames_out: a folder for all frames with sensor, ring and column of each point.
        tell: called with the share done and what is being done.

    Returns:
        The sensors, and what was written.

    Raises:
        InputError: the recording cannot be read, or its sensors cannot be found.
    """
    recording = open_recording(real)
    used = evenly(len(recording), _MOST_FRAMES)
    if not used:
        raise InputError("holds no frames", file=real, expected="at least one")
    reading = between(tell, 0.0, 0.05)
    frames = [recording.read(number).points for number in each(used, reading, "reading")]
    names = [recording.names[number] for number in used]
    most = 0.9 if frames_out is None else 0.6
    try:
        found = discover(frames, names, tell=between(tell, 0.05, most))
    except InputError as error:
        raise InputError(
            error.problem, file=real, place=error.place, expected=error.expected
        ) from None
    written: dict[str, Any] = {}
    losses: list[Losses] = []
    if frames_out is not None:
        writing = between(tell, most, 0.95)
        every = (recording.read(n) for n in each(range(len(recording)), writing, "rings"))
        with replaced_folder(frames_out, kind="discovery", inputs=[real]) as folder:
            written["rays"] = write_frames(found, every, folder)
            write_json(folder / "discovery.json", {"kind": "discovery", **found.report()})
            if len(recording) >= LEAST_FRAMES:
                looks = Looks(RecordedFrames(folder))
                written["moving"] = _write_moving(looks, folder)
                losses = _losses(looks, found)
    draw_discovery(found, frames[0], picture)
    written["units"] = [str(one) for one in write_rig(found, rig, losses=losses)]
    return found, written


def _write_moving(looks: Looks, folder: Path) -> float:
    """Write which points of the folder's frames move, ``moving/NAME.npy``; return their share."""
    (folder / "moving").mkdir()
    points, moving = 0, 0
    for number, name in enumerate(looks.frames.names):
        moves = looks.moving(looks.frames.read(number))
        np.save(folder / "moving" / f"{name}.npy", moves)
        points, moving = points + len(moves), moving + int(moves.sum())
    return round(moving / max(points, 1), 4)


def _losses(looks: Looks, found: Discovery) -> list[Losses]:
    """Return where each sensor is blind, and which share of its looks is lost."""
    counted = [np.zeros(one.channels) for one in looks.frames.sensors]
    for number in range(len(looks.frames)):
        frame = looks.frames.read(number)
        for k, sensor in enumerate(looks.frames.sensors):
            mine = frame.sensor == k
            rings = frame.ring[mine]
            if found.sensors[k].dual:  # a firing with two returns is one look
                looks_of = np.column_stack([rings, frame.column[mine]])
                rings = rings[np.unique(row_keys(looks_of), axis=0, return_index=True)[1]]
            counted[k] += np.bincount(rings, minlength=sensor.channels) / len(looks.frames)
    lost = []
    for beams, points, one in zip(recorded_beams(looks), counted, found.sensors, strict=True):
        model = one.fit.unit.model
        lost.append(losses_of(beams, points, one.columns if model is None else model.columns))
    return lost
