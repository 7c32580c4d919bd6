"""Real against simulated: the two VLP-32C of Argoverse 2 where they were, in Pittsburgh.

The world is the measured ground and the annotated boxes, each filled with a mesh of its class
scaled to it, and nothing else. Real and simulated rays are compared one by one: the same beam at
the column that stands nearest to the real encoder's angle.

    python benchmarks/argoverse.py
    python benchmarks/argoverse.py --picture argoverse.png --json
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from argoverse_log import COLUMNS, DATA, SENSORS, ActorBox, Log, RealRays
from argoverse_picture import draw
from argoverse_world import World, numbers
from urbantwin.geometry import DownwardProbe
from urbantwin.lidar import LabelledFrame
from urbantwin.site.rig import Effects

#: A real point is one of the ground this near to the measured one, metres up or down.
GROUND_M = 0.15
#: A real point closer than the simulated one by more than this hit what the log does not describe.
BLOCKED_M = 1.0
#: Boxes with fewer real points than these are not judged.
FEWEST_POINTS = 21
GEOMETRY = Effects.none().model_copy(update={"rolling_shutter": True})
RANGES_M = (0, 10, 15, 20, 30, 40, 60, 80, 120)
NEIGHBOURS = 31


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


def real_again(first: list[dict[str, Any]], second: list[dict[str, Any]]) -> dict[str, float]:
    """Real against real: points of the same box a turn later."""
    later = {row["name"]: row["real"] for row in second}
    both = [row | {"later": later[row["name"]]} for row in first if row["name"] in later]
    return ratio(both, "later")


def road_missing(sweeps: list[list[Pair]]) -> list[dict[str, float]]:
    """How many rays towards the road are lost, by distance, whatever became of those beside them.

    A ray counts that must meet a drivable area if nothing stands in its way, and that returned
    from there or not at all. One that met something else and was lost there counts too.
    """
    real, simulated, distance = [], [], []
    for pair in (pair for sweep in sweeps for pair in sweep):
        there = np.abs(pair.real.range_m - pair.exact_m) < np.maximum(0.5, 0.05 * pair.exact_m)
        back = np.isfinite(pair.real.range_m)
        judged = pair.road & (there | ~back)
        real.append(~back[judged])
        simulated.append(np.isnan(pair.range_m[judged]))
        distance.append(pair.exact_m[judged])
    return _by_distance(*(np.concatenate(one) for one in (real, simulated, distance)))


def dropout(sweeps: list[list[Pair]], *, actors: bool) -> list[dict[str, float]]:
    """How many rays are lost, by distance, where it is known what they must have met.

    A ray counts where most of the rays beside it in its own turn that returned did so from where
    the simulated ones did, and at least three in ten returned at all; itself it returned from
    there or not at all. Where a whole stretch is lost the real scan does not tell why, so the
    highest rates are not seen.
    """
    real, simulated, distance = [], [], []
    for pair in (pair for sweep in sweeps for pair in sweep):
        tolerance = np.maximum(0.5, 0.05 * pair.exact_m)
        there = np.abs(pair.real.range_m - pair.exact_m) < tolerance
        back = np.isfinite(pair.real.range_m)
        alike, returned = (
            uniform_filter1d(one.astype(float), NEIGHBOURS, axis=1, mode="wrap")
            for one in (there, back)
        )
        kind = (pair.actor > 0) if actors else (pair.actor == 0)
        judged = kind & np.isfinite(pair.exact_m) & (there | ~back)
        judged &= (alike > 0.8 * returned) & (returned > 0.3)
        real.append(~back[judged])
        simulated.append(np.isnan(pair.range_m[judged]))
        distance.append(pair.exact_m[judged])
    return _by_distance(*(np.concatenate(one) for one in (real, simulated, distance)))


def _by_distance(
    lost: NDArray[np.bool_], ours: NDArray[np.bool_], at: NDArray[np.float64]
) -> list[dict[str, float]]:
    """Shares of rays (N,) that are lost, really and simulated, at distances (N,)."""
    rows = []
    for low, high in pairwise(RANGES_M):
        inside = (at >= low) & (at < high)
        if inside.sum() >= 100:
            rows.append(
                {
                    "from_m": low,
                    "to_m": high,
                    "rays": int(inside.sum()),
                    "real": round(float(lost[inside].mean()), 4),
                    "simulated": round(float(ours[inside].mean()), 4),
                    "same_outcome": round(float((lost == ours)[inside].mean()), 4),
                }
            )
    return rows


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


def measure(
    data: Path = DATA, seed: int = 0, keep: list[list[Pair]] | None = None
) -> dict[str, Any]:
    """Everything, of both sweeps; their pairs go to ``keep``."""
    log = Log(data)
    sweeps, rows = [], []
    for sweep in log.sweeps:
        world, boxes = World(log, sweep), list(log.boxes(sweep))
        frame = world.scan(boxes, Effects(), seed)
        seen = pairs(world, boxes, frame)
        sweeps.append(seen)
        rows.append(boxes_of(log, sweep, boxes, frame, seen))
    if keep is not None:
        keep += sweeps
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
        "boxes_unblocked": [ratio(one, "unblocked") for one in rows],
        "boxes_real_against_real": real_again(*rows),
        "intensity_ground": brightness(sweeps),
        "dropout_road": road_missing(sweeps),
        "dropout_ground": dropout(sweeps, actors=False),
        "dropout_actors": dropout(sweeps, actors=True),
        "box_rows": rows,
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Rows under their keys."""
    keys = list(rows[0])
    lines = [[str(row[key]) for key in keys] for row in rows]
    width = [max(len(line[k]) for line in [keys, *lines]) for k in range(len(keys))]
    return "\n".join(
        "  ".join(text.rjust(w) for text, w in zip(line, width, strict=True))
        for line in [keys, *lines]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if not options.data.is_dir():
        raise SystemExit(f"{options.data} is missing")
    sweeps: list[list[Pair]] = []
    result = measure(options.data, keep=sweeps)
    if options.picture:
        draw(sweeps[0], result, options.picture)
    if options.json:
        print(json.dumps(result, indent=1))
        return
    rows = result.pop("box_rows")
    result["box_rows"] = [
        {key: value for key, value in row.items() if key != "name"}
        for one in rows
        for row in one
        if row["real"] >= FEWEST_POINTS
    ]
    for key, value in result.items():
        if isinstance(value, list) and value:
            print(f"\n{key}\n{table(value)}")
        else:
            print(f"{key}: {value}")


if __name__ == "__main__":
    main()
