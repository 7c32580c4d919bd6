"""Cleaning of an imported mesh or point cloud for use in a static world."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.clip import clipped
from urbantwin.reconstruct.cleaning.decimate import decimated
from urbantwin.reconstruct.cleaning.removal import CleaningPicture, Removal, Spots, measures
from urbantwin.reconstruct.cleaning.shards import find_shards
from urbantwin.reconstruct.cleaning.traffic import without_traffic
from urbantwin.reconstruct.cleaning.weld import bounds_of_faces, cleared, pieces_of, selected
from urbantwin.site.geometry import CleanSpec

__all__ = ["Cleaned", "cleaned"]

#: Margin around the region that is processed, too, so that cars at its border are complete, metres.
_MARGIN_M = 8.0
#: Maximum width of pieces that overrides can remove, metres: wider ones are ground or blocks of
#: houses.
_WIDEST_PIECE_M = 40.0


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A mesh after cleaning.

    Attributes:
        mesh: site frame, metres; welded.
        report: for ``geometry.json``: ``before`` and ``after`` (triangles, area, bounds, pieces),
            ``removed`` and ``kept`` (kind, reason, position, size), ``left_out``, ``decimation``,
            ``notes``.
        picture: data for ``view.cleaning``.
    """

    mesh: TriangleMesh
    report: dict[str, Any] = field(default_factory=dict)
    picture: CleaningPicture | None = None


def cleaned(
    mesh: TriangleMesh,
    spec: CleanSpec,
    *,
    region: shapely.Polygon,
    roads: shapely.Geometry | None = None,
    sensors: ArrayLike | None = None,
    name: str = "",
    frame: SiteFrame | None = None,
) -> Cleaned:
    """Crop a mesh, remove its shards and traffic, and decimate it.

    Args:
        mesh: in the site frame, metres, z up.
        spec: enabled steps, and overrides.
        region: region to keep, in plan; triangles are cut at its border.
        roads: carriageways and parking in plan; without them, only single cars are detected.
        sensors: (S, 3) sensor positions, for the error of decimation.
        name: name of the source, for the report.
        frame: for latitudes and longitudes in the report and in overrides.
    """
    roads = shapely.MultiPolygon() if roads is None else roads
    places = np.zeros((0, 3)) if sensors is None else np.asarray(sensors, np.float64).reshape(-1, 3)
    keep, remove = Spots(list(spec.keep), frame), Spots(list(spec.remove), frame)
    mesh, left_out = cleared(mesh)
    pieces = pieces_of(mesh)
    report: dict[str, Any] = {"name": name, "before": measures(mesh, pieces), "left_out": left_out}
    near = _roughly(mesh, region)
    pieces, mesh = pieces if near is mesh else pieces_of(near), near
    removed: list[Removal] = []
    kept: list[Removal] = []
    passed: list[Removal] = []
    around = shapely.buffer(region, _MARGIN_M, join_style="mitre")
    if spec.shards and len(mesh.faces):
        shards = find_shards(mesh, pieces, spec.smallest_m, keep)
        mesh = selected(mesh, ~shards.faces)
        removed += shards.removed
        kept += shards.kept
    if spec.traffic:
        street = without_traffic(mesh, around, roads, keep)
        mesh = street.mesh
        removed += street.removed
        kept += street.kept
        passed += street.passed
    if len(remove):
        mesh, named = _named(mesh, remove)
        removed += named
    mesh, crossed = clipped(mesh, region) if len(mesh.faces) else (mesh, 0)
    left_out["cut_at_the_border"] = crossed
    removed = [one for one in removed if shapely.intersects_xy(around, *one.at[:2])]
    if spec.chordal_error_m != 0.0 and len(mesh.faces):
        before = len(mesh.faces)
        fewer = decimated(mesh, places, spec.chordal_error_m, _apart(mesh))
        mesh = fewer.mesh
        report["decimation"] = {
            "triangles_before": before,
            "triangles_after": len(mesh.faces),
            "zones": [
                {"bound_m": bound, "measured_m": round(most, 5), "p95_m": round(p95, 5)}
                for bound, most, p95 in zip(fewer.error, fewer.measured, fewer.p95, strict=True)
            ],
        }
    mesh, _ = cleared(mesh)
    report |= {
        "after": measures(mesh),
        "removed": [one.line(frame) for one in removed],
        "kept": [one.line(frame) for one in kept],
        "not_vehicles": [one.line(frame) for one in passed],
        "notes": keep.unmet("keep") + remove.unmet("remove"),
    }
    picture = CleaningPicture(near, mesh, tuple(removed), tuple(kept), tuple(passed), region, roads)
    return Cleaned(mesh, report, picture)


def _roughly(mesh: TriangleMesh, region: shapely.Polygon) -> TriangleMesh:
    """Return the triangles near the region's bounds."""
    if not len(mesh.faces):
        return mesh
    west, south, east, north = region.bounds
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    inside = (x >= west - _MARGIN_M) & (x <= east + _MARGIN_M)
    inside &= (y >= south - _MARGIN_M) & (y <= north + _MARGIN_M)
    if inside.all():
        return mesh
    low, high = bounds_of_faces(mesh.vertices[:, :2], mesh.faces)
    near = (high[:, 0] >= west - _MARGIN_M) & (low[:, 0] <= east + _MARGIN_M)
    near &= (high[:, 1] >= south - _MARGIN_M) & (low[:, 1] <= north + _MARGIN_M)
    return mesh if near.all() else selected(mesh, near)


def _apart(mesh: TriangleMesh) -> NDArray[np.int64]:
    """Return numbers (F,) of objects and classes whose borders decimation keeps."""
    if mesh.semantic is None:
        return mesh.object.astype(np.int64)
    return mesh.object.astype(np.int64) * 256 + mesh.semantic


def _named(mesh: TriangleMesh, remove: Spots) -> tuple[TriangleMesh, list[Removal]]:
    """Return a mesh without the pieces, or objects on the surface, that overrides name."""
    pieces = pieces_of(mesh)
    middle, size = pieces.middle, pieces.size
    gone = remove.near(middle) & (size[:, :2].max(axis=1) < _WIDEST_PIECE_M)
    removed = [
        Removal(
            "piece",
            "named by an override",
            middle[number],
            np.array([size[number, :2].max(), size[number, :2].min(), size[number, 2]]),
            float(pieces.area[number]),
            int(pieces.triangles[number]),
        )
        for number in np.flatnonzero(gone).tolist()
    ]
    if gone.any():
        mesh = selected(mesh, ~gone[pieces.of_face])
    where = shapely.union_all(remove.areas())
    if not where.is_empty and len(mesh.faces):
        street = without_traffic(mesh, shapely.box(*where.bounds), where, Spots([], None), remove)
        mesh = street.mesh
        removed += street.removed
    return mesh, removed
