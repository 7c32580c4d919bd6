"""What stands in no map, as another sweep of the log measured it: a model for ``geometry:``.

Facades, trees, poles, sidewalks: all that is neither of the road nor in an annotated box.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from argoverse_log import SENSORS, Log
from urbantwin.fidelity.rebuilt_surface import rebuild_surface
from urbantwin.geometry import Pose

__all__ = ["GEOMETRY", "write_background"]

#: What the site says of the model: it is where it is, and every piece of it was measured.
GEOMETRY: dict[str, Any] = {
    "file": "background.ply",
    "kind": "mesh",
    "unit": "m",
    "up": "z",
    "similarity": {},
    "provides": ["buildings", "trees", "other"],
    "semantic": "building",
    "clean": {"shards": False, "traffic": False, "chordal_error_m": 0.0},
}
#: A point without neighbours on a surface is a square this wide, seen from the sensor, radians:
#: as wide as columns are apart, and higher.
WIDTH, HEIGHT = np.radians([0.25, 0.5])
#: Points farther apart than this, seen from the sensor from above, are of two surfaces, radians.
GAP = np.radians(1.0)


def write_background(
    log: Log,
    sweep: int,
    standing: NDArray[np.bool_],
    site_SE3_vehicle: Pose,
    path: Path,
) -> None:
    """Write the surfaces that a sweep's sensors saw, as far as they stand in no map.

    Args:
        log: the log.
        sweep: its time.
        standing: (N,) which of the sweep's points are of them.
        site_SE3_vehicle: where the vehicle was.
        path: of the PLY.
    """
    points, laser = log.points(sweep), log.lasers(sweep)
    meshes = []
    for name, first, _ in SENSORS:
        mine = (laser >= first) & (laser < first + 32)
        seen, kept = points[mine], standing[mine]
        origin = log.mounts[name].translation
        # Triangles are made of all points, so that none joins what a road or a car is between.
        faces = rebuild_surface(seen, origin).faces
        is_triangle = faces[:, 0] != faces[:, 1]
        faces = faces[is_triangle & kept[faces].all(axis=1)]
        faces = faces[_is_narrow((seen - origin)[faces])]
        lone = np.setdiff1d(np.flatnonzero(kept), faces)
        meshes += [trimesh.Trimesh(seen, faces, process=False), _squares(seen[lone], origin)]
    mesh: Any = trimesh.util.concatenate(meshes)
    mesh.vertices = site_SE3_vehicle.apply(mesh.vertices)
    mesh.remove_unreferenced_vertices()
    mesh.export(path)


def _is_narrow(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which triangles (F, 3, 3) join neighbouring columns: rays pass between two poles."""
    azimuth = np.arctan2(corners[..., 1], corners[..., 0])
    off = np.angle(np.exp(1j * (azimuth - azimuth[:, :1])))
    return np.asarray(np.ptp(off, axis=1) < GAP)


def _squares(points: NDArray[np.float64], origin: NDArray[np.float64]) -> trimesh.Trimesh:
    """Squares that face the sensor."""
    sight = points - origin
    away = np.linalg.norm(sight, axis=1, keepdims=True)
    left = np.cross([0.0, 0.0, 1.0], sight)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    up = np.cross(sight / away, left)
    left, up = left * away * WIDTH / 2, up * away * HEIGHT / 2
    corners = np.stack([-left - up, left - up, left + up, up - left], axis=1) + points[:, None]
    faces = 4 * np.arange(len(points))[:, None, None] + [[0, 1, 2], [0, 2, 3]]
    return trimesh.Trimesh(corners.reshape(-1, 3), faces.reshape(-1, 3), process=False)
