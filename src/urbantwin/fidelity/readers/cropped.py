"""A recording cropped to a box about the origin of its frame."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.recording import Recording

__all__ = ["cropped_recording"]


def cropped_recording(recording: Recording, half_m: tuple[float, ...]) -> Recording:
    """Return a recording whose frames have the points within (x, y, z) metres of the origin."""
    return replace(
        recording,
        read_frame=partial(_read, recording, half_m),
        again=partial(cropped_recording, recording, half_m),
    )


def _read(recording: Recording, half_m: tuple[float, ...], index: int) -> Frame:
    frame = recording.read(index)
    inside = (np.abs(frame.points) <= half_m).all(axis=1)
    if not inside.any():
        raise InputError(
            f"frame {recording.names[index]} has no point within "
            f"{' x '.join(f'{one:g}' for one in half_m)} m of the origin",
            file=recording.path,
            expected="points in the same frame as the other side's",
        )
    return frame if inside.all() else frame.only(inside)
