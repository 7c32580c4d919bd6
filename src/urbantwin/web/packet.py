"""Packets of the page: a JSON header followed by arrays of numbers."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAGIC", "packet", "quantised"]

MAGIC = b"UTWP"
#: Alignment of arrays, bytes, so that the page reads them in place.
_ALIGNED = 8
#: Limits of the step of quantised positions, metres.
_FINEST_M, _COARSEST_M = 0.001, 0.005
_MOST = 65535


def packet(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return a packet: ``UTWP``, the length of the header (u32), the header, the arrays.

    Args:
        header: JSON-compatible header, to which ``arrays`` is added.
        arrays: arrays by name, of types f4, u1, u2, u4 or i4; written little-endian, row by row.
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
    """Return positions (N, 3) as integer steps from an origin, or as f4 for a large extent.

    Returns:
        ``origin`` (3) and, where positions are u2, ``step`` in metres, for the header; and the
        array: the position is ``origin + step * position``.
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
