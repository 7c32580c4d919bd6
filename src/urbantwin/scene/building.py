"""Buildings: watertight solids over mapped footprints, with roofs, passages and windows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import shapely
from shapely import Geometry, LineString, Polygon

from urbantwin.geometry import LabelledMesh, PartColours
from urbantwin.geometry.manifold import is_closed
from urbantwin.progress import Progress, between, each, untold
from urbantwin.roads.building_ground import ROAD_CLEARANCE_M, Passage, passages_of
from urbantwin.scene.building_outline import (
    MappedBuilding,
    building_footprints,
    mapped_buildings,
)
from urbantwin.scene.building_practice import Neighbours, usual_tags
from urbantwin.scene.building_shell import Shell, ShellPlan
from urbantwin.scene.building_volume import Volume, building_volumes
from urbantwin.scene.extrusion import Body, clean_polygons
from urbantwin.scene.facade import Front, facade_openings, mapped_doors, mapped_shops
from urbantwin.scene.facade.wall import DOOR, GLASS, ROOF
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, box
from urbantwin.scene.tag_values import colour_of
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id

__all__ = ["Buildings", "building_footprints", "building_mesh"]

#: A body with its underside lower than this above the building's ground rests on the ground.
RAISED_M = 2.0


@dataclass(frozen=True)
class Opening:
    """A volume removed from a building: a footprint, from the ground up to a ceiling, metres.

    Attributes:
        footprint: plan area of the volume.
        ceiling: for bodies on the ground; infinite if nothing may remain above.
        raised_ceiling: for raised bodies; 0 leaves them unchanged.
    """

    footprint: Geometry
    ceiling: float
    raised_ceiling: float


def open_bodies(bodies: Sequence[Body], openings: Sequence[Opening]) -> list[Body]:
    """Return bodies with openings removed: nothing solid remains below an opening's ceiling."""
    for opening in openings:
        opened: list[Body] = []
        for body in bodies:
            raised = body.low >= RAISED_M
            ceiling = opening.raised_ceiling if raised else opening.ceiling
            if body.low >= ceiling or not body.footprint.intersects(opening.footprint):
                opened.append(body)
                continue
            beside = body.footprint.difference(opening.footprint)
            opened += [replace(body, footprint=piece) for piece in clean_polygons(beside)]
            if max(body.eaves, body.low) - ceiling > 0.3 or (
                not body.roof and body.high - ceiling > 0.3
            ):
                above = body.footprint.intersection(opening.footprint)
                opened += [
                    replace(body, footprint=piece, low=ceiling)
                    for piece in clean_polygons(above, smallest_m2=0.0, thinnest_m=0.0)
                ]
        bodies = opened
    return list(bodies)


POST_M = 0.25
INSET_M = 0.4
SPACING_M = 8.0
#: Columns of arcades: side, spacing, and distance from the outline, metres.
COLUMN_M, BAY_M, EDGE_M = 0.45, 4.0, 0.3
#: Shorter openings than this, metres, are an arcade's ends.
OPEN_SIDE_M = 6.0


def canopy_posts(
    slab: Body, carriageway: Geometry, datum: float, foundation_m: float
) -> list[Solid]:
    """Return the posts that support a slab, none of them on a carriageway.

    Args:
        slab: the roof, heights above ``datum``.
        carriageway: area without posts, site frame.
        datum: the building's lowest ground, metres.
        foundation_m: depth of the posts below it.
    """
    inner = slab.footprint.buffer(-INSET_M).simplify(0.3)
    if inner.is_empty:
        spots = shapely.get_coordinates(slab.footprint.representative_point())
    else:
        rings = shapely.get_rings(shapely.get_parts(inner))
        spaced = shapely.segmentize(rings, SPACING_M)
        spots = np.concatenate([shapely.get_coordinates(ring)[:-1] for ring in spaced])

    if not carriageway.is_empty:
        spots = spots[shapely.distance(carriageway, shapely.points(spots)) > POST_M]
    if not len(spots):
        return []
    low, high = datum - foundation_m, datum + slab.low + 0.05
    centre = np.column_stack([spots, np.full(len(spots), (low + high) / 2)])
    size = np.broadcast_to([POST_M, POST_M, high - low], centre.shape)
    return [box(centre, size)]


def arcade_columns(plan: Geometry, corridor: Polygon, low: float, high: float) -> list[Solid]:
    """Return the columns along the open side of an arcade.

    Args:
        plan: the building's footprint.
        corridor: the ground area of the arcade.
        low: height of the bottom of the columns, metres.
        high: height of the ceiling.
    """
    inside = shapely.buffer(plan, -EDGE_M, join_style="mitre")
    sides = shapely.line_merge(shapely.intersection(inside.boundary, corridor.buffer(EDGE_M)))
    spots = [
        shapely.get_coordinates(shapely.segmentize(side, BAY_M))
        for side in shapely.get_parts(sides)
        if isinstance(side, LineString) and side.length >= OPEN_SIDE_M
    ]
    if not spots or high <= low:
        return []
    xy = np.concatenate(spots)
    centre = np.column_stack([xy, np.full(len(xy), (low + high) / 2)])
    return [box(centre, np.broadcast_to([COLUMN_M, COLUMN_M, high - low], centre.shape))]


#: Depth of walls below the lowest ground at the outline, metres.
FOUNDATION_M = 0.5
#: Carriageways are kept free with this margin, metres, if they overlap a mapped footprint by more
#: than the given area, square metres.
KERB_M = 0.3
OVERLAP_M2 = 1.0
#: Tags of the colours of walls and of roofs; the first that is mapped counts.
COLOURS = (("building:colour", "colour"), ("roof:colour", "building:roof:colour"))
#: Half the width of a pedestrian street, metres.
PROMENADE_M = 2.0


class Buildings(NamedTuple):
    """Buildings as triangles.

    Attributes:
        mesh: their surfaces, ``part`` 1, 2, ... per building.
        notes: counts of objects built and of assumptions.
        colours: colours of their walls and roofs.
    """

    mesh: LabelledMesh
    notes: dict[str, int]
    colours: PartColours


@dataclass(frozen=True, eq=False)
class _Placed:
    """A building at its position.

    Attributes:
        plan: plan of its surface.
        volumes: the volume of each body.
        tags: tags of each volume; those of the outline where a volume has none.
        posts: posts below its roofs.
    """

    plan: ShellPlan
    volumes: list[Volume]
    tags: list[dict[str, str]]
    posts: list[Solid]


def building_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    without: Geometry | None = None,
    country: str | None = None,
    tell: Progress = untold,
) -> Buildings:
    """Build all buildings that touch the region, as a whole.

    Walls reach up to the mapped roofs; building parts replace the outline where they are mapped.
    Materials, colours and roofs that are not mapped are drawn from those usual in the country.
    Walls visible from a carriageway have recessed windows and doors. Each building is one closed
    surface with its normals outward. A building is open below where a mapped passage runs through
    it. A carriageway that overlaps a building without a mapped passage is cut out.

    Args:
        features: the map's features, site frame.
        region: the region of interest, site frame.
        ground_height: heights of the ground.
        carriageway: the carriageways at ground level, site frame.
        without: area in which imported geometry contains the buildings: buildings with more than
            half of their area in it are left out.
        country: ISO 3166-1 alpha-2, empty if unknown; ``None`` draws nothing that is not mapped.
        tell: called with the share done (0..1) and the current task.
    """
    notes: Counter[str] = Counter()
    buildings = mapped_buildings(features, region, without, notes)
    passages = passages_of(features)
    passage_tree = shapely.STRtree([passage.line for passage in passages])
    shapely.prepare(carriageway)
    plans = [building.plan() for building in buildings]
    if country is not None:
        buildings = _with_usual_tags(buildings, plans, country, notes)
    ground = _lowest_ground(plans, ground_height, notes)
    placed: list[_Placed] = []
    colours: list[tuple[int, int, bool, tuple[int, ...]]] = []
    fronts: list[Front] = []
    standing = list(zip(buildings, plans, ground, strict=True))
    for building, plan, datum in each(standing, between(tell, 0.0, 0.5), "roofs"):
        volumes = building_volumes(building, notes)
        near = [passages[k] for k in sorted(passage_tree.query(plan).tolist())]
        openings = _openings(plan, near, carriageway, ground_height, datum, notes)
        try:
            found = _place(volumes, building.tags, openings, carriageway, datum)
        except shapely.GEOSException:  # The plan cannot be cut along roof slopes.
            notes["roofs drawn level: their plan could not be divided"] += 1
            volumes = [_level(volume) for volume in volumes]
            found = _place(volumes, building.tags, openings, carriageway, datum)
        if found is None:
            continue
        for passage, opening in zip(_crossing(near, plan), openings, strict=False):
            if passage.has_columns:
                top = datum + opening.ceiling + 0.05
                found.posts.extend(
                    arcade_columns(plan, passage.corridor, datum - FOUNDATION_M, top)
                )
        placed.append(found)
        fronts.append(Front(building, found.volumes, found.plan.walls, plan, datum))
    tell(0.5, "windows")
    windows = facade_openings(
        fronts,
        mapped_doors(features),
        mapped_shops(features),
        shapely.union_all([carriageway, *_promenades(features)]),
        ground_height=ground_height,
        notes=notes,
    )
    assembly = Assembly()
    opened = list(zip(placed, windows, strict=True))
    for found, holes in each(opened, between(tell, 0.7, 1.0), "walls"):
        surface = found.plan.build(holes)
        if not is_closed(surface.solid.faces):
            notes["roofs drawn level: their surface does not close"] += 1
            surface = ShellPlan([replace(body, roof=()) for body in found.plan.bodies]).build()
        part = _add(assembly, found, surface)
        colours += [(part, *row) for row in _colours_of(found)]
    notes["buildings"] = assembly.parts
    told = {k: n for k, n in sorted(notes.items()) if n or k == "buildings"}
    return Buildings(assembly.mesh(), told, PartColours.of_rows(colours))


def _with_usual_tags(
    buildings: Sequence[MappedBuilding],
    plans: Sequence[Geometry],
    country: str,
    notes: Counter[str],
) -> list[MappedBuilding]:
    """Return the buildings with drawn tags for properties that are not mapped."""
    neighbours = Neighbours(plans)
    found = []
    for number, building in enumerate(buildings):
        usual = usual_tags(building, country, number, neighbours)
        notes["roof shape drawn by country"] += "roof:shape" in usual
        found.append(replace(building, tags={**usual, **building.tags}))
    return found


def _colours_of(building: _Placed) -> list[tuple[int, bool, tuple[int, ...]]]:
    """Return colours of walls and roofs from the tags: material, whether it is a roof, sRGB."""
    rows: list[tuple[int, bool, tuple[int, ...]]] = []
    for volume, tags in zip(building.volumes, building.tags, strict=True):
        for material, key, up in zip(volume.materials, COLOURS, (False, True), strict=True):
            rgb = colour_of(tags.get(key[0], tags.get(key[1])))
            if rgb is not None:
                rows.append((material_id(material), up, rgb))
    return rows


def _promenades(features: Sequence[OsmFeature]) -> list[Geometry]:
    """Return pedestrian streets, where sensors may be placed as on carriageways."""
    return [
        feature.geometry.buffer(PROMENADE_M, cap_style="flat")
        for feature in features
        if feature.tags.get("highway") == "pedestrian" and "tunnel" not in feature.tags
    ]


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
    """Return the openings at the ground; ceilings in metres above the building's ground."""

    def ceiling(footprint: Geometry, clearance: float) -> float:
        inside = footprint.intersection(plan)
        height = ground_height(shapely.get_coordinates(shapely.segmentize(inside, 4.0)))
        height = height[np.isfinite(height)]
        return float(max(height.max() - datum, 0.0) if len(height) else 0.0) + clearance

    crossing = _crossing(passages, plan)
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


def _crossing(passages: Sequence[Passage], plan: Geometry) -> list[Passage]:
    """Return the passages that run through a building."""
    return [p for p in passages if p.line.intersection(plan).length > 0.5]


def _place(
    volumes: Sequence[Volume],
    outline: Mapping[str, str],
    openings: Sequence[Opening],
    carriageway: Geometry,
    datum: float,
) -> _Placed | None:
    """Cut the openings out of a building's bodies and place it on the ground.

    A roof on posts above a carriageway is raised as a whole.
    """
    bodies: list[Body] = []
    owners: list[Volume] = []
    posts: list[Solid] = []
    for volume in volumes:
        body = volume.body
        if volume.is_roof:
            body = _lifted(body, openings)
            posts += canopy_posts(body, carriageway, datum, FOUNDATION_M)
        opened = open_bodies([body], openings)
        bodies += [_founded(piece, datum) for piece in opened]
        owners += [volume] * len(opened)
    tags = [{**outline, **volume.tags} for volume in owners]
    return _Placed(ShellPlan(bodies), owners, tags, posts) if bodies else None


def _level(volume: Volume) -> Volume:
    return replace(volume, body=replace(volume.body, roof=()))


def _add(assembly: Assembly, building: _Placed, surface: Shell) -> int:
    """Add a building with its labels; return its part number."""
    part = assembly.new_part()
    walls = np.array([material_id(volume.materials[0]) for volume in building.volumes])
    roofs = np.array([material_id(volume.materials[1]) for volume in building.volumes])
    material = np.where(surface.kind == ROOF, roofs[surface.body], walls[surface.body])
    material = np.where(surface.kind == GLASS, material_id("glass"), material)
    material = np.where(surface.kind == DOOR, material_id("wood"), material)
    assembly.add(surface.solid, "building", material, part)
    for post in building.posts:
        assembly.add(post, "building", "metal-painted", part)
    return part


def _lifted(body: Body, openings: Sequence[Opening]) -> Body:
    """Lift a raised body above every ceiling under it."""
    under = [o.raised_ceiling for o in openings if o.footprint.intersects(body.footprint)]
    return body.lifted(max([0.0, *under, body.low]) - body.low)


def _founded(body: Body, datum: float) -> Body:
    """Place a body on its building's ground; walls from the ground get a foundation."""
    placed = body.lifted(datum)
    return placed if body.low > 0 else replace(placed, low=datum - FOUNDATION_M)
