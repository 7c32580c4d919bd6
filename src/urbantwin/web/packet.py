"""A packet: what the page reads at once, a header in JSON and arrays of numbers behind it."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAGIC", "packet", "quantised"]

MAGIC = b"UTWP"
#: Arrays begin at multiples of this, so that the page reads them in place.
_ALIGNED = 8
#: How fine positions are where two bytes reach as far as they span, metres; at most this coarse.
_FINEST_M, _COARSEST_M = 0.001, 0.005
_MOST = 65535


def packet(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return a packet: ``UTWP``, the length of the header (u32), the header, the arrays.

    Args:
        header: what can stand in JSON; ``arrays`` is added to it.
        arrays: by name, of the types f4, u1, u2, u4 or i4; little-endian, row by row.
    """
    rows, parts, offset = [], [], 0
    for name, values in arrays.items():
        kind = f"{values.dtype.kind}{values.dtype.itemsize}"
        if kind not in ("f4", "u1", "u2", "u4", "i4"):
            raise ValueError(f"{name} is of type {values.dtype}")
        data = np.ascontiguousarray(values, f"<{kind}").tobytes()
        data += bytes(-len(data) % _ALIGNED)
        rows.append({"name": name, "type": kind, "shape": list(values.shape), "offset": offset})
        parts.append(data)
        offset += len(data)
    text = json.dumps({**header, "arrays": rows}, ensure_ascii=False, allow_nan=False)
    said = text.encode(errors="replace")
    said += b" " * (-(len(MAGIC) + 4 + len(said)) % _ALIGNED)
    return b"".join([MAGIC, struct.pack("<I", len(said)), said, *parts])


def quantised(points: NDArray[np.float64]) -> tuple[dict[str, Any], NDArray[Any]]:
    """Return places (N, 3) as whole steps from an origin, or as f4 where they span too much.

    Returns:
        ``origin`` (3) and, where positions are u2, ``step`` in metres, for the header; and the
        array: ``origin + step * position`` is the place.
    """
    if not len(points):
        return {"origin": [0.0, 0.0, 0.0], "step": _FINEST_M}, np.zeros((0, 3), np.uint16)
    low = np.floor(points.min(axis=0) * 1000.0) / 1000.0
    span = float((points.max(axis=0) - low).max())
    step = max(_FINEST_M, np.ceil(span / (_MOST - 1) * 10000.0) / 10000.0)
    origin = [float(one) for one in low]
    if step > _COARSEST_M:
        return {"origin": origin}, (points - low).astype(np.float32)
    whole = np.rint((points - low) / step)
    return {"origin": origin, "step": round(float(step), 6)}, whole.astype(np.uint16)
