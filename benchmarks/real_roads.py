"""Roads in real frames of any layout against the sensor's law: lost rays, codes and range noise.

The rays come from the frames themselves (`fidelity.objects.frame_rays`). A ray is judged where the
nearest rays on both sides of it in its ring that returned did so from the ground, whatever became
of itself: so what is lost in patches wider than a gap is not seen. The simulated side knows of each
such ray its range and its angle with the plane, and takes the ground for asphalt.

    python benchmarks/real_roads.py kitti/training HDL-64E --frames 0 12
"""

from __future__ import annotations

import argparse
import json
from itertools import pairwise
from pathlib import Path

import numpy as np

from urbantwin.fidelity.objects.frame_rays import FrameRays, rays_of
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import Pose
from urbantwin.lidar import MountedSensor, sensor
from urbantwin.lidar.returns import ReturnModel
from urbantwin.site.rig import Calibration, Effects
from urbantwin.taxonomy import material_id

EDGES_M = (3, 5, 8, 10, 15, 20, 30, 40, 60)
#: The ground lies this near to a plane through its lowest points around the sensor, metres.
NEAR_M, PER_M = 0.05, 0.012
_CELL_M = 2.0


def ground_of(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Unit normal and offset of the plane of the ground around (0, 0), by repeated fits."""
    flat = np.hypot(points[:, 0], points[:, 1])
    near = points[(flat > 2.5) & (flat < 25)]
    cell = np.floor(near[:, :2] / _CELL_M).astype(int)
    _, of = np.unique(cell, axis=0, return_inverse=True)
    low = np.full(of.max() + 1, np.inf)
    np.minimum.at(low, of.ravel(), near[:, 2])
    near = near[near[:, 2] < low[of.ravel()] + 0.15]
    kept = near[:, 2] < np.percentile(near[:, 2], 60) + 0.3
    rows = np.column_stack([near[:, :2], np.ones(len(near))])
    for _ in range(30):
        slope = np.linalg.lstsq(rows[kept], near[kept, 2], rcond=None)[0]
        off = near[:, 2] - rows @ slope
        kept = np.abs(off) < max(0.06, 1.5 * np.median(np.abs(off[kept])))
    normal = np.array([-slope[0], -slope[1], 1.0])
    return normal / np.linalg.norm(normal), float(slope[2] / np.linalg.norm(normal))


def of_rays(
    rays: FrameRays,
    points: np.ndarray,
    codes: np.ndarray | None,
    chosen: np.ndarray | None = None,
) -> np.ndarray:
    """Rows of judged rays: expected range, cosine, lost, code, residual of the range.

    Of ``chosen`` points (N,) alone, where they are given: those and what is lost after them.
    """
    away = points - rays.origin
    normal, offset = ground_of(away[rays.point[rays.point >= 0]])
    back = rays.point >= 0
    high = np.where(back, away[rays.point] @ normal - offset, np.inf)
    range_m = rays.range_m
    is_ground = back & (np.abs(high) < NEAR_M + PER_M * np.where(back, range_m, 0))
    b, a = rays.before, rays.after
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = 2 / (1 / range_m[b] + 1 / range_m[a])
        alike = np.abs(np.log(range_m[b] / range_m[a])) < 0.06
        near = np.abs((rays.direction[b] * rays.direction[a]).sum(axis=1)) > np.cos(0.05)
        itself = ~back | is_ground
        judged = is_ground[b] & is_ground[a] & alike & near & itself
        residual = np.where(back, range_m - expected, np.nan)
    if chosen is not None:
        judged &= chosen[rays.point[b]]
    cosine = -(rays.direction @ normal)
    code = np.full(len(back), np.nan)
    if codes is not None:
        code[back] = codes[rays.point[back]]
    return np.column_stack([expected, cosine, ~back, code, residual])[judged & (cosine > 0.01)]


def tables(found: np.ndarray, model: ReturnModel) -> list[dict]:
    """Rows by range: real and simulated losses, codes and noise."""
    expected, cosine, lost, code, residual = found.T
    kind = np.full(len(found), material_id("asphalt"), np.uint8)
    amplitude = model.scatter.backscatter(kind, cosine)
    at = expected.astype(np.float32)
    peak = model.peak_left(at, cosine)
    median = amplitude * np.float32(np.exp(-(model.scatter.texture**2) / 2))
    ours = 1 - model.detection_among(median, at, model.scatter.ground_spread, peak)
    sigma = model.answers(amplitude, at, peak=peak)[1]
    codes = model.intensity(median)
    rows = []
    for low, high in pairwise(EDGES_M):
        here = (expected >= low) & (expected < high)
        if here.sum() >= 200:
            apart = residual[here & (lost == 0)]
            # A ray less the mean of its two neighbours: sqrt(1.5) times one ray's noise. The best
            # quartile of groups of 50 has the least of the ground's own roughness.
            groups = np.array_split(apart, max(1, len(apart) // 50))
            spread = [1.4826 * np.nanmedian(np.abs(one)) / np.sqrt(1.5) for one in groups]
            rows.append(
                {
                    "range_m": [low, high],
                    "rays": int(here.sum()),
                    "lost_%": [round(100 * float(one[here].mean()), 2) for one in (lost, ours)],
                    "code_%": [
                        round(100 * float(np.nanmedian(one[here])), 2) for one in (code, codes)
                    ],
                    "noise_mm": [
                        round(1000 * float(np.percentile(spread, 25)), 1),
                        round(1000 * float(np.median(sigma[here])), 1),
                    ],
                }
            )
    return rows


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("real", type=Path)
    parser.add_argument("sensor")
    parser.add_argument("--frames", type=int, nargs=2, default=(0, 1000))
    parser.add_argument("--only", type=int, help="one of several sensors")
    parser.add_argument("--columns", type=int, nargs=2, help="from this one up to before that one")
    parser.add_argument("--light", type=float, default=1.0, help="times the light of the catalogue")
    parser.add_argument("--scale", type=float, default=255.0, help="full scale of intensity")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    recording = open_recording(given.real)
    effects = Effects(rolling_shutter=False)
    nowhere = Pose.from_ypr(np.zeros(3))
    unit = Calibration(light=given.light)
    mounted = MountedSensor("a", sensor(given.sensor), 1024, nowhere, effects, calibration=unit)
    parts = []
    for number in range(given.frames[0], min(given.frames[1], len(recording))):
        frame = recording.read(number)
        codes = None if frame.intensity is None else frame.intensity / given.scale
        for which, rays in enumerate(rays_of(frame)):
            if given.only in (None, which):
                chosen = None
                if given.columns is not None and frame.column is not None:
                    low, high = given.columns
                    chosen = (frame.column >= low) & (frame.column < high)
                parts.append(of_rays(rays, frame.points, codes, chosen))
    rows = tables(np.concatenate(parts), ReturnModel(mounted))
    print(json.dumps(rows) if given.json else "\n".join(map(str, rows)))


if __name__ == "__main__":
    main()
