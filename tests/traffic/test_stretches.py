"""A motion parted in two stretches: nobody leaps between them, and boxes by shapely are apart."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely

from urbantwin.progress import untold
from urbantwin.traffic.assets import asset
from urbantwin.traffic.demand.demand import Trip
from urbantwin.traffic.paths.apart import Parted
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.crowd import NO_CROSSINGS
from urbantwin.traffic.paths.kept_ways import KeptColumns, KeptWays
from urbantwin.traffic.paths.obstacles import Blocks
from urbantwin.traffic.paths.stretches import LeftOff, Stretch, stretches

STEP_S, COUNT = 0.1, 500
#: Two cars of which one has to wait, a bicycle that goes round who stands, and who meets whom.
TRIPS = tuple(
    Trip(kind, name, 0.0, ("here",))
    for kind, name in (
        ("car", "car-city"),
        ("car", "car-city"),
        ("bicycle", "bicycle-city"),
        ("pedestrian", "pedestrian-man"),
        ("pedestrian", "pedestrian-man"),
        ("pedestrian", "pedestrian-man"),
    )
)
NOTHING = PlanBoxes(np.zeros(0, int), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)))
FOOTWAY = shapely.box(-80.0, 8.0, 80.0, 12.0)


def ways() -> dict[str, np.ndarray]:
    time_s = np.arange(COUNT) * STEP_S
    along = (time_s - 24.0)[:, None]
    east, north = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    xy = [
        along * 6.0 * east - 30.0 * north,
        along * 6.0 * north - 30.0 * north,
        along * 4.0 * east + 3.0 * north,
        np.tile([[4.0, 3.45]], (COUNT, 1)),
        along * 1.3 * east + 10.0 * north,
        -along * 1.3 * east + 10.1 * north,
    ]
    yaw = np.repeat([0.0, np.pi / 2, 0.0, np.pi / 2, 0.0, np.pi], COUNT)
    speed = np.repeat([6.0, 6.0, 4.0, 0.0, 1.3, 1.3], COUNT)
    return {
        "trip": np.repeat(np.arange(6), COUNT),
        "step": np.tile(np.arange(COUNT), 6),
        "xy": np.concatenate(xy),
        "yaw": yaw,
        "speed": speed,
        "distance": np.tile(time_s, 6) * speed,
        "lane": np.zeros(6 * COUNT, int),
    }


def parted(every: list[Stretch], folder: Path | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return where everybody is (6, N, 2), and the boxes (6, N)."""
    blocks = Blocks(NOTHING, np.zeros(0))
    level = np.zeros(1, np.int64)
    kept = KeptColumns(folder)
    kept.add(ways())
    there = KeptWays(kept, TRIPS, np.arange(6), frozenset(), frozenset(), 0, (0, COUNT))
    nothing: np.ndarray = np.array([], object)
    whole = Parted(there, level, blocks, nothing, FOOTWAY, step_s=STEP_S, asset=asset)
    left, xy, yaw = None, np.full((6, COUNT, 2), np.nan), np.full((6, COUNT), np.nan)
    for stretch in every:
        found = whole.parted(stretch, left, None, NO_CROSSINGS, untold)
        left = LeftOff.of(found, stretch.end)
        kept = (found["step"] >= stretch.begin) & (found["step"] < stretch.end)
        at = found["trip"][kept], found["step"][kept]
        xy[at], yaw[at] = found["xy"][kept], found["yaw"][kept]
    half = np.repeat(whole.still / 2, COUNT, axis=0)
    boxes = PlanBoxes(np.zeros(6 * COUNT, int), xy.reshape(-1, 2), yaw.ravel(), half)
    return xy, boxes.polygons.reshape(6, COUNT)


def test_long_times_are_parted_into_stretches_that_follow_each_other() -> None:
    assert stretches(-30, 900, 0.1) == [Stretch(-30, 900, 900)]
    every = stretches(-30, 36_030, 0.1)
    assert (every[0].begin, every[-1].end, every[-1].seen) == (-30, 36_030, 36_030)
    assert all(one.end == other.begin for one, other in pairwise(every))
    assert all(one.seen > one.end for one in every[:-1])


def test_whoever_is_late_or_beside_its_way_when_a_stretch_ends_goes_on_from_there(
    tmp_path: Path,
) -> None:
    whole, _ = parted([Stretch(0, COUNT, COUNT)])
    # All three meetings are at step 240.
    for end, kept in ((225, None), (240, tmp_path), (250, None)):
        xy, boxes = parted([Stretch(0, end, end + 250), Stretch(end, COUNT, COUNT)], kept)
        own = whole[:, -1] - xy[:, -1]
        assert np.hypot(*own.T).max() < 1.0  # everybody has come on
        change = np.linalg.norm(np.diff(xy, n=2, axis=1), axis=2) / STEP_S**2
        most = np.linalg.norm(np.diff(whole, n=2, axis=1), axis=2) / STEP_S**2
        around = change[:, end - 3 : end + 3].max(axis=1)
        assert (around < most.max(axis=1) * 1.2 + 1.5).all()
        for a, b in ((0, 1), (2, 3), (4, 5)):
            shared = shapely.area(shapely.intersection(boxes[a], boxes[b]))
            assert shared.max() < 0.05
    # The one car waits for the other, and the others go round each other.
    straight = ways()["xy"].reshape(6, COUNT, 2)
    aside = np.linalg.norm(whole - straight, axis=2).max(axis=1)
    assert aside[:2].max() > 1.0
    assert aside[2:4].max() > 0.05
    assert aside[4:].min() > 0.05


def test_rows_of_ways_on_disk_are_those_in_memory(tmp_path: Path) -> None:
    kept, known = KeptColumns(tmp_path), KeptColumns(None)
    for columns in (kept, known):
        columns.add(ways())
        columns.add(ways())
    count = len(known.opened()["trip"])
    for rows in ([0], [3, 4, 5, 900, 901, 7, 8, 2], range(count), [count - 1, 0], []):
        some, same = (one.rows(np.array(rows, np.int64)) for one in (kept, known))
        for name, values in same.items():
            assert some[name].dtype == values.dtype
            np.testing.assert_array_equal(some[name], values)
