"""Removed and kept parts of cleaning: lines of its report, and data of its picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.io.model import PointCloud, TriangleMesh
from urbantwin.reconstruct.cleaning.weld import Pieces, areas_of_faces, pieces_of
from urbantwin.site.geometry import Spot

__all__ = ["CleaningPicture", "Removal", "Spots", "measures"]


@dataclass(frozen=True, eq=False)
class Removal:
    """A piece that was removed, or that an override kept.

    Attributes:
        what: ``shard``, ``car``, ``truck or bus``, ``row of cars``, ``smear``, ``piece``,
            ``points``.
        why: the rule that applied, in words.
        at: (3,) its centre, site frame, metres.
        size: (3,) length, width and height, metres.
        area: area of its triangles, square metres; 0 for points.
        count: number of its triangles or points.
        outline: in plan, for pictures; ``None`` for shards.
        closed: area of the surface made in its place, square metres.
    """

    what: str
    why: str
    at: NDArray[np.float64]
    size: NDArray[np.float64]
    area: float
    count: int
    outline: shapely.Geometry | None = None
    closed: float = 0.0

    def line(self, frame: SiteFrame | None, unit: str = "triangles") -> dict[str, Any]:
        """Return the removal as a line of ``geometry.json``."""
        out: dict[str, Any] = {
            "what": self.what,
            "why": self.why,
            "at_m": [round(float(v), 2) for v in self.at],
        }
        if frame is not None:
            lon, lat = frame.lonlat_from_site([self.at[:2]])[0]
            out |= {"latitude": round(float(lat), 7), "longitude": round(float(lon), 7)}
        out |= {
            "size_m": [round(float(v), 2) for v in self.size],
            "area_m2": round(self.area, 3),
            unit: self.count,
        }
        if self.closed:
            out["closed_m2"] = round(self.closed, 2)
        return out


class Spots:
    """Positions of overrides, with a record of which had an effect."""

    def __init__(self, spots: list[Spot], frame: SiteFrame | None) -> None:
        self._spots = spots
        self._place = np.zeros((len(spots), 3))
        self._flat = np.ones(len(spots), bool)
        self._radius = np.array([spot.radius_m for spot in spots], np.float64)
        for k, spot in enumerate(spots):
            if spot.at_m is not None:
                self._place[k, : len(spot.at_m)] = spot.at_m
                self._flat[k] = len(spot.at_m) == 2
            elif frame is not None and spot.longitude is not None and spot.latitude is not None:
                self._place[k, :2] = frame.site_from_lonlat([[spot.longitude, spot.latitude]])[0]
            else:
                self._radius[k] = -1.0
        self.met = np.zeros(len(spots), bool)

    def __len__(self) -> int:
        return len(self._spots)

    def near(self, middles: ArrayLike) -> NDArray[np.bool_]:
        """Return the mask of centres (N, 3) within a spot, and record the spots with matches."""
        points = np.asarray(middles, np.float64).reshape(-1, 3)
        out = np.zeros(len(points), bool)
        for k, place in enumerate(self._place):
            axes = 2 if self._flat[k] else 3
            hit = np.linalg.norm(points[:, :axes] - place[:axes], axis=1) <= self._radius[k]
            out |= hit
            self.met[k] |= bool(hit.any())
        return out

    def widest(self, least: float) -> float:
        """Return the maximum width of objects centred in a spot, metres: twice the radius."""
        return max(least, 2.0 * float(self._radius.max(initial=0.0)) + 1.0)

    def areas(self) -> list[shapely.Polygon]:
        """Return the spots in plan, with a margin for objects with their centre in them."""
        return [
            shapely.Point(*place[:2]).buffer(radius + 3.0)
            for place, radius in zip(self._place, self._radius, strict=True)
            if radius > 0
        ]

    def unmet(self, word: str) -> list[str]:
        """Return a line for every spot without an effect."""
        return [
            f"nothing to {word} within {radius:g} m of ({place[0]:.1f}, {place[1]:.1f})"
            for place, radius, met in zip(self._place, self._radius, self.met, strict=True)
            if not met
        ]


def measures(mesh: TriangleMesh, pieces: Pieces | None = None) -> dict[str, Any]:
    """Return triangles, area, bounds and number of pieces of a mesh, for reports.

    Args:
        mesh: every vertex used.
        pieces: pieces of the mesh, if known.
    """
    if not len(mesh.faces):
        return {"triangles": 0, "vertices": 0, "area_m2": 0.0, "bounds_m": None, "pieces": 0}
    bounds = [mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)]
    return {
        "triangles": len(mesh.faces),
        "vertices": len(mesh.vertices),
        "area_m2": round(float(areas_of_faces(mesh).sum()), 2),
        "bounds_m": [[round(float(v), 3) for v in corner] for corner in bounds],
        "pieces": len(pieces_of(mesh) if pieces is None else pieces),
    }


@dataclass(frozen=True, eq=False)
class CleaningPicture:
    """Data of a picture of cleaning, before and after.

    Attributes:
        before: the input mesh (or points), in the region and around it.
        after: the result.
        removed: removed pieces.
        kept: pieces that an override kept.
        passed: objects on the carriageway that do not qualify as vehicles.
        region: region of interest.
        roads: carriageways, may be empty.
    """

    before: TriangleMesh | PointCloud
    after: TriangleMesh | PointCloud
    removed: tuple[Removal, ...]
    kept: tuple[Removal, ...]
    passed: tuple[Removal, ...]
    region: shapely.Geometry
    roads: shapely.Geometry
