"""The mesh of all mapped street furniture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Point, Polygon, affinity

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.catalogue import Catalogue, StreetObject, street_objects
from urbantwin.scene.furniture.gantry import add_gantries
from urbantwin.scene.furniture.shelter import HOUSED, SHELTER_M, cycle_stands, oriented, shelter
from urbantwin.scene.furniture.steps import add_steps, is_flight
from urbantwin.scene.piece import Piece, add_pieces, moved
from urbantwin.scene.placement import (
    along_nearest,
    beside_carriageway,
    not_imported,
    on_ground,
    toward_carriageway,
)
from urbantwin.scene.slab import plain_polygons, slab
from urbantwin.scene.solids import Assembly, GroundHeight
from urbantwin.scene.tag_values import yaw_of_direction
from urbantwin.site.extract import OsmFeature

__all__ = ["furniture_mesh"]

#: Sizes of basins of fountains that are mapped as areas, metres.
RIM_M, RIM_HIGH_M, WATER_BELOW_M, BURIED_M = 0.3, 0.45, 0.12, 0.3


def monument_kind(tags: Mapping[str, str]) -> str | None:
    """Return which street object a monument is; ``None`` if its shape is unknown.

    Plaques, paintings and stumbling stones are flat and not drawn.
    """
    said = tags.get("artwork_type") or tags.get("memorial") or tags.get("memorial:type", "")
    said = said.split(";")[0]
    if tags.get("historic") not in ("memorial", "monument", "wayside_cross", "boundary_stone") and (
        tags.get("tourism") != "artwork"
    ):
        return None
    known = {
        "statue": "statue", "bust": "bust", "sculpture": "sculpture", "installation": "sculpture",
        "architecture": "sculpture", "obelisk": "pillar", "column": "pillar", "stele": "stone",
        "stone": "stone", "cross": "pillar", "war_memorial": "stone", "vehicle": "sculpture",
        "totem_pole": "pillar", "fountain": "fountain",
    }  # fmt: skip
    if said in known:
        return known[said]
    if tags.get("historic") == "monument":
        return "statue"
    if tags.get("historic") == "wayside_cross":
        return "pillar"
    return "stone" if tags.get("historic") == "boundary_stone" else None


def add_basin(assembly: Assembly, area: Polygon, ground_height: GroundHeight) -> bool:
    """Add the basin of a fountain that is mapped as an area; return whether one was added.

    The rim is 0.3 m thick, with the water 0.12 m below its top.
    """
    outer = plain_polygons(area.simplify(0.05), smallest_m2=0.5)
    if not outer:
        return False
    ground = ground_height(shapely.get_coordinates(outer))
    ground = ground[np.isfinite(ground)]
    level = float(ground.max()) if len(ground) else 0.0
    low = (float(ground.min()) if len(ground) else 0.0) - BURIED_M
    part = assembly.new_part()
    for shape in outer:
        pools = plain_polygons(shape.buffer(-RIM_M, join_style="mitre"), smallest_m2=0.2)
        rims = plain_polygons(shapely.difference(shape, shapely.union_all(pools)))
        for rim in rims:
            solid = slab(rim, low, level + RIM_HIGH_M)
            assembly.add(solid, "other-structure", "stone", part)
        for pool in pools:
            sheet = slab(pool, low, level + RIM_HIGH_M - WATER_BELOW_M)
            assembly.add(sheet, "other-ground", "water", part)
    return True


#: Minimum distance of furniture from carriageways, and maximum shift of a mapped piece, metres.
KERB_M, FARTHEST_M = 0.3, 3.0
#: Position of bus shelters relative to the mapped pole, behind and beside it, metres.
BEHIND_STOP_M = (-1.3, 2.6, 0.0)
#: Pieces closer than this to a carriageway face it; those closer to a way face the way, metres.
ROAD_M, WAY_M = 12.0, 8.0
#: A kiosk closer than this to a building is a shop in it.
KIOSK_FREE_M = 1.0
INDOORS = ("indoor", "room")
#: Objects mapped without a shape.
SHAPELESS = "memorials and artworks of unknown shape, not drawn"


@dataclass(frozen=True)
class _Object:
    name: str
    x: float
    y: float
    yaw: float
    pieces: list[Piece]
    direction: str | None
    fixed: bool = False  # made for its place: neither moved aside nor turned round


def furniture_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    without: Geometry | None = None,
    objects: Catalogue | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build street furniture other than poles and barriers.

    Args:
        features: the map's features, site frame.
        region: objects outside it are left out.
        ground_height: heights of the ground.
        carriageway: area without furniture; pieces face it unless mapped otherwise.
        without: area in which imported geometry contains the furniture.
        objects: street objects; those of the package if not given.

    Returns:
        The mesh, ``part`` 1, 2, ... per object, and counts of objects built or left out.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    ways = [f.geometry for f in features if "highway" in f.tags and region.intersects(f.geometry)]
    known = objects or street_objects()
    mine = not_imported([f for f in features if _is_furniture(f.tags, known)], without)
    taken = [carriageway, *(f.geometry for f in features if "building" in f.tags)]
    standing = []
    for feature in mine:
        shape = feature.geometry
        if not region.covers(_middle(shape)) or _is_within_house(feature, taken[1:]):
            continue
        if feature.tags.get("amenity") == "fountain" and isinstance(shape, Polygon):
            notes["fountains"] += add_basin(assembly, shape, ground_height)
            continue
        found = _object(feature, taken, known)
        if found is None:
            kind = monument_kind(feature.tags)
            notes[SHAPELESS] += kind is None and feature.tags.get("historic") == "memorial"
        elif found.pieces:
            standing.append(found)
    _place(assembly, standing, ways, carriageway, ground_height, notes)
    gantries = not_imported([f for f in features if f.tags.get("man_made") == "gantry"], without)
    add_gantries(
        assembly,
        gantries,
        ways,
        region=region,
        ground_height=ground_height,
        carriageway=carriageway,
        notes=notes,
    )
    flights = not_imported([f for f in features if is_flight(f.tags)], without)
    add_steps(
        assembly,
        flights,
        region=region,
        ground_height=ground_height,
        carriageway=carriageway,
        notes=notes,
    )
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _middle(shape: Geometry) -> Point:
    return shape if isinstance(shape, Point) else shape.representative_point()


def _is_furniture(tags: dict[str, str], known: Catalogue) -> bool:
    if any(tags.get(key, "no") != "no" for key in INDOORS) or tags.get("location") in (
        "indoor", "underground", "roof", "rooftop",
    ):  # fmt: skip
        return False
    if "building" in tags or tags.get("layer", "0").startswith("-"):
        return False
    if _shelter_kind(tags) or "historic" in tags or tags.get("tourism") == "artwork":
        return True
    return known.of(tags, "furniture") is not None


def _is_within_house(feature: OsmFeature, houses: Sequence[Geometry]) -> bool:
    """Return whether a kiosk is a shop of a house, and no hut in the street."""
    if feature.tags.get("shop") != "kiosk":
        return False
    return any(house.dwithin(feature.geometry, KIOSK_FREE_M) for house in houses)


def _shelter_kind(tags: dict[str, str]) -> str | None:
    """Return the kind of a feature that is built from its area, or ``None``."""
    if tags.get("amenity") in ("shelter", "bicycle_parking"):
        return tags["amenity"]
    if tags.get("highway") == "bus_stop" and tags.get("shelter") == "yes":
        return "bus_stop"
    return None


def _named(tags: dict[str, str], known: Catalogue) -> StreetObject | None:
    """Return the street object that a feature is."""
    found = known.of(tags, "furniture")
    kind = monument_kind(tags) if found is None else None
    if kind == "fountain":
        return known.of({**tags, "amenity": "fountain"}, "furniture")
    return known[kind] if kind else found


def _object(feature: OsmFeature, taken: Sequence[Geometry], known: Catalogue) -> _Object | None:
    """Return the object of a feature in its own frame; ``None`` if it has no shape.

    Args:
        feature: the feature.
        taken: carriageways and buildings; cycle stands are not placed in them.
        known: street objects.
    """
    tags, shape = feature.tags, feature.geometry
    fixed = False
    spot, deep, long, yaw = _middle(shape), None, None, np.nan
    x, y = spot.x, spot.y
    if isinstance(shape, Polygon):
        (x, y), yaw, deep, long = oriented(shape)
    elif isinstance(shape, LineString):
        middle = shape.interpolate(0.5, normalized=True)
        ends = shapely.get_coordinates(shape)[[0, -1]]
        x, y, long = middle.x, middle.y, shape.length
        yaw = float(np.arctan2(*(ends[1] - ends[0])[::-1]) + np.pi / 2)
    kind = _shelter_kind(tags)
    if kind in ("shelter", "bus_stop"):
        # The shelter of a stop is behind it, away from the road.
        pieces = shelter(tags, deep or SHELTER_M[0], long or SHELTER_M[1])
        if kind == "bus_stop":
            pieces = [moved(piece, BEHIND_STOP_M) for piece in pieces]
        name = "shelters"
    elif kind == "bicycle_parking":
        free = None
        if isinstance(shape, Polygon) and tags.get("bicycle_parking") not in HOUSED:
            beside = shapely.union_all([one.intersection(shape.buffer(1.0)) for one in taken])
            free = affinity.translate(shape.difference(beside.buffer(KERB_M)), -x, -y)
            free = affinity.rotate(free, -yaw, (0, 0), use_radians=True)
        pieces, fixed = cycle_stands(tags, deep, long, free), free is not None
        name = "cycle parking"
    else:
        found = _named(tags, known)
        if found is None:
            return None
        pieces, name = found.pieces(tags), found.counted
    if isinstance(shape, Point):
        yaw = np.nan
    return _Object(name, float(x), float(y), yaw, pieces, tags.get("direction"), fixed)


def _place(
    assembly: Assembly,
    objects: Sequence[_Object],
    ways: Sequence[Geometry],
    carriageway: Geometry,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    """Place objects on the ground, off carriageways, and set their headings."""
    if not objects:
        return
    mapped = np.array([[o.x, o.y] for o in objects])
    spots = np.array([_clear(o) for o in objects])
    xy = _aside(mapped, spots, carriageway)
    fixed = [o.fixed for o in objects]
    xy[fixed] = mapped[fixed]
    keep = np.isfinite(xy[:, 0])
    notes["pieces on carriageways, left out"] += int((~keep).sum())
    xy = xy[keep]
    standing = [o for o, kept in zip(objects, keep, strict=True) if kept]
    if not standing:
        return
    feet = on_ground(xy, ground_height(xy))
    road = toward_carriageway(xy, carriageway, farthest_m=ROAD_M)
    way = toward_carriageway(xy, shapely.union_all(list(ways)), farthest_m=WAY_M)
    along = along_nearest(xy, ways, farthest_m=WAY_M)
    usual = np.where(np.isfinite(road), road, np.where(np.isfinite(way), way, along + np.pi / 2))
    for found, foot, turn in zip(standing, feet, np.nan_to_num(usual).tolist(), strict=True):
        yaw = found.yaw if found.fixed else yaw_of_direction(found.direction)
        if yaw is None:
            # Areas keep their own axis, in the direction closer to the road.
            flip = np.cos(found.yaw - turn) < 0 if np.isfinite(found.yaw) else False
            yaw = found.yaw + np.pi * flip if np.isfinite(found.yaw) else turn
        add_pieces(assembly, found.pieces, foot, float(yaw))
        notes[found.name] += 1


def _clear(found: _Object) -> float:
    """Return the maximum distance of an object's parts from its middle, metres."""
    return max(
        float(np.abs(piece.solid.vertices[:, :2]).max(initial=0.0)) for piece in found.pieces
    )


def _aside(
    mapped: NDArray[np.float64], reach: NDArray[np.float64], carriageway: Geometry
) -> NDArray[np.float64]:
    """Move objects off carriageways, each by its own size."""
    placed = np.full(mapped.shape, np.nan)
    steps = np.clip(np.ceil(reach / 0.5) * 0.5, 0.5, 3.0)
    for step in np.unique(steps):
        own = steps == step
        placed[own] = beside_carriageway(
            mapped[own],
            carriageway,
            margin_m=KERB_M + float(step) / 2,
            farthest_m=FARTHEST_M + step,
        )
    return placed
