"""Cleaning of a survey's point cloud: crop, noise, isolated points, traffic."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from urbantwin.geometry import SiteFrame
from urbantwin.io.model import PointCloud
from urbantwin.reconstruct.cleaning.removal import CleaningPicture, Removal, Spots
from urbantwin.reconstruct.cleaning.street_surface import STREET_CELL_M, Street, street_of_points
from urbantwin.reconstruct.cleaning.vehicle import Blob, find_blobs, vehicle_kind
from urbantwin.site.geometry import CleanSpec

__all__ = ["CleanedCloud", "cleaned_cloud"]

#: ASPRS LAS 1.4, table 17: 7 low noise, 18 high noise.
_NOISE = (7, 18)
#: Classes that cannot be vehicles: ground, vegetation, buildings, water, bridge decks.
_SETTLED = (2, 3, 4, 5, 6, 9, 17)
#: Minimum number of neighbours within reach of a point, otherwise it is isolated.
_COMPANY = 3
#: The reach: a multiple of the cloud's spacing, and its minimum, metres.
_SPACINGS, _LEAST_REACH_M = 6.0, 1.5
#: Height above the street from which points belong to the vehicle, metres.
_OVER_M = 0.2
#: Maximum extent of connected cells that are removed with a vehicle, cells.
_SKIRT = 3
#: Maximum number of points sampled for the spacing of a cloud.
_SOME = 20_000
_MARGIN_M = 8.0


@dataclass(frozen=True, eq=False)
class CleanedCloud:
    """A point cloud after cleaning.

    Attributes:
        cloud: site frame, metres.
        report: what was done, for ``geometry.json``.
        picture: data for ``view.cleaning``.
    """

    cloud: PointCloud
    report: dict[str, Any] = field(default_factory=dict)
    picture: CleaningPicture | None = None


def cleaned_cloud(
    cloud: PointCloud,
    spec: CleanSpec,
    *,
    region: shapely.Polygon,
    roads: shapely.Geometry | None = None,
    name: str = "",
    frame: SiteFrame | None = None,
) -> CleanedCloud:
    """Crop a cloud, and remove classified noise, stray points, and the points of traffic.

    Args:
        cloud: in the site frame, metres.
        spec: enabled steps, and overrides; the chordal error applies to meshes only.
        region: region to keep, in plan.
        roads: carriageways and parking in plan; without them, only single cars are detected.
        name: name of the source, for the report.
        frame: for latitudes and longitudes in the report and in overrides.
    """
    roads = shapely.MultiPolygon() if roads is None else roads
    keep, remove = Spots(list(spec.keep), frame), Spots(list(spec.remove), frame)
    finite = np.asarray(np.isfinite(cloud.points).all(axis=1))
    left_out: dict[str, int] = {"not_finite": int((~finite).sum())}
    report: dict[str, Any] = {"name": name, "before": _measures(cloud.select(finite))}
    around = shapely.buffer(region, _MARGIN_M, join_style="mitre")
    finite[finite] = shapely.contains_xy(around, *cloud.points[finite, :2].T)
    near = cloud = cloud.select(finite)
    spacing = _spacing(cloud.points)
    removed: list[Removal] = []
    kept: list[Removal] = []
    passed: list[Removal] = []
    if spec.shards and len(cloud.points):
        noise = np.zeros(len(cloud.points), bool)
        if cloud.classification is not None:
            noise = np.isin(cloud.classification, _NOISE)
        left_out["noise_by_its_file"] = int(noise.sum())
        alone = _alone(cloud.points, max(_LEAST_REACH_M, _SPACINGS * spacing)) & ~noise
        numbers = np.flatnonzero(alone)
        spared = keep.near(cloud.points[numbers])
        lines = [
            Removal("stray point", "no company", place, np.zeros(3), 0.0, 1)
            for place in cloud.points[numbers]
        ]
        kept += [line for line, stays in zip(lines, spared, strict=True) if stays]
        removed += [line for line, stays in zip(lines, spared, strict=True) if not stays]
        alone[numbers[spared]] = False
        cloud = cloud.select(~(noise | alone))
    if (spec.traffic or len(remove)) and len(cloud.points):
        cloud, gone, stays, others = _without_vehicles(
            cloud, spec.traffic, around, roads, keep, remove, spacing
        )
        removed, kept, passed = removed + gone, kept + stays, passed + others
    inside = np.asarray(shapely.contains_xy(region, *cloud.points[:, :2].T))
    cloud = cloud.select(inside)
    report |= {
        "after": _measures(cloud),
        "spacing_m": round(spacing, 3),
        "left_out": left_out,
        "removed": [one.line(frame, "points") for one in removed],
        "kept": [one.line(frame, "points") for one in kept],
        "not_vehicles": [one.line(frame, "points") for one in passed],
        "notes": keep.unmet("keep") + remove.unmet("remove"),
    }
    picture = CleaningPicture(
        near, cloud, tuple(removed), tuple(kept), tuple(passed), region, roads
    )
    return CleanedCloud(cloud, report, picture)


def _measures(cloud: PointCloud) -> dict[str, Any]:
    if not len(cloud.points):
        return {"points": 0, "bounds_m": None}
    bounds = [cloud.points.min(axis=0), cloud.points.max(axis=0)]
    return {
        "points": len(cloud.points),
        "bounds_m": [[round(float(v), 3) for v in corner] for corner in bounds],
    }


def _spacing(points: NDArray[np.float64]) -> float:
    """Return the typical distance between neighbours in plan, metres."""
    if len(points) < 10:
        return 1.0
    some = points[:: max(1, len(points) // _SOME)]
    distance, _ = cKDTree(points[:, :2]).query(some[:, :2], k=2, workers=-1)
    return float(np.clip(np.percentile(distance[:, 1], 75), 0.01, 5.0))


def _alone(points: NDArray[np.float64], reach: float) -> NDArray[np.bool_]:
    """Return the mask of points (N,) with too few others within reach."""
    # Voxels with many points contain no isolated ones: only the others are tested.
    cells = np.floor((points - points.min(axis=0)) / (reach / np.sqrt(3))).astype(np.int64)
    span = cells.max(axis=0) + 1
    keys = (cells[:, 0] * span[1] + cells[:, 1]) * span[2] + cells[:, 2]
    _, place, count = np.unique(keys, return_inverse=True, return_counts=True)
    asked = np.flatnonzero(count[place.ravel()] <= _COMPANY)
    alone = np.zeros(len(points), bool)
    if len(asked):
        number = min(_COMPANY + 1, len(points))
        distance, _ = cKDTree(points).query(
            points[asked], k=number, distance_upper_bound=reach, workers=-1
        )
        alone[asked] = ~np.isfinite(distance.reshape(len(asked), number)[:, -1])
    return alone


def _without_vehicles(
    cloud: PointCloud,
    traffic: bool,
    region: shapely.Geometry,
    roads: shapely.Geometry,
    keep: Spots,
    remove: Spots,
    spacing: float,
) -> tuple[PointCloud, list[Removal], list[Removal], list[Removal]]:
    """Return a cloud without vehicles, and the removed, kept and other objects."""
    gone = np.zeros(len(cloud.points), bool)
    removed: list[Removal] = []
    kept: list[Removal] = []
    passed: list[Removal] = []
    step = max(STREET_CELL_M, 1.5 * spacing)
    spots = shapely.union_all(remove.areas())
    rounds = [(roads, False)] if traffic else []
    if not spots.is_empty:
        rounds.append((spots, True))
    for where, named in rounds:
        street = street_of_points(cloud.points, region, where, step)
        known = street.shape is not None
        for blob in find_blobs(street, 0.2 if named else 0.3):
            if named:
                kind = "piece" if remove.near([blob.middle])[0] else ""
                why = "named by an override"
            else:
                kind, why = vehicle_kind(blob, roads_known=known)
            mine = np.zeros(0, np.int64)
            if kind:
                mine = _points_of(cloud, street, blob, settled=not named)
            line = Removal(
                kind or "other", why, blob.middle, blob.size, 0.0, len(mine), blob.outline
            )
            if not kind or not len(mine):
                if known and not named and blob.width > 0.5 and blob.length < 25.0:
                    passed.append(line)
            elif not named and keep.near([blob.middle])[0]:
                kept.append(line)
            else:
                gone[mine] = True
                removed.append(line)
    return cloud.select(~gone), removed, kept, passed


def _points_of(
    cloud: PointCloud, street: Street, blob: Blob, *, settled: bool
) -> NDArray[np.int64]:
    """Return the points of a blob above the street, in its cells and in connected ones."""
    grid = street.grid
    row, column = max(blob.row - _SKIRT, 0), max(blob.column - _SKIRT, 0)
    window = (
        slice(row, blob.row + blob.mask.shape[0] + _SKIRT),
        slice(column, blob.column + blob.mask.shape[1] + _SKIRT),
    )
    above = street.height[window] > _OVER_M
    mask = np.zeros(above.shape, bool)
    mask[blob.row - row :, blob.column - column :][: blob.mask.shape[0], : blob.mask.shape[1]] = (
        blob.mask
    )
    mask = binary_dilation(mask, np.ones((3, 3), bool), iterations=_SKIRT, mask=above | mask)
    rows, columns = np.floor((cloud.points[:, 1::-1] - (grid.south, grid.west)) / grid.step).T
    rows, columns = rows - row, columns - column
    near = (rows >= 0) & (columns >= 0) & (rows < mask.shape[0]) & (columns < mask.shape[1])
    numbers = np.flatnonzero(near)
    within = mask[rows[numbers].astype(int), columns[numbers].astype(int)]
    over = cloud.points[numbers, 2] - street.bare[grid.cells(cloud.points[numbers, :2])]
    mine = within & (over > _OVER_M) & (over < blob.height + 1.0)
    if settled and cloud.classification is not None:
        mine &= ~np.isin(cloud.classification[numbers], _SETTLED)
    return np.asarray(numbers[mine])
