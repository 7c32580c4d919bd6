"""Foreground objects of frames without labels: sizes, shapes, numbers of points.

Objects are clusters in plan (`traffic.observed.clusters`), on both sides alike: a group of people
or two vehicles that touch are one object on either side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.histograms import jensen_shannon
from urbantwin.fidelity.sampling import sampled
from urbantwin.fidelity.sides import ANCHOR, MODEL, Side
from urbantwin.reconstruct.recording.recorded_ground import RecordedGround, recorded_ground
from urbantwin.traffic.observed.box_fit import extents, fitted_yaw
from urbantwin.traffic.observed.clusters import clusters

__all__ = ["foreground_objects", "ground_beneath", "object_divergences", "objects_of"]

#: Heights above the ground between which points form objects, metres.
_LOW_M, _HIGH_M = 0.3, 4.5
#: Clusters whose lowest point is higher are no actors but foliage in the wind, metres.
_STANDS_M = 0.9
#: Frames and points per frame from which the ground is found.
_GROUND_FRAMES, _GROUND_POINTS = 4, 60_000
_SIZE_M = np.concatenate([np.arange(0.0, 6.0, 0.5), [6.0, 8.0, 10.0, 12.0, 15.0, np.inf]])
_HEIGHT_M = np.concatenate([np.arange(0.0, 3.0, 0.25), [3.0, 3.5, 4.0, np.inf]])
_POINTS = np.concatenate([2.0 ** np.arange(3, 14), [np.inf]])
_SHARE = np.linspace(0.0, 1.0 + 1e-9, 11)
#: Property -> bin edges of its columns of `objects_of`, in order.
_BINS = {
    "size": (_SIZE_M, _SIZE_M, _HEIGHT_M),
    "shape": (_SHARE, _SHARE),
    "points": (_POINTS,),
}


def objects_of(points: NDArray[np.float64], ground: RecordedGround) -> NDArray[np.float64]:
    """Return the objects (K, 6) among the foreground points (N, 3) of one frame.

    Returns:
        Rows of length, width and height of the visible part, metres; linearity and planarity, 0..1:
        (s1 - s2) / s1 and (s2 - s3) / s1 of the standard deviations along the main axes (Weinmann
        et al. 2015); and the number of points.
    """
    above = ground.above(points) if len(points) else np.zeros(0)
    kept = (above > _LOW_M) & (above < _HIGH_M)
    points, above = points[kept], above[kept]
    rows = []
    for part in clusters(points, above):
        if above[part].min() > _STANDS_M:
            continue
        here = points[part]
        low, high = extents(here[:, :2], fitted_yaw(here[:, :2]))
        wide, long = sorted(high - low)
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(here.T))[::-1], 0.0))
        first, second, third = spread / max(spread[0], 1e-9)
        tall = float(np.ptp(above[part]))
        rows.append([long, wide, tall, first - second, second - third, len(part)])
    return np.array(rows, np.float64).reshape(-1, 6)


def object_divergences(
    real: NDArray[np.float64], other: NDArray[np.float64]
) -> dict[str, float | None]:
    """Return the Jensen-Shannon divergences of objects (K, 6) and (M, 6): size, shape, points."""
    found: dict[str, float | None] = {}
    column = 0
    for name, every in _BINS.items():
        told = []
        for edges in every:
            counts = [np.histogram(side[:, column], edges)[0] for side in (real, other)]
            told.append(jensen_shannon(*counts))
            column += 1
        given = [one for one in told if one is not None]
        found[name] = float(np.mean(given)) if len(given) == len(told) else None
    return found


def foreground_objects(
    found: Mapping[str, Sequence[NDArray[np.float64]]],
) -> dict[str, Any] | None:
    """Return objects per frame by side, and the divergences of sizes, shapes and points.

    Real against real compares the real frames with the anchor's, or their two halves.

    Args:
        found: objects (K, 6) of each frame of "real", "synthetic" and, if there is one, "anchor".
            Without one of the first two, ``None`` is returned.
    """
    if not {"real", "synthetic"} <= found.keys():
        return None
    real = found["real"]
    first, second = (real[: len(real) // 2], real[len(real) // 2 :])
    if ANCHOR in found:
        first, second = real, found[ANCHOR]
    again = object_divergences(_joined(first), _joined(second))
    twin = object_divergences(_joined(real), _joined(found["synthetic"]))
    return {
        "objects_per_frame": {
            name: sum(map(len, rows)) / len(rows) for name, rows in found.items()
        },
        "js_twin": twin,
        "js_real_against_real": again,
        "ratio_to_real": {name: _ratio(twin[name], value) for name, value in again.items()},
    }


def _joined(frames: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate([np.zeros((0, 6)), *frames])


def _ratio(twin: float | None, real: float | None) -> float | None:
    return None if twin is None or not real else twin / real


def ground_beneath(real: Side) -> RecordedGround | None:
    """Return the ground from a few real frames; None if foreground cannot be separated."""
    parts = []
    for index in range(real.count):
        frame = real.read(index)
        moves = None if frame is None else real.foreground(frame, MODEL)
        if frame is not None and moves is not None:
            parts.append(sampled(frame.points[~moves], _GROUND_POINTS))
        if len(parts) == _GROUND_FRAMES:
            break
    return recorded_ground(np.concatenate(parts)) if parts else None
