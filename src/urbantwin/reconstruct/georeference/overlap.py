"""Overlap of a placed model with the region, or its distance."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import Geod

from urbantwin.geometry import SiteFrame
from urbantwin.io.model import ImportedModel
from urbantwin.reconstruct.georeference.source_error import source_error
from urbantwin.site.geometry import GeometrySource

__all__ = ["all_points", "check_finite", "check_meets", "distance_to"]

_MOST_POINTS = 200_000
_FAR_M = 10_000.0


def all_points(model: ImportedModel) -> list[NDArray[np.float64]]:
    """Return the non-empty arrays (N, 3) of a model's points."""
    arrays = (
        None if model.mesh is None else model.mesh.vertices,
        None if model.cloud is None else model.cloud.points,
    )
    return [one for one in arrays if one is not None and len(one)]


def check_finite(model: ImportedModel, source: GeometrySource) -> None:
    """Raise an error unless a model has points with finite coordinates.

    Raises:
        InputError: there are none, or some are not finite.
    """
    arrays = all_points(model)
    if not arrays:
        raise source_error(source, "holds no triangle and no point", "file", expected="geometry")
    bad = sum(int((~np.isfinite(one)).any(axis=1).sum()) for one in arrays)
    if bad:
        raise source_error(
            source,
            f"has {bad} points that are not numbers",
            "file",
            expected="finite coordinates",
        )


def distance_to(region: shapely.Polygon, arrays: list[NDArray[np.float64]]) -> float:
    """Return the distance of a model's hull in plan from a region, metres; 0 if they overlap."""
    out = np.inf
    for points in arrays:
        step = max(1, len(points) // _MOST_POINTS)
        xy = np.vstack([points[::step, :2], points[:, :2].min(axis=0), points[:, :2].max(axis=0)])
        if not np.isfinite(xy).all():
            continue
        # the two corners are not model points: only an approximate distance is needed
        hull = shapely.MultiPoint(xy[:-2] if step == 1 else xy).convex_hull
        out = min(out, float(hull.distance(region)))
    return out


def check_meets(
    model: ImportedModel,
    region: shapely.Polygon,
    source: GeometrySource,
    frame: SiteFrame,
    *,
    how: str,
    field: str | None,
) -> None:
    """Raise an error unless a placed model overlaps the region.

    Raises:
        InputError: it does not; the error gives the distance.
    """
    arrays = all_points(model)
    off = distance_to(region, arrays)
    if off <= 0:
        return
    if off > _FAR_M:
        # geodesic distance: far from the anchor, plane coordinates are distorted
        middle = np.median(arrays[0][:: max(1, len(arrays[0]) // 1000), :2], axis=0)
        lonlat = frame.lonlat_from_site(middle[None])[0]
        if np.isfinite(lonlat).all():
            off = Geod(ellps="WGS84").inv(frame.longitude, frame.latitude, *lonlat)[2]
    far = f"{off / 1000:,.0f} km" if off > _FAR_M else f"{off:,.0f} m"
    raise source_error(
        source,
        f"lies {far} from the site's region when it is placed by {how}",
        field,
        expected="a model that meets the region",
    )
