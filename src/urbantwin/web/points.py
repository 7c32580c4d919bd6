"""The points of a frame as a packet."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame
from urbantwin.web.packet import packet, quantised

__all__ = ["FIELDS", "fields_of", "points_packet"]

#: What is told of a point, its type, and where a reader has it.
FIELDS = {
    "intensity": ("u1", "intensity"),
    "ring": ("u2", "ring"),
    "column": ("u2", "column"),
    "time": ("f4", "time_s"),
    "sensor": ("u1", "sensor"),
    "semantic": ("u1", "semantic"),
    "instance": ("u2", "instance"),
}


def fields_of(frame: Frame) -> list[str]:
    """Return what a frame says of its points, besides their places."""
    return [name for name, (_, own) in FIELDS.items() if getattr(frame, own) is not None]


def points_packet(
    frame: Frame,
    *,
    full_scale: float,
    fields: list[str],
    away: NDArray[np.float64] | None = None,
) -> bytes:
    """Return the packet of a frame's points.

    Args:
        frame: in the frame of the scene.
        full_scale: the intensity that becomes 255.
        fields: which of ``FIELDS`` to send; of one that the frame lacks, zeros.
        away: (N,) distance of each point to the nearest of the other side, metres.
    """
    header, position = quantised(frame.points)
    arrays: dict[str, NDArray[Any]] = {"position": position}
    for name in fields:
        kind, own = FIELDS[name]
        values = getattr(frame, own)
        if values is None:
            arrays[name] = np.zeros(len(frame.points), kind)
        elif kind == "f4":
            arrays[name] = np.asarray(values, np.float32)
        else:
            if name == "intensity":
                values = np.rint(np.clip(values / full_scale, 0.0, 1.0) * 255.0)
            most = np.iinfo(kind).max
            # Instances of others may be larger: the page needs only to tell them apart.
            wrapped = values % (most + 1) if name == "instance" else np.clip(values, 0, most)
            arrays[name] = wrapped.astype(kind)
    if away is not None:
        arrays["away"] = np.asarray(away, np.float32)
    sensors = [[round(float(x), 4) for x in place] for place in frame.sensor_places]
    return packet({**header, "sensors": sensors}, arrays)
