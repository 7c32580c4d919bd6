"""Roads in real frames of any layout against the sensor's law: lost rays, codes and range noise.

The rays come from the frames themselves (`fidelity.objects.frame_rays`). A ray is judged where the
nearest rays on both sides of it in its ring that returned did so from the ground, whatever became
of itself: so what is lost in patches wider than a gap is not seen. On the simulated side the rays
that really ended on the ground, and those lost between them, meet a plane of asphalt, and what
comes back is judged in the same way: where bright patches alone return, they alone count.

    python benchmarks/real_roads.py kitti/training HDL-64E --frames 0 12
    python benchmarks/real_roads.py pandaset Pandar64

With `--chance` each figure has the middle 95 % of the real one when twelfths of the turn are drawn
again, and a word: met, chance (it would be met of a real figure within that) or missed.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from pandaset_frame import pandaset_frame
from urbantwin.fidelity.objects.frame_rays import FrameRays, last_true, rays_of
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
#: Parts of a turn that are drawn again, and how often.
SECTORS, DRAWS = 12, 100


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


@dataclass(frozen=True, eq=False)
class Street:
    """The rays of one sensor beside a road.

    Attributes:
        range_m: (R,) inf where nothing came back.
        cosine: (R,) of the angle of incidence on the road's plane.
        ground: (R,) whether what came back was of the ground.
        code: (R,) 0 to 1, nan where nothing came back.
        before: (R,) the nearest ray before it in its ring that returned.
        after: (R,) the nearest behind it.
    """

    range_m: np.ndarray
    cosine: np.ndarray
    ground: np.ndarray
    code: np.ndarray
    before: np.ndarray
    after: np.ndarray

    @classmethod
    def of(cls, rays: FrameRays, points: np.ndarray, codes: np.ndarray | None) -> Street:
        """What a real sensor saw."""
        back = rays.point >= 0
        away = points - rays.origin
        normal, offset = ground_of(away[rays.point[back]])
        high = np.where(back, away[rays.point] @ normal - offset, np.inf)
        near = np.abs(high) < NEAR_M + PER_M * np.where(back, rays.range_m, 0)
        code = np.full(len(back), np.nan)
        if codes is not None:
            code[back] = codes[rays.point[back]]
        cosine = -(rays.direction @ normal)
        return cls(rays.range_m, cosine, back & near, code, rays.before, rays.after)

    def between(self) -> tuple[np.ndarray, np.ndarray]:
        """Which rays are judged, and where they would end on the ground (R,), metres."""
        b, a = self.before, self.after
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = 2 / (1 / self.range_m[b] + 1 / self.range_m[a])
            alike = np.abs(np.log(self.range_m[b] / self.range_m[a])) < 0.06
        itself = ~np.isfinite(self.range_m) | self.ground
        return self.ground[b] & self.ground[a] & alike & itself & (self.cosine > 0.01), expected

    def _even(self, ring: np.ndarray, expected: np.ndarray) -> np.ndarray:
        """Where the ground lies along the rays of a ring: the mean of eleven, without noise."""
        there = self.ground[ring]
        window = np.ones(min(11, len(ring)))
        near = np.convolve(np.where(there, 1 / self.range_m[ring], 0.0), window, "same")
        count = np.convolve(there.astype(float), window, "same")
        return np.where(count > 0.5, count / np.maximum(near, 1e-9), expected[ring])

    def again(
        self, model: ReturnModel, rays: FrameRays, seed: int, step: float, *, half: bool
    ) -> Street:
        """What the modelled sensor sees along the same rays."""
        random = np.random.default_rng(seed)
        judged, expected = self.between()
        here = self.ground | judged
        # Rings follow each other, each by azimuth.
        turn = np.arctan2(rays.direction[:, 1], rays.direction[:, 0]) % (2 * np.pi)
        rings = np.split(np.arange(len(turn)), np.flatnonzero(np.diff(turn) < -np.pi) + 1)
        truth = np.concatenate([self._even(ring, expected) for ring in rings])[here]
        truth = truth.astype(np.float32)
        cosine = self.cosine[here]
        kind = np.full(len(truth), material_id("asphalt"), np.uint8)
        places = rays.direction[here] * truth[:, None] + 1000.0 * seed  # another street's patches
        amplitude = model.scatter.backscatter(kind, cosine)
        amplitude *= model.scatter.patches(places) * model.scatter.thrown_on(places, cosine)
        amplitude *= model.scatter.grain(np.flatnonzero(here), kind)
        peak = model.peak_left(truth, cosine)
        level, sigma, bright, _ = model.answers(amplitude, truth, peak=peak)
        sees = random.integers(0, 65536, len(truth)) < level
        noisy = model.quantised(truth + sigma * random.normal(size=len(truth)).astype(np.float32))
        if step:
            noisy = np.rint(noisy / step) * step
        if half:  # the file's coordinates have 11 bits
            where = rays.direction[here] * noisy[:, None] + rays.origin
            noisy = np.linalg.norm(where.astype(np.float16).astype(float) - rays.origin, axis=1)
        range_m, code = self.range_m.copy(), self.code.copy()
        range_m[here] = np.where(sees, noisy, np.inf)
        code[here] = np.where(sees, bright, np.nan)
        ground = self.ground.copy()
        ground[here] = sees
        before, after = np.empty_like(self.before), np.empty_like(self.after)
        for mine in rings:
            good = np.isfinite(range_m[mine])
            if good.any():
                before[mine] = mine[0] + last_true(good)
                after[mine] = mine[-1] - last_true(good[::-1])[::-1]
            else:
                before[mine] = after[mine] = mine
        return Street(range_m, self.cosine, ground, code, before, after)

    def rows(self, rays: FrameRays, chosen: np.ndarray | None) -> np.ndarray:
        """Rows of judged rays: expected range, lost, code, residual of the range, sector."""
        judged, expected = self.between()
        near = (rays.direction[self.before] * rays.direction[self.after]).sum(axis=1)
        judged &= np.abs(near) > np.cos(0.05)
        if chosen is not None:
            judged &= chosen[rays.point[self.before]]
        lost = ~np.isfinite(self.range_m)
        with np.errstate(invalid="ignore"):
            residual = np.where(lost, np.nan, self.range_m - expected)
        turn = np.arctan2(rays.direction[:, 1], rays.direction[:, 0]) % (2 * np.pi)
        sector = np.floor(turn / (2 * np.pi) * SECTORS)
        return np.column_stack([expected, lost, self.code, residual, sector])[judged]


def tables(sides: tuple[np.ndarray, np.ndarray], *, chance: bool = False) -> list[dict]:
    """Rows by range: real and simulated losses, codes and noise."""
    rows = []
    for low, high in pairwise(EDGES_M):
        here = [one[(one[:, 0] >= low) & (one[:, 0] < high)] for one in sides]
        if len(here[0]) >= 200:
            found = [_figures(one) for one in here]
            rows.append(
                {"range_m": [low, high], "rays": [len(one) for one in here]}
                | {key: [one[key] for one in found] for key in found[0]}
            )
            if chance:
                for key, (least, most) in _intervals(here[0]).items():
                    real, ours = rows[-1][key]
                    word = "missed"
                    if _met(key, real, real, ours):
                        word = "met"
                    elif _met(key, least, most, ours):
                        word = "chance"
                    rows[-1][key] = [real, ours, [least, most], word]
    return rows


def _met(key: str, least: float, most: float, ours: float) -> bool:
    """Whether ours is near enough to a real figure between two: 2 points, 25 %, 1.5 times."""
    if key == "lost_%":
        return least - 2 <= ours <= most + 2
    times = 1.25 if key == "code_%" else 1.5
    return least / times <= ours <= most * times


def _intervals(real: np.ndarray) -> dict[str, tuple[float, float]]:
    """The middle 95 % of each real figure, sectors of the turns drawn again."""
    random = np.random.default_rng(0)
    units, of = np.unique(real[:, 4], return_inverse=True)
    parts = [real[of == k] for k in range(len(units))]
    drawn = [
        _figures(np.concatenate([parts[k] for k in random.integers(0, len(parts), len(parts))]))
        for _ in range(DRAWS)
    ]
    return {
        key: tuple(np.nanpercentile([one[key] for one in drawn], (2.5, 97.5)).round(2).tolist())
        for key in drawn[0]
    }


def _sigma(residual: np.ndarray) -> float:
    """The standard deviation by the four fifths nearest to 0: steps do not make it jump."""
    off = np.sort(np.abs(residual))[: max(1, int(0.8 * len(residual)))]
    return float(np.sqrt((off**2).mean())) / 0.6616  # what is left of a normal one's


def _figures(found: np.ndarray) -> dict[str, float]:
    _, lost, code, residual, _ = found.T
    apart = residual[lost == 0]
    if not len(apart):
        return dict.fromkeys(("lost_%", "code_%", "noise_mm"), float("nan"))
    # A ray less the mean of its two neighbours: sqrt(1.5) times one ray's noise. The best
    # quartile of groups of 50 has the least of the ground's own roughness.
    groups = np.array_split(apart, max(1, len(apart) // 50))
    spread = [_sigma(one) / np.sqrt(1.5) for one in groups]
    return {
        "lost_%": round(100 * float(lost.mean()), 2),
        "code_%": round(100 * float(np.nanmedian(code)), 2),
        "noise_mm": round(1000 * float(np.percentile(spread, 25)), 1),
    }


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
    parser.add_argument("--half", action="store_true", help="the file's numbers have 16 bits")
    parser.add_argument("--step", type=float, default=0.0, help="of the file's ranges, metres")
    parser.add_argument("--draws", type=int, default=8, help="simulated streets for a frame")
    parser.add_argument("--chance", action="store_true", help="what chance does to each figure")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    recording = None if given.real.name == "pandaset" else open_recording(given.real)
    effects = Effects(rolling_shutter=False)
    nowhere = Pose.from_ypr(np.zeros(3))
    unit = Calibration(light=given.light)
    mounted = MountedSensor("a", sensor(given.sensor), 1024, nowhere, effects, calibration=unit)
    model = ReturnModel(mounted)
    parts: tuple[list, list] = ([], [])
    count = len(recording) if recording else 1
    for number in range(given.frames[0], min(given.frames[1], count)):
        frame = recording.read(number) if recording else pandaset_frame()
        codes = None if frame.intensity is None else frame.intensity / given.scale
        for which, rays in enumerate(rays_of(frame)):
            if given.only in (None, which):
                chosen = None
                if given.columns is not None and frame.column is not None:
                    low, high = given.columns
                    chosen = (frame.column >= low) & (frame.column < high)
                real = Street.of(rays, frame.points, codes)
                found = real.rows(rays, chosen)
                found[:, 4] += SECTORS * number
                parts[0].append(found)
                for draw in range(given.draws):
                    seed = number * given.draws + draw
                    ours = real.again(model, rays, seed, given.step, half=given.half)
                    parts[1].append(ours.rows(rays, chosen))
    rows = tables((np.concatenate(parts[0]), np.concatenate(parts[1])), chance=given.chance)
    print(json.dumps(rows) if given.json else "\n".join(map(str, rows)))


if __name__ == "__main__":
    main()
