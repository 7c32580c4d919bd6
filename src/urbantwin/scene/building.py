"""Buildings: watertight solids over mapped footprints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely import Geometry, MultiPolygon, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.building_height import building_materials, building_rise, building_type
from urbantwin.scene.canopy import canopy_posts
from urbantwin.scene.extrude import Body, clean_polygons, extrude
from urbantwin.scene.passage import (
    ROAD_CLEARANCE_M,
    Opening,
    Passage,
    open_bodies,
    passages_of,
)
from urbantwin.scene.solids import Assembly, GroundHeight, Solid
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id

__all__ = ["building_footprints", "building_mesh"]

#: Walls reach this far below the lowest ground at the outline, metres.
FOUNDATION_M = 0.5
#: Carriageways are kept free with this margin, metres, where they run into a mapped footprint
#: by more than the given area, square metres.
KERB_M = 0.3
OVERLAP_M2 = 1.0
#: A roof without walls is a slab of this thickness, metres.
SLAB_M = 0.3
ROOF_TYPES = ("roof", "carport", "canopy")


@dataclass
class _Building:
    """An outline with the parts that stand in it."""

    tags: dict[str, str]
    footprints: list[Polygon]
    parts: list[tuple[dict[str, str], Polygon]] = field(default_factory=list)

    def plan(self) -> Geometry:
        """Return the whole footprint."""
        return shapely.union_all([*self.footprints, *(polygon for _, polygon in self.parts)])


@dataclass(frozen=True)
class _Volume:
    """A body in heights above the building's lowest ground; wall and roof material."""

    body: Body
    materials: tuple[str, str]
    is_roof: bool


def building_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build every building that touches the region, whole.

    Footprints are extruded with flat roofs; parts replace the outline where they stand. Each
    building is one closed surface with its normals outward. Where a mapped passage runs through
    a building it is open beneath; where a carriageway runs into a building without one, the
    carriageway is cut out.

    Args:
        features: the map's features, site frame.
        region: the region of interest, site frame.
        ground_height: heights of the ground.
        carriageway: the carriageways at ground level, site frame.

    Returns:
        The mesh, ``part`` 1, 2, ... per building, and counts of what was built and assumed.
    """
    notes: Counter[str] = Counter()
    buildings = _buildings(features, region, notes)
    passages = passages_of(features)
    passage_tree = shapely.STRtree([passage.line for passage in passages])
    shapely.prepare(carriageway)
    plans = [building.plan() for building in buildings]
    ground = _lowest_ground(plans, ground_height, notes)
    assembly = Assembly()
    for building, plan, datum in zip(buildings, plans, ground, strict=True):
        volumes = _volumes(building, notes)
        near = [passages[k] for k in sorted(passage_tree.query(plan).tolist())]
        openings = _openings(plan, near, carriageway, ground_height, float(datum), notes)
        _add(assembly, volumes, openings, carriageway, float(datum))
    notes["buildings"] = assembly.parts
    return assembly.mesh(), {k: n for k, n in sorted(notes.items()) if n or k == "buildings"}


def building_footprints(features: Iterable[OsmFeature]) -> list[Polygon]:
    """Return the footprints of the buildings that stand on the ground, for others to keep clear."""
    return [
        polygon
        for feature in features
        if _is_drawn(feature.tags, "building") and building_type(feature.tags) not in ROOF_TYPES
        for polygon in clean_polygons(feature.geometry)
    ]


def _is_drawn(tags: dict[str, str], key: str) -> bool:
    """Tell whether a feature is a building (or a part) that stands above the ground."""
    if tags.get(key, "no") == "no":
        return False
    if tags.get("location") == "underground" or tags.get("building") == "underground":
        return False
    return not tags.get("layer", "0").strip().startswith("-")


def _buildings(
    features: Sequence[OsmFeature], region: Polygon, notes: Counter[str]
) -> list[_Building]:
    """Collect outlines and give every part to the outline that it stands in."""
    outlines: list[_Building] = []
    parts: list[tuple[dict[str, str], Polygon]] = []
    for feature in features:
        key = "building:part" if "building:part" in feature.tags else "building"
        if "building" in feature.tags and feature.tags["building"] != "no":
            key = "building"
        if key not in feature.tags:
            continue
        if not _is_drawn(feature.tags, key):
            notes["not drawn (underground or mapped as no building)"] += 1
            continue
        if not isinstance(feature.geometry, Polygon | MultiPolygon):
            continue  # entrances and the like, mapped as nodes
        polygons = clean_polygons(feature.geometry)
        if not polygons:
            notes["footprints without area, dropped"] += 1
        elif key == "building":
            outlines.append(_Building(feature.tags, polygons))
        else:
            parts += [(feature.tags, polygon) for polygon in polygons]
    outlines = _without_twins(outlines, notes)
    tree = shapely.STRtree([MultiPolygon(outline.footprints) for outline in outlines])
    for tags, polygon in parts:
        owner, most = None, 0.5 * polygon.area
        for k in sorted(tree.query(polygon).tolist()):
            shared = polygon.intersection(tree.geometries[k]).area
            if shared > most:
                owner, most = outlines[k], shared
        if owner is None:
            notes["parts without a building around them"] += 1
            owner = _Building(tags, [])
            outlines.append(owner)
        owner.parts.append((tags, polygon))
    return [
        outline
        for outline in outlines
        if any(region.intersects(p) for p in outline.footprints)
        or any(region.intersects(p) for _, p in outline.parts)
    ]


def _without_twins(outlines: list[_Building], notes: Counter[str]) -> list[_Building]:
    """Drop outlines mapped twice: as a relation and again as its outer way."""
    if not outlines:
        return []
    filled = [
        shapely.union_all([Polygon(p.exterior) for p in outline.footprints]) for outline in outlines
    ]
    tree = shapely.STRtree(filled)
    dropped: set[int] = set()
    for first, second in sorted(map(tuple, tree.query(filled, predicate="intersects").T.tolist())):
        if first >= second or first in dropped or second in dropped:
            continue
        shared = filled[first].intersection(filled[second]).area
        if shared > 0.97 * max(filled[first].area, filled[second].area):
            # The one with courtyards knows more; else the later, for relations come last.
            holes = [sum(len(p.interiors) for p in outlines[k].footprints) for k in (first, second)]
            dropped.add(second if holes[0] > holes[1] else first)
            notes["outlines mapped twice, dropped"] += 1
    return [outline for k, outline in enumerate(outlines) if k not in dropped]


def _volumes(building: _Building, notes: Counter[str]) -> list[_Volume]:
    """Return the bodies of a building in metres above its lowest ground."""
    volumes = []
    area = sum(p.area for p in building.footprints)
    top = 0.0
    if building.footprints:
        rise = building_rise(building.tags, {}, area, notes if not building.parts else Counter())
        top = rise.high_m
    replaced = []
    for tags, polygon in building.parts:
        part_rise = building_rise(tags, building.tags, polygon.area, notes)
        is_roof = building_type(tags) in ROOF_TYPES
        low = part_rise.low_m
        if is_roof and low == 0.0:
            low = max(part_rise.high_m - SLAB_M, 0.5 * part_rise.high_m)
        materials = building_materials(tags, building.tags)
        volumes.append(_Volume(Body(polygon, low, part_rise.high_m), materials, is_roof))
        if low < top - 0.5:  # else it stands on the roof of its building
            replaced.append(polygon)
    is_roof = building_type(building.tags) in ROOF_TYPES
    materials = building_materials(building.tags, {})
    for polygon in building.footprints:
        rest = [polygon]
        if replaced:
            # Opened by 15 cm: what is left between parts drawn a little apart is no building.
            left = shapely.difference(polygon, shapely.union_all(replaced))
            left = left.buffer(-0.15, join_style="mitre").buffer(0.15, join_style="mitre")
            rest = clean_polygons(left, smallest_m2=2.0, thinnest_m=0.5)
        low = rise.low_m
        if is_roof and low == 0.0:
            low = max(rise.high_m - SLAB_M, 0.5 * rise.high_m)
        volumes += [_Volume(Body(p, low, rise.high_m), materials, is_roof) for p in rest]
    return volumes


def _lowest_ground(
    plans: Sequence[Geometry], ground_height: GroundHeight, notes: Counter[str]
) -> list[float]:
    """Return the lowest ground along each plan's outline."""
    if not plans:
        return []
    points, owner = shapely.get_coordinates(shapely.segmentize(plans, 4.0), return_index=True)
    height = ground_height(points)
    known = np.isfinite(height)
    lowest = np.full(len(plans), np.inf)
    np.minimum.at(lowest, owner[known], height[known])
    unknown = ~np.isfinite(lowest)
    if unknown.any():
        notes["buildings where no ground is known"] = int(unknown.sum())
    return [float(z) for z in np.where(unknown, 0.0, lowest)]


def _openings(
    plan: Geometry,
    passages: Sequence[Passage],
    carriageway: Geometry,
    ground_height: GroundHeight,
    datum: float,
    notes: Counter[str],
) -> list[Opening]:
    """Return what must be open at the ground, ceilings in metres above the building's ground."""

    def ceiling(footprint: Geometry, clearance: float) -> float:
        inside = footprint.intersection(plan)
        height = ground_height(shapely.get_coordinates(shapely.segmentize(inside, 4.0)))
        height = height[np.isfinite(height)]
        return float(max(height.max() - datum, 0.0) if len(height) else 0.0) + clearance

    crossing = [p for p in passages if p.line.intersection(plan).length > 0.5]
    openings = [Opening(p.corridor, ceiling(p.corridor, p.clearance_m), 0.0) for p in crossing]
    notes["passages through buildings"] += len(openings)
    if not carriageway.intersects(plan):
        return openings
    overlap = carriageway.intersection(plan)
    if overlap.area <= OVERLAP_M2:
        return openings
    for piece in clean_polygons(overlap, smallest_m2=0.05, thinnest_m=0.0):
        grown = piece.buffer(KERB_M, join_style="mitre")
        clear = ceiling(grown, ROAD_CLEARANCE_M)
        covered = any(p.line.intersects(piece) for p in crossing)
        openings.append(Opening(grown, clear if covered else np.inf, clear))
        notes["carriageways cut out of buildings"] += not covered
    return openings


def _add(
    assembly: Assembly,
    volumes: Sequence[_Volume],
    openings: Sequence[Opening],
    carriageway: Geometry,
    datum: float,
) -> None:
    """Extrude one building and add it, labelled.

    Volumes of one material are joined to one surface; a roof on posts is lifted over a
    carriageway as a whole.
    """
    groups: dict[tuple[str, str], list[Body]] = {}
    posts: list[Solid] = []
    for volume in volumes:
        bodies = [volume.body]
        if volume.is_roof:
            bodies = [_lifted(volume.body, openings)]
            posts += canopy_posts(bodies[0], carriageway, datum, FOUNDATION_M)
        bodies = open_bodies(bodies, openings)
        groups.setdefault(volume.materials, []).extend(bodies)
    if not any(groups.values()):
        return
    part = assembly.new_part()
    for (wall, roof), bodies in groups.items():
        if not bodies:
            continue
        solid = extrude([_founded(body, datum) for body in bodies])
        up = solid.rises() > 0.5
        material = np.where(up, material_id(roof), material_id(wall))
        assembly.add(solid, "building", material, part)
    for post in posts:
        assembly.add(post, "building", "metal-painted", part)


def _lifted(body: Body, openings: Sequence[Opening]) -> Body:
    """Lift a raised body above every ceiling under it."""
    under = [o.raised_ceiling for o in openings if o.footprint.intersects(body.footprint)]
    lift = max(0.0, *under, body.low) - body.low
    return Body(body.footprint, body.low + lift, body.high + lift)


def _founded(body: Body, datum: float) -> Body:
    """Place a body on its building's ground, walls that start there reaching into it."""
    low = datum + body.low if body.low > 0 else datum - FOUNDATION_M
    return Body(body.footprint, low, datum + body.high)
