"""The Pittsburgh of an Argoverse 2 log as a site, and its annotated traffic as a motion.

The site has what the log has: the vector map for roads and the ground's heights. The motion has
the vehicle that carries the sensors, by its recorded poses, and the annotated boxes that hold
points, each filled with a mesh of its class, by the velocity of its track.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rasterio
import shapely
import yaml
from numpy.typing import NDArray
from pyproj import Transformer
from rasterio.fill import fillnodata
from rasterio.transform import Affine
from scipy.spatial.transform import Rotation

from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.taxonomy import ACTOR_SEMANTICS, material_id, semantic_id
from urbantwin.traffic import Motion
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.signals import SIGNAL_SCHEMA
from urbantwin.twin import Twin

from .argoverse_log import ActorBox, Log
from .argoverse_world import EGO, TIMES_S, actor_class, mesh_in_box

__all__ = ["Place", "motion_of", "write_site"]

ANCHOR = {"latitude": 40.462723, "longitude": -79.951023}
#: City coordinates plus this are EPSG:32617.
CITY = np.array([583710.007, 4477260.000])
STEP_S = float(TIMES_S[1] - TIMES_S[0])


def write_site(log: Log, folder: Path, radius_m: float) -> Path:
    """Write ``site.yaml`` and the DEM beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    _write_dem(log, folder / "ground.tif")
    site: dict[str, Any] = {
        "name": "pittsburgh",
        "anchor": ANCHOR,
        "region": {"radius_m": radius_m},
        "roads": {"file": str(next(log.folder.glob("map/log_map*.json")).resolve())},
        "dem": "ground.tif",
        "closed_loop": False,
        "rig": {
            "sensors": [{"name": "a", "model": "OS1-128", "east_m": 0, "north_m": 0, "height_m": 6}]
        },
    }
    path = folder / "site.yaml"
    path.write_text(yaml.safe_dump(site))
    return path


def _write_dem(log: Log, path: Path) -> None:
    """Write the raster; beside its roads, where nothing is known, it is filled from around."""
    heights, cell, south_west = _raster(log)
    known = np.isfinite(heights)
    middle = np.nanmean(heights)
    filled = fillnodata(
        np.where(known, heights - middle, 0.0).astype(np.float32),
        mask=known.astype(np.uint8),
        max_search_distance=300.0,
    )
    rows, columns = heights.shape
    west, south = south_west + CITY
    place = Affine(cell, 0, west, 0, -cell, south + rows * cell)
    kind = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": "EPSG:32617"}
    with rasterio.open(path, "w", height=rows, width=columns, transform=place, **kind) as raster:
        raster.write((filled + middle)[::-1].astype(np.float32), 1)


def _raster(log: Log) -> tuple[NDArray[np.float64], float, NDArray[np.float64]]:
    """Heights of the log's ground, the edge of a cell, and the first cell's corner, city frame."""
    sim2 = json.loads(next(log.folder.glob("map/*Sim2*.json")).read_text())
    return log.heights, 1 / sim2["s"], -np.array(sim2["t"])


@dataclass(frozen=True, eq=False)
class Place:
    """Where a sweep of the log is in the twin.

    Attributes:
        log: the log.
        sweep: its time.
        site_SE3_vehicle: the vehicle at that time.
    """

    log: Log
    sweep: int
    site_SE3_vehicle: Pose  # noqa: N815

    @classmethod
    def of(cls, log: Log, sweep: int, twin: Twin) -> Place:
        """Place a sweep by its recorded pose: the map's projection, and the DEM's datum."""
        turn, place = log.city_of_vehicle(np.array([sweep]))
        to_site = Transformer.from_crs("EPSG:32617", twin.frame.proj, always_xy=True)
        east_north = np.column_stack(to_site.transform(*(place[:, :2] + CITY).T))[0]
        ahead = np.array(to_site.transform(*(place[0, :2] + CITY + [100.0, 0.0]))) - east_north
        convergence = Rotation.from_euler("z", np.arctan2(ahead[1], ahead[0]))
        up = place[0, 2] - twin.manifest["notes"]["ground"]["anchor_height_m"]
        rotation = (convergence * turn[0]).as_matrix()
        return cls(log, sweep, Pose(rotation, np.array([*east_north, up])))

    def drivable(self) -> shapely.Geometry:
        """The map's drivable areas in plan, vehicle frame (its tilt is of no account)."""
        path = next(self.log.folder.glob("map/log_map*.json"))
        areas = json.loads(path.read_text())["drivable_areas"].values()
        turn, origin = self.log.city_of_vehicle(np.array([self.sweep]))

        def plan(area: dict[str, Any]) -> shapely.Geometry:
            city = np.array([[p["x"], p["y"], p["z"]] for p in area["area_boundary"]])
            local = turn[0].inv().apply(city - origin)
            return shapely.make_valid(shapely.Polygon(local[:, :2]))

        return shapely.union_all([plan(area) for area in areas])


def motion_of(place: Place, twin: Twin, boxes: list[ActorBox]) -> Motion:
    """The vehicle and the boxes (the n-th has track n) through a turn, site frame."""
    rows: list[dict[str, Any]] = []
    meshes = {("ego", 0): _ego_mesh()}
    paths = place.log.vehicle_path(place.sweep, TIMES_S)
    for step, path in enumerate(paths):
        time_s = round(step * STEP_S, 9)
        pose = place.site_SE3_vehicle @ path
        rows.append(_row(time_s, EGO, "car", "ego", pose, np.ptp(meshes["ego", 0].vertices, 0), 0))
    for track, box in enumerate(boxes, 1):
        name = f"box-{track}"
        meshes[name, 0] = mesh_in_box(box.category, box.size, box.coat, box.mesh, panes=box.panes)
        speed = float(np.linalg.norm(box.velocity))
        for step in range(len(TIMES_S)):
            time_s = round(step * STEP_S, 9)
            moved = box.pose.translation + (time_s - box.observed_s) * box.velocity
            pose = place.site_SE3_vehicle @ Pose(box.pose.rotation, moved)
            kind = actor_class(box.category)
            rows.append(_row(time_s, track, kind, name, pose, box.size, speed))
    rows.sort(key=lambda row: (row["time_s"], row["track"]))
    manifest = {
        "kind": "motion",
        "version": 1,
        "twin_sha256": twin.sha256,
        "seed": 0,
        "steps": len(TIMES_S),
        "step_s": STEP_S,
        "duration_s": round(STEP_S * (len(TIMES_S) - 1), 9),
        "left_out": 0,
        "teleports": 0,
        "collisions": 0,
    }
    table = pa.Table.from_pylist(rows, schema=ACTOR_SCHEMA)
    return Motion(manifest, table, SIGNAL_SCHEMA.empty_table(), meshes)


def _row(
    time_s: float,
    track: int,
    kind: str,
    asset: str,
    pose: Pose,
    size: NDArray[np.float64],
    speed: float,
) -> dict[str, Any]:
    yaw, pitch, roll = Rotation.from_matrix(pose.rotation).as_euler("ZYX")
    values = {
        "time_s": time_s, "track": track, "class": kind, "asset": asset, "phase": 0, "lane": "",
        "yaw": yaw, "pitch": pitch, "roll": roll, "speed": speed,
    }  # fmt: skip
    values |= dict(zip(("x", "y", "z"), pose.translation, strict=True))
    return values | dict(zip(("length", "width", "height"), size, strict=True))


def _ego_mesh() -> LabelledMesh:
    """A block under the sensors; its carrier is invisible to a rig that rides."""
    import trimesh

    shape = trimesh.creation.box(extents=(4.8, 1.9, 1.2))
    shape.apply_translation((1.4, 0.0, 0.6))
    semantic = semantic_id(ACTOR_SEMANTICS["car"])
    return LabelledMesh.build(
        shape.vertices, shape.faces, semantic, material_id("metal-painted"), 1
    )
