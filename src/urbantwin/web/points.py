"""The points of a frame as a packet."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame
from urbantwin.web.packet import packet, quantised

__all__ = ["FIELDS", "fields_of", "points_packet"]

#: Fields of points: type in the packet, and attribute of a frame.
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
    """Return the fields of a frame's points, besides positions."""
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
        frame: the frame, in the scene's frame.
        full_scale: intensity that is mapped to 255.
        fields: the ``FIELDS`` to send; zeros for missing ones.
        away: (N,) distance of each point to the nearest point of the other side, metres.
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
            # Foreign instance numbers may be larger; the page only needs to distinguish them.
            wrapped = values % (most + 1) if name == "instance" else np.clip(values, 0, most)
            arrays[name] = wrapped.astype(kind)
    if away is not None:
        arrays["away"] = np.asarray(away, np.float32)
    sensors = [[round(float(x), 4) for x in place] for place in frame.sensor_places]
    return packet({**header, "sensors": sensors}, arrays)
