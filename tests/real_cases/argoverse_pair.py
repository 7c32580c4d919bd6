"""Real against simulated: the two VLP-32C of Argoverse 2 where they were, in Pittsburgh.

The world is the measured ground and the annotated boxes, each filled with a mesh of its class
scaled to it, and nothing else. Real and simulated rays are compared one by one: the same beam at
the column that stands nearest to the real encoder's angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import DownwardProbe
from urbantwin.lidar import LabelledFrame
from urbantwin.site.rig import Effects

from .argoverse_log import COLUMNS, SENSORS, ActorBox, Log, RealRays
from .argoverse_world import World, numbers

#: A real point is one of the ground this near to the measured one, metres up or down.
GROUND_M = 0.15
#: A real point closer than the simulated one by more than this hit what the log does not describe.
BLOCKED_M = 1.0
#: Boxes with fewer real points than these are not judged.
FEWEST_POINTS = 21
GEOMETRY = Effects.none().model_copy(update={"rolling_shutter": True})
RANGES_M = (0, 10, 15, 20, 30, 40, 60, 80, 120)


@dataclass(frozen=True, eq=False)
class Pair:
    """One sensor's real rays (C, M) with what the simulated rays beside them gave.

    Attributes:
        real: the rays.
        range_m: (C, M) simulated ranges, nan where nothing returned.
        intensity: (C, M) simulated codes, 0 to 255.
        exact_m: (C, M) the same with all effects off but time.
        actor: (C, M) track that the exact ray hit, 0 for the ground.
        above_m: (C, M) height of the real point over the measured ground.
        boxed: (C, M) whether the real point lies in a box or next to one.
        point: (C, M) number of the simulated point in its frame, -1 for none.
        road: (C, M) whether the exact ray meets the ground on a drivable area.
    """

    real: RealRays
    range_m: NDArray[np.float64]
    intensity: NDArray[np.float64]
    exact_m: NDArray[np.float64]
    actor: NDArray[np.int64]
    above_m: NDArray[np.float64]
    boxed: NDArray[np.bool_]
    point: NDArray[np.int64]
    road: NDArray[np.bool_]


def pairs(world: World, boxes: list[ActorBox], frame: LabelledFrame) -> list[Pair]:
    """Both sensors of a sweep."""
    exact = world.scan(boxes, GEOMETRY)
    far, exact_far = world.ranges(frame), world.ranges(exact)
    road = world.log.drivable(world.sweep, exact.points[:, :3].astype(np.float64))
    road &= exact.instance == 0
    probe = DownwardProbe(world.ground)
    found = []
    for number, (name, _, _) in enumerate(SENSORS):
        real = world.log.rays(world.sweep, name)
        point, bare_point = (numbers(one)[number][:, real.column] for one in (frame, exact))
        points = real.points_m.reshape(-1, 3)
        back = np.isfinite(points[:, 0])
        above = np.full(len(points), np.nan)
        above[back] = points[back, 2] - probe.height_below(points[back] + [0, 0, 5])
        boxed = np.zeros(len(points), bool)
        for box in boxes:
            boxed[back] |= box.holds(points[back], grown_m=0.3)
        shape = real.range_m.shape
        found.append(
            Pair(
                real,
                np.where(point >= 0, far[point], np.nan),
                255.0 * np.where(point >= 0, frame.points[point, 3], np.nan),
                np.where(bare_point >= 0, exact_far[bare_point], np.nan),
                np.where(bare_point >= 0, exact.instance[bare_point], 0).astype(np.int64),
                above.reshape(shape),
                boxed.reshape(shape),
                point,
                (bare_point >= 0) & road[bare_point],
            )
        )
    return found


def on_ground(pair: Pair) -> NDArray[np.bool_]:
    """Rays (C, M) that really returned from the ground, and whose simulated ones do."""
    return np.asarray(
        (np.abs(pair.above_m) < GROUND_M)
        & ~pair.boxed
        & (pair.actor == 0)
        & np.isfinite(pair.range_m)
    )


def spread(error: NDArray[np.float64]) -> dict[str, float]:
    """Statistics of range errors."""
    median = float(np.median(error))
    return {
        "rays": len(error),
        "median_m": round(median, 3),
        "sigma_m": round(float(1.4826 * np.median(np.abs(error - median))), 3),
        "p95_m": round(float(np.percentile(np.abs(error), 95)), 3),
    }


def per_beam(sweeps: list[list[Pair]], least: int = 100) -> list[dict[str, Any]]:
    """Range errors on the ground, real less simulated, of every beam that sees enough of it.

    With the height that the median error makes (at 2 degrees, 1 cm of height is 29 cm of range),
    and by how many degrees the real beam would have to look farther up to explain it: the
    published points were computed with the nominal table, and a unit's beams are off it.
    """
    rows = []
    for number, (name, *_) in enumerate(SENSORS):
        elevation = sweeps[0][number].real.elevation_deg
        for channel in np.argsort(elevation):
            error, range_m = [], []
            for sweep in sweeps:
                pair = sweep[number]
                good = on_ground(pair)[channel]
                error.append((pair.real.range_m - pair.range_m)[channel, good])
                range_m.append(pair.real.range_m[channel, good])
            joined = np.concatenate(error)
            if len(joined) < least:
                continue
            middle = float(np.median(np.concatenate(range_m)))
            row = spread(joined)
            slope = float(abs(np.sin(np.radians(elevation[channel]))))
            rows.append(
                {
                    "sensor": name,
                    "channel": int(channel),
                    "elevation_deg": float(elevation[channel]),
                    "range_m": round(middle, 1),
                    **row,
                    "height_m": round(row["median_m"] * slope, 3),
                    "raised_deg": round(float(np.degrees(row["median_m"] * slope / middle)), 3),
                }
            )
    return rows


def again(sweeps: list[list[Pair]]) -> dict[str, float]:
    """Real against real: ranges on the ground of the same beam and column a turn later."""
    error = []
    for first, second in zip(*sweeps, strict=True):
        images = []
        for pair in (first, second):
            image = np.full((len(pair.range_m), COLUMNS), np.nan)
            image[:, pair.real.column] = np.where(on_ground(pair), pair.real.range_m, np.nan)
            images.append(image)
        off = images[0] - images[1]
        error.append(off[np.isfinite(off)])
    return spread(np.concatenate(error))


def boxes_of(
    log: Log, sweep: int, boxes: list[ActorBox], frame: LabelledFrame, seen: list[Pair]
) -> list[dict[str, Any]]:
    """Points in every box, real and simulated.

    Once more without the simulated ones whose real ray met something before them that is in no
    box: a tree, a pole, a sign, a car that nobody annotated.
    """
    points = log.points(sweep)
    blocked = np.zeros(len(frame.points), bool)
    for pair in seen:
        before = pair.real.range_m < pair.range_m - BLOCKED_M
        blocked[pair.point[before & ~pair.boxed]] = True
    rows = []
    for track, box in enumerate(boxes, 1):
        inside = box.holds(frame.points[:, :3])
        rows.append(
            {
                "category": box.category,
                "track": track,
                "name": box.name,
                "distance_m": round(float(np.linalg.norm(box.pose.translation)), 1),
                "speed_mps": round(float(np.linalg.norm(box.velocity)), 1),
                "real": int(box.holds(points).sum()),
                "simulated": int(inside.sum()),
                "unblocked": int((inside & ~blocked).sum()),
                "real_intensity": box.intensity,
            }
        )
    return rows


def ratio(rows: list[dict[str, Any]], key: str) -> dict[str, float]:
    """Simulated over real points of the boxes that hold enough real ones."""
    judged = [row for row in rows if row["real"] >= FEWEST_POINTS]
    found = np.array([row[key] / row["real"] for row in judged])
    return {
        "boxes": len(found),
        "median": round(float(np.median(found)), 2),
        "p20": round(float(np.percentile(found, 20)), 2),
        "p80": round(float(np.percentile(found, 80)), 2),
        "within_0.8_1.25": int(((found >= 0.8) & (found <= 1.25)).sum()),
    }


def brightness(sweeps: list[list[Pair]]) -> list[dict[str, float]]:
    """Median intensity of the ground by distance, in the sensor's codes (percent up to 100)."""
    real, simulated, distance = [], [], []
    for pair in (pair for sweep in sweeps for pair in sweep):
        good = on_ground(pair)
        real.append(pair.real.intensity[good])
        simulated.append(pair.intensity[good])
        distance.append(pair.real.range_m[good])
    theirs, ours, at = (np.concatenate(one) for one in (real, simulated, distance))
    rows = []
    for low, high in pairwise(RANGES_M):
        inside = (at >= low) & (at < high)
        if inside.sum() >= 100:
            rows.append(
                {
                    "from_m": low,
                    "to_m": high,
                    "rays": int(inside.sum()),
                    "real": round(float(np.median(theirs[inside])), 1),
                    "simulated": round(float(np.median(ours[inside])), 1),
                }
            )
    return rows


def measure(data: Path, seed: int = 0) -> dict[str, Any]:
    """Every figure, of both sweeps."""
    log = Log(data)
    sweeps, rows = [], []
    for sweep in log.sweeps:
        world, boxes = World(log, sweep), list(log.boxes(sweep))
        frame = world.scan(boxes, Effects(), seed)
        seen = pairs(world, boxes, frame)
        sweeps.append(seen)
        rows.append(boxes_of(log, sweep, boxes, frame, seen))
    errors = [
        (pair.real.range_m - pair.range_m)[on_ground(pair)] for sweep in sweeps for pair in sweep
    ]
    rays = [pair.real for sweep in sweeps for pair in sweep]
    return {
        "catalogue": {
            "elevation_deg": round(
                max(float(np.abs(r.elevation_error_deg).max()) for r in rays), 4
            ),
            "azimuth_p95_deg": round(max(r.off_encoder_deg for r in rays), 4),
            "firing_time_us": round(max(r.off_schedule_us for r in rays), 2),
        },
        "ground": spread(np.concatenate(errors)),
        "ground_real_against_real": again(sweeps),
        "ground_per_beam": per_beam(sweeps),
        "boxes": [ratio(one, "simulated") for one in rows],
        "intensity_ground": brightness(sweeps),
    }
