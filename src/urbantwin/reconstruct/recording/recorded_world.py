"""The static world of a recording: the ground, and the objects on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.ground import ElevationPatch
from urbantwin.io.model import ImportedModel, PointCloud, TriangleMesh
from urbantwin.io.trust import content_of
from urbantwin.progress import Progress, between, untold
from urbantwin.reconstruct.airborne.raster import Raster
from urbantwin.reconstruct.airborne.tin import tin_heights
from urbantwin.reconstruct.recording.beams import recorded_beams
from urbantwin.reconstruct.recording.carving import carved
from urbantwin.reconstruct.recording.facets import Facets, facets_of
from urbantwin.reconstruct.recording.looks import Looks
from urbantwin.reconstruct.recording.recorded_frames import RecordedFrames
from urbantwin.reconstruct.recording.recorded_ground import GRID_M, recorded_ground
from urbantwin.reconstruct.recording.standing_things import standing_things, waiting_parts

__all__ = ["labelled_world", "placed_ground", "read_recording"]

#: Minimum number of beams with a static range.
_LEAST_BEAMS = 500
#: Classes of ground points: measured nearby, or bridged.
_MEASURED, _BRIDGED = 2, 1
#: Names of the mesh's objects: kinds of `facets`.
_NAMES = ("surface", "porous", "single")


def read_recording(folder: Path, tell: Progress = untold) -> ImportedModel:
    """Return the static world of frames with rings, in the frame of their points.

    Args:
        folder: output of ``urbantwin rig discover --frames``.
        tell: called with the fraction done and the current step.

    Returns:
        A model whose mesh holds the objects (``surface``, ``porous`` and ``single``: `facets`), and
        whose cloud is the ground on a grid: class 2 if measured within a metre, 1 if bridged.

    Raises:
        InputError: the folder is invalid, or too little of it is static.
    """
    frames = RecordedFrames(folder)
    looks = Looks(frames, between(tell, 0.0, 0.4))
    looks.check_standing()
    tell(0.4, "beams")
    beams = recorded_beams(looks)
    points = np.concatenate([one.points()[one.range_m[:, 0] > 0] for one in beams])
    if len(points) < _LEAST_BEAMS:
        raise InputError(
            f"has {len(points)} beams on static surfaces",
            file=folder,
            expected=f"{_LEAST_BEAMS} or more",
        )
    tell(0.6, "ground")
    ground = recorded_ground(points)
    tell(0.75, "static objects")
    facets = Facets.concatenate([facets_of(one, ground) for one in beams])
    facets, went = carved(facets, beams)
    east, north = ground.grid.middles()
    known = np.isfinite(ground.heights)
    nodes = np.column_stack([east[known], north[known], ground.heights[known]])
    files: dict[str, str] = {}
    for file in frames.files():
        files |= {f"{file.parent.name}/{file.name}": one for one in content_of(file).values()}
    notes = {
        "frames": len(frames),
        "sensors": [one.name for one in frames.sensors],
        "points that stand still": round(looks.still_share, 4),
        "beams": int(sum(len(one.ring) for one in beams)),
        "beams on what stands still": len(points),
        "ground measured m2": round(float(ground.seen.sum()) * GRID_M**2, 1),
        "ground bridged m2": round(float((known & ~ground.seen).sum()) * GRID_M**2, 1),
        **went,
        "triangles": {
            name: int((facets.kind == number).sum()) for number, name in enumerate(_NAMES)
        },
    }
    return ImportedModel(
        mesh=_mesh(facets),
        cloud=PointCloud(
            nodes,
            classification=np.where(ground.seen[known], _MEASURED, _BRIDGED).astype(np.uint8),
        ),
        up="z",
        unit_m=1.0,
        notes=notes,
        files=files,
    )


def _mesh(facets: Facets) -> TriangleMesh:
    corners = facets.corners.reshape(-1, 3)
    vertices, index = np.unique(np.round(corners, 4), axis=0, return_inverse=True)
    return TriangleMesh(
        vertices,
        index.reshape(-1, 3).astype(np.int32),
        None,
        facets.kind,
        _NAMES,
    )


def placed_ground(
    cloud: PointCloud, region: shapely.Polygon, name: str
) -> tuple[ElevationPatch, shapely.Geometry]:
    """Return the ground of a recording on site, and the area where it was measured.

    Args:
        cloud: cloud of `read_recording`, in the site frame.
        region: crop of the measured area.
        name: name of the source.
    """
    points = cloud.points
    grid = Raster.over(points.min(axis=0), points.max(axis=0), GRID_M)
    heights = tin_heights(points, grid.west, grid.south, GRID_M, grid.shape)
    away = distance_transform_edt(grid.count(points[:, :2]) == 0) * GRID_M
    heights[away > GRID_M] = np.nan
    assert cloud.classification is not None
    measured = points[cloud.classification == _MEASURED]
    seen = (grid.count(measured[:, :2]) > 0) & np.isfinite(heights)
    area = shapely.intersection(grid.area(seen), region)
    return ElevationPatch(grid.west, grid.south, GRID_M, heights, GRID_M, name), area


def labelled_world(
    mesh: TriangleMesh,
    roads: shapely.Geometry,
    ground: ElevationPatch,
    *,
    without_traffic: bool,
) -> tuple[LabelledMesh, dict[str, object]]:
    """Return the labelled objects of a recording on site, and statistics.

    Args:
        mesh: mesh of `read_recording`, in the site frame.
        roads: carriageways in plan; may be empty.
        ground: ground of the recording.
        without_traffic: whether waiting traffic on carriageways is left out.
    """
    things = standing_things(mesh, roads)
    labelled = LabelledMesh.build(
        mesh.vertices, mesh.faces, things.semantic, things.material, things.thing
    )
    middle = mesh.triangles().mean(axis=1)
    grid = Raster(ground.west, ground.south, ground.step, ground.heights.shape)
    waits, waiting = waiting_parts(
        mesh, roads, middle[:, 2] - grid.sample(ground.heights, middle[:, :2])
    )
    waits |= things.on_road
    notes: dict[str, object] = {"things": things.counts, "vehicles on carriageways": waiting}
    if without_traffic and waiting:
        labelled = labelled.select(~waits)
        notes["vehicles on carriageways"] = f"{waiting}, left out"
    return labelled, notes
