"""How much stands beside real streets, and beside those of twins: points by height above ground.

Of points within 40 m in plan that are of nothing that moves, the shares by height above the ground,
of real frames and of twins scanned by the same model of sensor, at the same height above lanes.
What moves is left out on both sides: real points in labelled boxes (grown by 0.3 m; of KITTI only
the part that is labelled counts), and in twins there is nothing but the built scene. Recordings
without labels keep their actors, and are marked. The ground is found on both sides by the same
rule, from the points alone.

    python benchmarks/beside_streets.py real
    python benchmarks/beside_streets.py twins places/*/twin --json shares.json
    python benchmarks/beside_streets.py real --of pandaset --kinds    # by what it consists of
    python benchmarks/beside_streets.py real --of kitti --frames odd  # what rates were fitted to
"""

from __future__ import annotations

import argparse
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy import ndimage

import urbantwin as ut
from real_roads import ground_of
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar import Scanner, place_rig
from urbantwin.site.rig import RigSpec

DATA = Path(__file__).parents[2] / "shared/data"
#: Height classes above the ground, metres; what lies below the first is ground. Ranges in plan.
HEIGHTS_M = (0.3, 1.0, 1.75, 2.5)
RANGES_M = (3.0, 10.0, 20.0, 40.0)
#: Cells in which the ground is sought; what is narrower than so many of them stands on it.
CELL_M, WIDEST = 1.0, 13
GROWN_M = 0.3
#: What stands beside streets, by numbers of SemanticKITTI (ours) and of PandaSet.
KINDS = {
    "plants": ((70, 71), (5,)),
    "buildings": ((50,), (41,)),
    "fences, walls, furniture, poles": ((51, 52, 80, 81, 99), (34, 35, 36, 37, 38, 39, 40, 42)),
}
FRAMES = {"all": slice(None), "odd": slice(1, None, 2), "even": slice(0, None, 2)}
#: Recordings: model of the sensor, its height, and whether what moves is labelled.
SENSORS = {
    "kitti": ("HDL-64E", 1.73, True),
    "pandaset": ("Pandar64", 1.85, True),
    "pittsburgh": ("VLP-32C", 1.7, True),
    "os0": ("OS0-128", 1.8, False),
    "os1": ("OS1-128", 1.8, False),
}


def above_ground(points: np.ndarray) -> np.ndarray:
    """Heights (N,) over the ground that the points show; (N, 3) about the sensor."""
    normal, offset = ground_of(points)
    rest = points @ normal - offset
    cell = np.floor(points[:, :2] / CELL_M).astype(int)
    cell -= cell.min(axis=0)
    low = np.full(cell.max(axis=0) + 1, np.inf)
    np.minimum.at(low, tuple(cell.T), np.maximum(rest, -3.0))
    empty = np.isinf(low)
    _, near = ndimage.distance_transform_edt(empty, return_indices=True)
    low = low[tuple(near)]
    opened = ndimage.grey_opening(low, size=(WIDEST, WIDEST))
    ground = np.minimum(ndimage.uniform_filter(opened, 3), low + 0.3)
    return rest - ground[tuple(cell.T)]


def shares(points: np.ndarray, static: np.ndarray) -> np.ndarray:
    """Counts (ranges, heights) of static points, from the ground upward."""
    flat = np.hypot(points[:, 0], points[:, 1])
    within = flat < RANGES_M[-1] + 5
    points, static, flat = points[within], static[within], flat[within]
    high = above_ground(points)
    counts = np.zeros((len(RANGES_M) - 1, len(HEIGHTS_M) + 1))
    for k, (near, far) in enumerate(pairwise(RANGES_M)):
        here = static & (flat >= near) & (flat < far)
        counts[k] = np.bincount(np.digitize(high[here], HEIGHTS_M), minlength=len(HEIGHTS_M) + 1)
    return counts


def by_kind(
    points: np.ndarray, static: np.ndarray, semantic: np.ndarray, column: int
) -> np.ndarray:
    """Shares (kinds, 2) of static points within 40 m: 0.3 to 2.5 m above the ground, and higher."""
    within = np.hypot(points[:, 0], points[:, 1]) < RANGES_M[-1]
    high = above_ground(points[within])
    static, semantic = static[within], semantic[within]
    middle = (high > HEIGHTS_M[0]) & (high <= HEIGHTS_M[-1])
    return np.array(
        [
            [(static & np.isin(semantic, numbers[column]) & where).sum() / static.sum()
             for where in (middle, high > HEIGHTS_M[-1])]
            for numbers in KINDS.values()
        ]
    )  # fmt: skip


def real(name: str, numbers: slice = slice(None)) -> list[np.ndarray]:
    """Counts of every frame of a recording, or of those with some numbers."""
    if name == "pandaset":
        points, static, _ = _pandaset()
        return [shares(points, static)]
    folder = {
        "kitti": "recordings/kitti-training", "pittsburgh": "lidar/argoverse2-pittsburgh",
        "os0": "recordings/ouster-os0-128", "os1": "lidar/ouster-os1-128",
    }[name]  # fmt: skip
    recording = open_recording(DATA / folder)
    found = []
    for number in range(len(recording))[numbers]:
        frame = recording.read(number)
        points = frame.points - frame.sensor_places[0]
        static = np.ones(len(points), bool)
        if frame.boxes is not None:
            static = frame.boxes.points_of(frame.points, GROWN_M) < 0
        if name == "kitti":  # labelled is what the left camera sees
            static &= np.abs(np.degrees(np.arctan2(points[:, 1], points[:, 0]))) < 40
        found.append(shares(points, static))
    return found


def _pandaset() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of the Pandar64 about it, which are of nothing that moves, and their classes."""
    given = np.load(DATA / "recordings/pandaset-001/frame_ego.npz", allow_pickle=True)
    turned = given["device"] == 0
    points = given["xyz"][turned].astype(np.float64)
    static = np.ones(len(points), bool)
    for middle, (wide, long, high), yaw in zip(
        given["box_center"], given["box_wlh_xyz"], given["box_yaw"], strict=True
    ):
        # PandaSet's yaw turns the y axis: lengths lie along it.
        away = points - middle
        c, s = np.cos(yaw), np.sin(yaw)
        across, along = away[:, 0] * c + away[:, 1] * s, away[:, 1] * c - away[:, 0] * s
        inside = np.abs(across) < wide / 2 + GROWN_M
        inside &= np.abs(along) < long / 2 + GROWN_M
        static &= ~(inside & (np.abs(away[:, 2]) < high / 2 + GROWN_M))
    # The Pandar64 is on the roof; the frame's origin is on the ground.
    ring = np.median(points[np.hypot(points[:, 0], points[:, 1]) < 12, 2])
    return points - [0.0, 0.0, ring + 1.85], static, given["semseg"][turned]


def stands(twin: ut.Twin, count: int = 4) -> list[tuple[float, float]]:
    """Places on lanes 12 to 70 m from the anchor, as far from each other as they can be."""
    lanes = [lane for lane in twin.lanes if lane.kind == "driving" and lane.level == 0]
    xy = np.concatenate([np.asarray(lane.centre)[:, :2] for lane in lanes])
    away = np.hypot(*xy.T)
    xy = xy[(away > 12) & (away < 70)]
    chosen = [int(np.argmin(np.hypot(*xy.T)))]
    while len(chosen) < count:
        apart = np.min([np.hypot(*(xy - xy[k]).T) for k in chosen], axis=0)
        chosen.append(int(np.argmax(apart)))
    return [(float(x), float(y)) for x, y in xy[chosen]]


def scans(folder: Path, name: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points (N, 3) about the sensor of a recording at places of a twin, and their classes (N,)."""
    twin = ut.Twin.open(folder)
    model, height, _ = SENSORS[name]
    found = []
    for east, north in stands(twin):
        one = {"name": "a", "model": model, "east_m": east, "north_m": north, "height_m": height}
        rig = place_rig(RigSpec.model_validate({"rate_hz": 10.0, "sensors": [one]}), twin.mesh)
        scanner = Scanner(twin.mesh, rig, 0, surface=twin.surface_materials)
        frame = scanner.scan(0, [])
        found.append((frame.points[:, :3].astype(np.float64), frame.semantic))
    return found


def of_twin(folder: Path, name: str) -> list[np.ndarray]:
    """Counts of frames of a twin, scanned by a recording's sensor."""
    return [shares(points, np.ones(len(points), bool)) for points, _ in scans(folder, name)]


def tell_kinds(side: str, twins: list[Path]) -> None:
    """Print what stands beside streets by kind, of the recording that knows it."""
    if side == "real":
        found = [by_kind(*_pandaset(), 1)]
    else:
        found = [
            by_kind(points, np.ones(len(points), bool), semantic, 0)
            for folder in twins
            for points, semantic in scans(folder, "pandaset")
        ]
    for name, (middle, above) in zip(KINDS, 100 * np.mean(found, axis=0), strict=True):
        print(f"{name:34} {middle:5.1f} at 0.3 to 2.5 m, {above:5.1f} above")


def row(counts: np.ndarray) -> dict[str, list[float]]:
    """Per cent of points by height, within 40 m and by range."""
    names = ["all", *(f"{a:.0f}-{b:.0f} m" for a, b in pairwise(RANGES_M))]
    return {
        name: (100 * one / max(one.sum(), 1e-9)).round(1).tolist()
        for name, one in zip(names, [counts.sum(axis=0), *counts], strict=True)
    }


def told(who: str, found: list[np.ndarray]) -> dict[str, object]:
    """Print one line; the spread is that of frames (or places where a sensor stood)."""
    # Every frame counts alike.
    even = [one / one.sum() for one in found]
    middle = [100 * one[:, 1:-1].sum() for one in even]
    shown = row(np.sum(even, axis=0))
    print(
        f"{who:34} {sum(shown['all'][1:-1]):5.1f}  ({min(middle):.0f} to {max(middle):.0f})  "
        + "  ".join(f"{name}: {' '.join(f'{v:4.1f}' for v in one)}" for name, one in shown.items()),
        flush=True,
    )
    return {"who": who, "middle": middle, **shown}


def main() -> None:
    """Print a line per recording, or per twin and recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("side", choices=("real", "twins"))
    parser.add_argument("twins", type=Path, nargs="*")
    parser.add_argument("--of", nargs="*", default=list(SENSORS), choices=SENSORS)
    parser.add_argument("--frames", choices=FRAMES, default="all", help="of a recording, by number")
    parser.add_argument("--kinds", action="store_true", help="by kind, as PandaSet knows it")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if given.kinds:
        tell_kinds(given.side, given.twins)
        return
    print("per cent of points 0.3 to 2.5 m above the ground (least to most), and by height up to "
          + ", ".join(f"{h:g}" for h in HEIGHTS_M) + " m and above")  # fmt: skip
    rows = []
    for name in given.of:
        if given.side == "real":
            rows.append(
                told(
                    f"{name}, {given.frames}" + ("" if SENSORS[name][2] else " *"),
                    real(name, FRAMES[given.frames]),
                )
            )
            continue
        every = []
        for folder in given.twins:
            found = of_twin(folder, name)
            every += found
            rows.append(told(f"{folder.parent.name}, {SENSORS[name][0]}", found))
        rows.append(told(f"all twins, {SENSORS[name][0]}", every))
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
