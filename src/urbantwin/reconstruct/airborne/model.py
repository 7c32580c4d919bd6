"""Extraction of ground, buildings and trees from an airborne survey."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_closing

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.ground import ElevationPatch
from urbantwin.io.model import PointCloud
from urbantwin.reconstruct.airborne.bare_earth import bare_earth, levelled_water
from urbantwin.reconstruct.airborne.building import FOUNDATION_M, BuiltRoof, build_roof
from urbantwin.reconstruct.airborne.ground_filter import (
    GROUND,
    WATER,
    ground_by_filter,
    has_ground_class,
    inside_any,
)
from urbantwin.reconstruct.airborne.noise import is_noise, thinned
from urbantwin.reconstruct.airborne.outlines import (
    SMALLEST_M2,
    cut_blocks,
    find_outlines,
    is_plane_like,
)
from urbantwin.reconstruct.airborne.raster import Raster, filled
from urbantwin.reconstruct.airborne.trees import find_trees
from urbantwin.reconstruct.reconstruction import SurveyedTree
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["AirborneModel", "from_airborne"]

#: Margin around the region whose points shape the ground and buildings at its border, metres.
MARGIN_M = 40.0
#: Minimum height of a roof above the ground, metres.
LOWEST_ROOF_M = 1.8
#: Minimum height of buildings outlined from points, above buses and containers, metres.
_LOWEST_FOUND_M = 2.2
_BUILDING, _VEGETATION = 6, (3, 4, 5)
_BRIDGE = (17, 26)  # ASPRS LAS 1.4: bridge deck; 26 in the Dutch AHN: civil structures
_UNKNOWN = (0, 1)


@dataclass(frozen=True, eq=False)
class AirborneModel:
    """The contents of an airborne survey, site frame.

    Attributes:
        ground: the bare earth.
        buildings: closed surfaces; ``part`` numbers them from 1.
        outlines: outlines of the buildings, in the order of their parts.
        trees: from west to east.
        covers: areas where the survey replaces the map's ``buildings`` and ``trees``.
        report: counts and values.
    """

    ground: ElevationPatch
    buildings: LabelledMesh
    outlines: tuple[shapely.Polygon, ...] = ()
    trees: tuple[SurveyedTree, ...] = ()
    covers: dict[str, shapely.Geometry] = field(default_factory=dict)
    report: dict[str, object] = field(default_factory=dict)


def from_airborne(
    cloud: PointCloud,
    *,
    footprints: Sequence[shapely.Polygon],
    region: shapely.Polygon,
    name: str,
    detail_m: float | None = None,
    wall_material: str = "brick",
    roof_material: str = "roofing",
) -> AirborneModel:
    """Extract ground, buildings and trees from an airborne survey.

    Classes of the survey are used if present. Otherwise the ground is found by a morphological
    filter, buildings as high planar areas, and trees as high rough ones.

    Args:
        cloud: the survey, site frame.
        footprints: outlines of buildings, site frame; buildings outside all of them are outlined
            from the points.
        region: region to extract.
        name: name of the source.
        detail_m: size of the smallest detail of the ground; ``None``: spacing of points.
        wall_material: material of walls.
        roof_material: material of roofs.

    Raises:
        InputError: the survey has no points in the region, or no ground points.
    """
    west, south, east, north = region.buffer(MARGIN_M).bounds
    at = cloud.points
    inside = (at[:, 0] > west) & (at[:, 0] < east) & (at[:, 1] > south) & (at[:, 1] < north)
    if not shapely.intersects_xy(region, at[inside, 0], at[inside, 1]).any():
        raise InputError(
            f"{name}: none of its {len(at)} points lies in the region",
            expected="a survey of the site",
        )
    near = cloud.select(inside)
    noise = is_noise(near)
    near = near.select(~noise)
    if not len(near.points):
        raise InputError(
            f"{name}: all of its {len(noise)} points around the region are noise",
            expected="a survey of the site",
        )
    near = thinned(near)
    survey = _Survey(near, footprints, region, name, detail_m)
    outlines = survey.outlines()
    built = survey.buildings(outlines)
    mesh, kept = _labelled(built, outlines, wall_material, roof_material)
    trees = survey.trees([outlines[k] for k in kept])
    report: dict[str, object] = {
        "points": len(noise),
        "noise_points": int(noise.sum()),
        "thinned_points": int((~noise).sum()) - len(near.points),
        "ground_points": int(survey.ground.sum()),
        "ground_by": "classes" if survey.classified else "filter",
        "outlines": len(outlines),
        "outlines_found": len(outlines) - survey.given,
        "buildings": len(kept),
        "roofs": dict(sorted(Counter(built[k].shape for k in kept).items())),  # type: ignore[union-attr]
        "triangles": len(mesh.faces),
        "trees": len(trees),
    }
    covers = survey.covers([o for k, o in enumerate(outlines) if built[k] is None])
    return AirborneModel(
        survey.patch, mesh, tuple(outlines[k] for k in kept), trees, covers, report
    )


class _Survey:
    """A survey with its ground."""

    def __init__(
        self,
        cloud: PointCloud,
        footprints: Sequence[shapely.Polygon],
        region: shapely.Polygon,
        name: str,
        detail_m: float | None,
    ) -> None:
        self.cloud, self.region = cloud, region
        self.footprints = [f for f in footprints if f.intersects(region)]
        self.given = len(self.footprints)
        points = cloud.points
        classes = cloud.classification
        self.classes = np.zeros(len(points), np.uint8) if classes is None else classes
        self.classified = has_ground_class(cloud)
        water = self.classes == WATER
        if self.classified:
            self.ground = (self.classes == GROUND) | water
        else:
            candidate = ~np.isin(self.classes, (_BUILDING, *_VEGETATION, *_BRIDGE))
            self.ground = np.zeros(len(points), bool)
            if candidate.any():
                self.ground[candidate] = ground_by_filter(points[candidate], self.footprints)
        if self.ground.sum() < 3:
            raise InputError(
                f"{name}: none of its points in the region is ground",
                expected="a survey that shows the ground (ASPRS class 2), or unclassified points",
            )
        flat = levelled_water(points, water & self.ground)
        self.patch = bare_earth(flat[self.ground], region, name=name, detail_m=detail_m)
        if not np.isfinite(self.patch.heights).any():
            raise InputError(
                f"{name}: its ground points in the region span no area",
                expected="a survey that shows the ground",
            )
        self._grid = Raster(
            self.patch.west, self.patch.south, self.patch.step, self.patch.heights.shape
        )
        self._heights = filled(self.patch.heights)
        self.above = points[:, 2] - self._grid.sample(self._heights, points[:, :2])

    def outlines(self) -> list[shapely.Polygon]:
        """Return the outlines of buildings: the given ones, and those found outside of them."""
        roof = self._roof_points() & (self.above > _LOWEST_FOUND_M)
        roof[roof] = ~inside_any(
            [f.buffer(1.0) for f in self.footprints], self.cloud.points[roof, :2]
        )
        points = self.cloud.points[roof]
        if not (self.classes == _BUILDING).any():
            points = points[is_plane_like(points)]
        found = cut_blocks(find_outlines(points), points)
        found = [o for o in found if o.intersects(self.region)]
        if found and self.footprints:
            known = shapely.union_all(self.footprints)
            rest = shapely.difference(np.array(found, dtype=object), known.buffer(0.05))
            found = [p for p in shapely.get_parts(rest) if p.area > SMALLEST_M2]
        return [*self.footprints, *found]

    def _roof_points(self) -> NDArray[np.bool_]:
        """Return the mask (N,) of points that may be on roofs."""
        high = self.above > LOWEST_ROOF_M
        if (self.classes == _BUILDING).any():
            return np.asarray((self.classes == _BUILDING) & (self.above > 0.5))
        roof = high & ~self.ground & np.isin(self.classes, _UNKNOWN)
        if self.cloud.last is not None:
            # Leaves above a roof give first returns; the roof gives the last.
            roof &= self.cloud.last
        return np.asarray(roof)

    def buildings(self, outlines: Sequence[shapely.Polygon]) -> list[BuiltRoof | None]:
        """Return the building of each outline; ``None`` without enough points."""
        roof = self.cloud.points[self._roof_points()]
        roof = roof[np.argsort(roof[:, 0], kind="stable")]
        built: list[BuiltRoof | None] = []
        for outline in outlines:
            west, south, east, north = outline.bounds
            strip = roof[slice(*np.searchsorted(roof[:, 0], [west, east]).tolist())]
            strip = strip[(strip[:, 1] > south) & (strip[:, 1] < north)]
            mine = strip[shapely.contains_xy(outline, strip[:, 0], strip[:, 1])]
            if len(mine) < 4:
                built.append(None)
                continue
            rim = shapely.get_coordinates(outline.segmentize(2.0))
            base = float(self._grid.sample(self._heights, rim).min()) - FOUNDATION_M
            house = build_roof(outline, mine, base)
            if house is not None and house.shape == "flat" and len(built) >= self.given:
                house = None  # flat roofs of few points, without a mapped outline, are dropped
            built.append(house)
        return built

    def trees(self, outlines: Sequence[shapely.Polygon]) -> tuple[SurveyedTree, ...]:
        """Return the trees outside buildings."""
        told = np.isin(self.classes, _VEGETATION)
        other = ~self.ground & np.isin(self.classes, (*_UNKNOWN, *_VEGETATION))
        other &= self.above > 1.0
        wide = [outline.buffer(0.7) for outline in outlines]
        other[other] = ~inside_any(wide, self.cloud.points[other, :2])
        says = told.sum() > 0.02 * max(int(other.sum()), 1)
        found = find_trees(
            self.cloud.points[other],
            self.above[other],
            None if self.cloud.last is None else self.cloud.last[other],
            vegetation=told[other] if says else None,
        )
        return tuple(t for t in found if shapely.intersects_xy(self.region, t.x, t.y))

    def covers(self, empty: Sequence[shapely.Polygon]) -> dict[str, shapely.Geometry]:
        """Return the surveyed area: the region as far as there are points.

        Outlines without points remain the map's.
        """
        points = self.cloud.points
        grid = Raster.over(points.min(axis=0), points.max(axis=0), 4.0, pad=3)
        seen = binary_closing(grid.count(points[:, :2]) > 0, np.ones((5, 5)))
        east, north = grid.middles()
        squares = shapely.box(east[seen] - 2, north[seen] - 2, east[seen] + 2, north[seen] + 2)
        area = shapely.intersection(shapely.union_all(squares), self.region)
        houses = shapely.difference(area, shapely.union_all(list(empty))) if empty else area
        return {"buildings": houses, "trees": area}


def _labelled(
    built: Sequence[BuiltRoof | None],
    outlines: Sequence[shapely.Polygon],
    wall_material: str,
    roof_material: str,
) -> tuple[LabelledMesh, list[int]]:
    """Return all buildings as one mesh, and the indices of their outlines."""
    kept = [k for k in range(len(outlines)) if built[k] is not None]
    meshes = []
    for part, k in enumerate(kept, start=1):
        house = built[k]
        assert house is not None
        mesh = LabelledMesh.build(house.vertices, house.faces, semantic_id("building"), 0, part)
        wall = np.abs(mesh.normals()[:, 2]) < 0.1
        material = np.where(wall, material_id(wall_material), material_id(roof_material))
        meshes.append(
            LabelledMesh(mesh.vertices, mesh.faces, mesh.semantic,
                         material.astype(np.uint8), mesh.part)
        )  # fmt: skip
    return LabelledMesh.concatenate(meshes), kept
