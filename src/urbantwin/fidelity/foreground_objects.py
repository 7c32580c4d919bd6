"""What moves in frames without labels, object by object: sizes, shapes, points.

Objects are what lies together from above (`traffic.observed.clusters`), on both sides alike, so
that a group of people or two vehicles that touch are one object on either.
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

#: Heights above the ground between which objects are looked for, metres.
_LOW_M, _HIGH_M = 0.3, 4.5
#: What hangs higher than this is no actor: leaves stir in the wind.
_STANDS_M = 0.9
#: Points of so many frames tell where the ground is.
_GROUND_FRAMES, _GROUND_POINTS = 4, 60_000
_SIZE_M = np.concatenate([np.arange(0.0, 6.0, 0.5), [6.0, 8.0, 10.0, 12.0, 15.0, np.inf]])
_HEIGHT_M = np.concatenate([np.arange(0.0, 3.0, 0.25), [3.0, 3.5, 4.0, np.inf]])
_POINTS = np.concatenate([2.0 ** np.arange(3, 14), [np.inf]])
_SHARE = np.linspace(0.0, 1.0 + 1e-9, 11)
#: Columns of `objects_of`, and the edges of their bins, by what is told of them.
_BINS = {
    "size": (_SIZE_M, _SIZE_M, _HEIGHT_M),
    "shape": (_SHARE, _SHARE),
    "points": (_POINTS,),
}


def objects_of(points: NDArray[np.float64], ground: RecordedGround) -> NDArray[np.float64]:
    """Return the objects (K, 6) among the foreground's points (N, 3) of one frame.

    Returns:
        Rows of length, width and height of what was seen, metres; how far its points lie along a
        line and in a plane, 0..1: (s1 - s2) / s1 and (s2 - s3) / s1 of their standard
        deviations along the main axes (Weinmann et al. 2015); and their number.
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
    """Return objects a frame by side, and how sizes, shapes and points differ from the real ones.

    Real against real is between the real frames and the anchor's, or between their halves.

    Args:
        found: of "real", "synthetic" and, where there is one, the anchor, the objects (K, 6) of
            each frame. None of a side: nothing is told.
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
    """Return the ground of the real frames, of a few of them; None where none can be separated."""
    parts = []
    for index in range(real.count):
        frame = real.read(index)
        moves = None if frame is None else real.foreground(frame, MODEL)
        if frame is not None and moves is not None:
            parts.append(sampled(frame.points[~moves], _GROUND_POINTS))
        if len(parts) == _GROUND_FRAMES:
            break
    return recorded_ground(np.concatenate(parts)) if parts else None
