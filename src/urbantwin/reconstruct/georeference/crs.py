"""Transformation from a known CRS to the plan of the site frame."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import AreaOfInterest, TransformerGroup

from urbantwin.geometry import SiteFrame
from urbantwin.reconstruct.georeference.height_system import area_of
from urbantwin.reconstruct.georeference.source_error import source_error
from urbantwin.site.geometry import GeometrySource

__all__ = ["InPlan", "crs_from_text", "in_plan", "lengths_of"]

_WGS84 = CRS("EPSG:4326")


@dataclass(frozen=True, eq=False)
class InPlan:
    """Points in plan, and their transformation.

    Attributes:
        xy: (N, 2) site frame, metres.
        lonlat: (N, 2) degrees, WGS84.
        height: (N,) ellipsoidal height if the CRS is geocentric, metres; otherwise the unchanged
            third coordinate.
        transformation: its name.
        accuracy_m: accuracy stated by PROJ; ``None`` if unknown.
        missing: grids that a better transformation needs.
    """

    xy: NDArray[np.float64]
    lonlat: NDArray[np.float64]
    height: NDArray[np.float64]
    transformation: str
    accuracy_m: float | None
    missing: tuple[str, ...]


def crs_from_text(text: str, source: GeometrySource) -> CRS:
    """Return the CRS of a user's text.

    Raises:
        InputError: it is unknown.
    """
    try:
        return CRS.from_user_input(text)
    except CRSError:
        raise source_error(
            source,
            f"has the crs {text[:60]!r}, which PROJ does not know",
            "crs",
            expected="a coordinate reference system such as EPSG:7415, PROJ or WKT",
        ) from None


def lengths_of(crs: CRS) -> float | None:
    """Return metres per unit of the plan's axes; ``None`` for angles."""
    plan = crs.sub_crs_list[0] if crs.is_compound else crs
    if plan.is_bound and plan.source_crs is not None:
        plan = plan.source_crs
    if plan.is_geographic:
        return None
    return float(plan.axis_info[0].unit_conversion_factor) if plan.axis_info else 1.0


def in_plan(
    points: NDArray[np.float64], crs: CRS, frame: SiteFrame, source: GeometrySource
) -> InPlan:
    """Transform points to the site's plan, with the datum transformation.

    Args:
        points: (N, 3) in the CRS, east before north.
        crs: their CRS.
        frame: the site frame.
        source: their source, for errors.

    Raises:
        InputError: the CRS has no known location, only a ballpark transformation, or is not valid
            at the points.
    """
    plan = crs
    if crs.is_compound:
        plan = crs.sub_crs_list[0]
    elif not crs.is_geocentric and not crs.is_vertical:
        plan = crs.to_2d()
    if (crs.is_vertical and not crs.is_compound) or crs.is_engineering or plan.is_engineering:
        kind = "engineering" if crs.is_engineering or plan.is_engineering else "vertical"
        raise source_error(
            source,
            f"has the {kind} CRS {crs.name!r}, which has no known place on Earth",
            expected="crs, control_points, similarity, origin or register in site.yaml",
        )
    target = CRS("EPSG:4979") if plan.is_geocentric else _WGS84
    here = area_of(frame.longitude, frame.latitude)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a missing best grid is reported below
        try:
            group = _group(plan, target, here)
            if not group.transformers and not group.unavailable_operations:
                # in another part of the world: the distance is reported later
                group = _group(plan, target, None)
        except (CRSError, ProjError) as error:
            raise source_error(
                source,
                f"has the CRS {crs.name!r}, which cannot be transformed ({str(error)[:120]})",
            ) from None
    missing = tuple(
        dict.fromkeys(
            grid.short_name
            for operation in group.unavailable_operations[:1]
            for grid in operation.grids
            if not grid.available
        )
    )
    if not group.transformers:
        why = f"needs PROJ's grid {', '.join(missing)}, which is not installed"
        raise source_error(
            source,
            f"has the CRS {crs.name!r}, from which no transformation to WGS 84 is known"
            if not missing
            else f"has the CRS {crs.name!r}, whose transformation to WGS 84 {why}",
            expected="another crs, or control_points or register in site.yaml",
        )
    best = group.transformers[0]
    x, y, z = best.transform(points[:, 0], points[:, 1], points[:, 2])
    lonlat = np.column_stack([x, y]).astype(np.float64)
    height = np.asarray(z, np.float64) if plan.is_geocentric else points[:, 2]
    xy = np.full((len(points), 2), np.nan)
    good = np.isfinite(lonlat).all(axis=1)
    if good.any():
        xy[good] = frame.site_from_lonlat(lonlat[good])
    if not np.isfinite(xy).all():
        share = 1.0 - np.isfinite(xy).all(axis=1).mean()
        raise source_error(
            source,
            f"has {share:.0%} of its points where its CRS {crs.name!r} does not hold",
            expected="coordinates of that CRS, east before north",
        )
    stated = best.accuracy
    accuracy = float(stated) if stated is not None and stated >= 0 else None
    if plan == _WGS84 or (plan.is_geocentric and accuracy is None):
        accuracy = 0.0
    return InPlan(xy, lonlat, height, best.description, accuracy, missing)


def _group(a: CRS, b: CRS, area: AreaOfInterest | None) -> TransformerGroup:
    return TransformerGroup(a, b, always_xy=True, area_of_interest=area, allow_ballpark=False)
