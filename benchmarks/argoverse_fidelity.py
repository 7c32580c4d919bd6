"""How near the simulated Argoverse sweeps are to the real ones: road and actors, by `compare`.

The world of `argoverse.py`: the measured ground and the annotated boxes, and nothing else. So only
what that world has is compared: points within 0.2 m of the measured ground and inside a drivable
area of the vector map, and points in annotated boxes. Facades, trees and poles are left out of the
real frames; what they hide of the road stays in the simulated ones.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray
from pyarrow import parquet
from scipy.spatial import cKDTree

from argoverse_log import DATA, Log
from argoverse_world import World
from urbantwin.dataset.layout import FOLDERS, RAY_TYPE, write_frame
from urbantwin.fidelity import compare
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import open_recording
from urbantwin.site.rig import Effects

#: A point this near to the measured ground is a point of the road.
NEAR_GROUND_M = 0.2
_BOX = ("x", "y", "z", "length", "width", "height", "yaw")


def drivable(log: Log, sweep: int) -> shapely.Geometry:
    """The map's drivable areas in the vehicle frame at a sweep's time, in plan."""
    path = next(log.folder.glob("map/log_map_archive_*.json"))
    areas = json.loads(path.read_text())["drivable_areas"].values()
    turn, place = log.city_of_vehicle(np.array([sweep]))
    rings = [
        turn[0].inv().apply([[p["x"], p["y"], p["z"]] for p in area["area_boundary"]] - place[0])
        for area in areas
    ]
    return shapely.union_all([shapely.make_valid(shapely.Polygon(ring[:, :2])) for ring in rings])


def on_road(
    points: NDArray[np.float64], ground: NDArray[np.float64], area: shapely.Geometry
) -> NDArray[np.bool_]:
    """Which points (N,) lie on the measured ground (V, 3) in a drivable area."""
    away, near = cKDTree(ground[:, :2]).query(points[:, :2], k=3)
    height = ground[near, 2].mean(axis=1)
    level = (np.abs(points[:, 2] - height) < NEAR_GROUND_M) & (away[:, 0] < 0.5)
    return np.asarray(level & shapely.contains_xy(area, points[:, 0], points[:, 1]))


def of_actors(frame: Frame) -> NDArray[np.bool_]:
    """Which points (N,) are in boxes."""
    found = frame.foreground()
    return np.zeros(len(frame.points), bool) if found is None else found


def write(folder: Path, frames: list[Frame]) -> Path:
    """Write frames in our datasets' layout: points, rays, boxes."""
    for name in ("points", "rays"):
        (folder / name).mkdir(parents=True)
    rows = []
    for index, frame in enumerate(frames):
        name = f"{index:06d}"
        shade = np.zeros(len(frame.points)) if frame.intensity is None else frame.intensity
        table = np.column_stack([frame.points, shade]).astype(np.float32)
        np.save(folder / "points" / f"{name}.npy", table)
        rays = np.zeros(len(frame.points), RAY_TYPE)
        rays["ring"], rays["sensor"] = frame.ring, frame.sensor
        if frame.column is not None:
            rays["column"] = frame.column
        np.save(folder / "rays" / f"{name}.npy", rays)
        if frame.boxes is None:
            raise ValueError("a frame without boxes")
        for number, box in enumerate(frame.boxes.box):
            kind = frame.boxes.class_names[number]
            track = int(frame.boxes.track[number])
            place = dict(zip(_BOX, map(float, box), strict=True))
            rows.append({"frame": name, "class": kind, "track": track, **place})
    parquet.write_table(pa.Table.from_pylist(rows), folder / "boxes.parquet")
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--arbitrary", type=Path, help="a dataset of another site")
    parser.add_argument("-o", "--out", type=Path, required=True)
    options = parser.parse_args()
    log = Log(options.data)
    recording = open_recording(log.folder)
    real, twin = [], []
    with tempfile.TemporaryDirectory() as scratch:
        for name in FOLDERS:
            (Path(scratch) / "all" / name).mkdir(parents=True)
        for index, sweep in enumerate(log.sweeps):
            world, area = World(log, sweep), drivable(log, sweep)
            ground = np.asarray(world.ground.vertices, np.float64)
            frame = recording.read(index)
            kept = on_road(frame.points, ground, area) | of_actors(frame)
            shade = None if frame.intensity is None else frame.intensity / 255
            real.append(replace(frame, intensity=shade).only(kept))
            write_frame(Path(scratch) / "all", index, world.scan(list(log.boxes(sweep)), Effects()))
        simulated = open_recording(Path(scratch) / "all")
        for index, sweep in enumerate(log.sweeps):
            ground = np.asarray(World(log, sweep).ground.vertices, np.float64)
            # The boxes of the real frame: what is an actor is the same question on both sides.
            frame = replace(simulated.read(index), boxes=real[index].boxes, instance=None)
            kept = on_road(frame.points, ground, drivable(log, sweep)) | of_actors(frame)
            twin.append(frame.only(kept))
        report = compare(
            write(Path(scratch) / "real", real),
            write(Path(scratch) / "twin", twin),
            options.out,
            arbitrary=options.arbitrary or "example",
            origin=log.mounts["up_lidar"].translation,
        )
    print(json.dumps(report.headline(), indent=1))


if __name__ == "__main__":
    main()
