"""Whether two frames can be of one sensor in one frame of reference at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame

__all__ = ["doubts_about"]

_CELL_M = 1.0
_REACH_M = 60.0
#: Overlap under a turn that makes us doubt: at least, and more than as it is by this factor.
_LEAST, _FACTOR = 0.25, 1.3
_TURNS = (90, 180, -90)
_HEIGHT_M, _NEAR_M = 0.5, 15.0


def doubts_about(real: Frame, other: Frame) -> list[str]:
    """Return what looks wrong about comparing two frames, one sentence each.

    Turned by a quarter or half turn: cells of 1 m in plan that both occupy, over those that
    either does, are many more after the turn than before. Shifted in height: the commonest
    height of the points up to 15 m away (the street, mostly) differs by more than 0.5 m. Another
    unit: extents differ by more than a hundred. Another sensor: rings, or points, differ in
    number.
    """
    said = []
    a, b = real.points - real.sensor_places[0], other.points - other.sensor_places[0]
    extents = [float(np.percentile(np.linalg.norm(p, axis=1), 90)) for p in (a, b)]
    if max(extents) > 100 * max(min(extents), 1e-9):
        return [
            f"Extents are {extents[0]:.3g} m (real) and {extents[1]:.3g} m: "
            "one of them seems to be in another unit."
        ]
    as_it_is = _overlap(a, b)
    turned = {turn: _overlap(_turned(a, turn), b) for turn in _TURNS}
    best = max(_TURNS, key=lambda turn: turned[turn])
    if turned[best] > max(_LEAST, _FACTOR * as_it_is):
        said.append(
            f"The real frames look rotated by {abs(best)} degrees: turned by {best}, "
            f"{turned[best]:.0%} of the cells in plan agree, and as they are {as_it_is:.0%}."
        )
    heights = [
        _commonest_height(frame.points[np.linalg.norm(seen[:, :2], axis=1) < _NEAR_M])
        for frame, seen in ((real, a), (other, b))
    ]
    if abs(heights[0] - heights[1]) > _HEIGHT_M:
        said.append(
            f"The commonest height nearby is {heights[0]:.1f} m in the real frame and "
            f"{heights[1]:.1f} m in the other: the frames of reference seem shifted."
        )
    rings = [_rings(frame) for frame in (real, other)]
    if min(rings) and max(rings) > 1.2 * min(rings):
        said.append(f"The frames have {rings[0]} and {rings[1]} rings: not the same sensor?")
    if max(len(a), len(b)) > 3 * min(len(a), len(b)):
        said.append(f"The frames have {len(a)} and {len(b)} points: not the same sensor?")
    return said


def _turned(points: NDArray[np.float64], degrees: int) -> NDArray[np.float64]:
    c, s = {90: (0, 1), 180: (-1, 0), -90: (0, -1)}[degrees]
    return np.column_stack(
        [c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1], points[:, 2]]
    )


def _overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return occupied cells in common over occupied cells, of what is not the ground nearby."""
    edges = np.arange(-_REACH_M, _REACH_M + _CELL_M / 2, _CELL_M)
    low = min(_commonest_height(p) for p in (a, b)) + 0.5
    seen = []
    for points in (a, b):
        tall = points[points[:, 2] > low]
        seen.append(np.histogram2d(tall[:, 0], tall[:, 1], (edges, edges))[0] > 0)
    either = (seen[0] | seen[1]).sum()
    return float((seen[0] & seen[1]).sum() / either) if either else 0.0


def _rings(frame: Frame) -> int:
    """Return how many rings all sensors together have; 0 where that is not known."""
    if frame.ring is None:
        return 0
    sensor = 0 if frame.sensor is None else frame.sensor
    return len(np.unique(sensor * 65_536 + frame.ring))


def _commonest_height(points: NDArray[np.float64]) -> float:
    """Return it in metres; nan without points."""
    if not len(points):
        return float("nan")
    cells, count = np.unique(np.floor(points[:, 2] / 0.2).astype(np.int64), return_counts=True)
    return float(cells[count.argmax()] * 0.2 + 0.1)
