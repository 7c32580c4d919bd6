"""Decks, ramps, railings and piers as triangles; roofs over covered ways."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray
from shapely import Geometry, LineString, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.barrier import fence
from urbantwin.scene.bridge.decks import Deck, Decks
from urbantwin.scene.bridge.profile import WIDTHS_M
from urbantwin.scene.placement import on_ground
from urbantwin.scene.slab import plain_polygons, plan_of, slab
from urbantwin.scene.solids import Assembly, GroundHeight, box
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["bridge_mesh"]

#: Railings (EN 1317-6, AASHTO: 1.0 to 1.2 m); none on decks lower than this above ground.
RAILING_M, LOWEST_FALL_M = 1.1, 0.6
#: Spacing and size of piers, minimum height of decks with piers, and clearance to roads and tracks.
PIER_STEP_M, PIER_M, LOWEST_PIER_M, CLEAR_M = 18.0, 0.8, 2.0, 0.8
BURIED_M = 0.4
#: Decks with less clearance below are cut away over carriageways, metres.
LOWEST_ROOM_M = 3.8
#: Roofs over covered ways: clear height, thickness, distance of posts, metres.
ROOF_M, ROOF_THICK_M, ROOF_POST_M = 2.7, 0.15, 4.0
ROOF_OFF_M = 0.5
FINE_M = 2.0


def bridge_mesh(
    features: Sequence[OsmFeature],
    decks: Decks,
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    without: Geometry | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build decks with railings on piers, ramps, and roofs over covered ways.

    Decks of ways within a ``man_made=bridge`` area fill that area.

    Args:
        features: the map's features, site frame.
        decks: result of ``bridge_decks``.
        region: the region.
        ground_height: heights of the ground.
        carriageway: area without piers.
        without: area in which imported geometry contains the bridges.

    Returns:
        The mesh, ``part`` 1, 2, ... per deck, and counts of objects built.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    place = region if without is None else region.difference(without)
    rails = [f.geometry for f in features if "railway" in f.tags and f.geometry.length > 0]
    blocked = shapely.union_all([carriageway.buffer(CLEAR_M), *shapely.buffer(rails, 2.0)])
    shapely.prepare(blocked)
    outlines = _outlines(features)
    done: Geometry = Polygon()
    order = sorted(decks.decks, key=lambda deck: deck.is_ramp)
    for deck in order:
        plan = deck.plan
        if not deck.is_ramp:
            half = 0.5 * deck.line.length
            holding = [o for o in outlines if o.intersection(deck.line).length > half]
            if holding:
                plan = shapely.union(plan, holding[0])
        low = plan if deck.is_ramp else _low_part(deck, ground_height)
        in_the_way = shapely.intersection(low, carriageway.buffer(0.1))
        plan = shapely.difference(plan, shapely.union(done, in_the_way))
        plan = shapely.intersection(plan, place)
        part = assembly.new_part()
        for shape in plain_polygons(plan.simplify(0.02), smallest_m2=0.3):
            _add_slab(assembly, deck, shape, ground_height, part)
        done = shapely.union_all([done, shapely.buffer(plan, 0.005)])
        clear = shapely.difference(place, in_the_way.buffer(0.1))
        _add_railings(assembly, deck, decks, clear, ground_height, part)
        if not deck.is_ramp:
            notes["piers"] += _add_piers(assembly, deck, place, blocked, ground_height, part)
        notes["ramps" if deck.is_ramp else "decks"] += 1
    open_air = shapely.difference(place, carriageway.buffer(ROOF_OFF_M))
    notes["covered ways"] = _add_roofs(assembly, features, open_air, blocked, ground_height)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _outlines(features: Sequence[OsmFeature]) -> list[Geometry]:
    """Return the outlines of bridges without road bridges, which are in the lane model."""
    roads = [
        f.geometry for f in features
        if f.tags.get("bridge", "no") != "no"
        and f.tags.get("highway", "footway") not in WIDTHS_M
        and f.geometry.geom_type == "LineString"
    ]  # fmt: skip
    areas = [
        f.geometry for f in features
        if f.tags.get("man_made") == "bridge" and f.geometry.geom_type.endswith("Polygon")
    ]  # fmt: skip
    return [
        area for area in areas
        if not any(area.intersection(road).length > 0.5 * road.length for road in roads)
    ]  # fmt: skip


def _low_part(deck: Deck, ground_height: GroundHeight) -> Geometry:
    """Return the part of a deck that is too low for traffic below it."""
    xy = shapely.get_coordinates(shapely.line_interpolate_point(deck.line, deck.stations))
    room = deck.heights - deck.thickness - on_ground(xy, ground_height(xy))[:, 2]
    low = np.flatnonzero(np.minimum(room[:-1], room[1:]) < LOWEST_ROOM_M)
    pieces = [
        shapely.ops.substring(deck.line, deck.stations[k], deck.stations[k + 1])
        for k in low.tolist()
    ]
    return shapely.union_all(pieces).buffer(deck.width / 2 + 0.05, cap_style="flat")


def _add_slab(
    assembly: Assembly, deck: Deck, shape: Polygon, ground_height: GroundHeight, part: int
) -> None:
    fine = shapely.segmentize(shape, FINE_M)
    xy, _, _ = plan_of(fine)
    top = deck.height(xy)
    if deck.is_ramp:
        ground = on_ground(xy, ground_height(xy))[:, 2]
        top = np.maximum(top, ground + 0.02)
        low = ground - BURIED_M
    else:
        low = top - deck.thickness
    material = {"rail": "gravel", "road": "asphalt"}.get(deck.kind, "paving")
    semantic = {"rail": "other-ground", "road": "road"}.get(deck.kind, "sidewalk")
    body = slab(fine, low, top)
    # The top is a footway; sides and underside are structure.
    upper = body.rises() > 0.5
    kinds = np.where(upper, semantic_id(semantic), semantic_id("other-structure"))
    matters = np.where(upper, material_id(material), material_id("concrete"))
    assembly.add(body, kinds, matters, part)


def _add_railings(
    assembly: Assembly,
    deck: Deck,
    decks: Decks,
    place: Geometry,
    ground_height: GroundHeight,
    part: int,
) -> None:
    """Add a railing to both sides, where there is a drop and no adjoining deck."""
    if deck.kind == "rail":
        return
    others = shapely.union_all([o.plan for o in decks.decks if o is not deck])
    for side in (1.0, -1.0):
        border = shapely.offset_curve(deck.line, side * (deck.width / 2 - 0.08), join_style="mitre")
        border = shapely.difference(shapely.intersection(border, place), others.buffer(-0.05))
        for piece in shapely.get_parts(border):
            if not isinstance(piece, LineString) or piece.length < 0.6:
                continue
            xy = shapely.get_coordinates(
                shapely.segmentize(shapely.remove_repeated_points(piece, 0.3), FINE_M)
            )
            top = deck.height(xy)
            fall = top - on_ground(xy, ground_height(xy))[:, 2]
            for run in np.split(
                np.arange(len(xy)), np.flatnonzero(np.diff(fall > LOWEST_FALL_M)) + 1
            ):
                if len(run) < 2 or fall[run[0]] <= LOWEST_FALL_M:
                    continue
                path = np.column_stack([xy[run], top[run]])
                for solid in (
                    fence.strip(path, 0.025, RAILING_M - 0.05, RAILING_M, closed=False),
                    fence.strip(path, 0.02, 0.1, 0.14, closed=False),
                    fence.bars(path, 0.12, RAILING_M - 0.03, closed=False),
                    fence.posts(path, RAILING_M),
                ):
                    assembly.add(solid, "fence", "metal-painted", part)


def _add_piers(
    assembly: Assembly,
    deck: Deck,
    place: Geometry,
    blocked: Geometry,
    ground_height: GroundHeight,
    part: int,
) -> int:
    """Add abutments at the ends and piers between them, outside carriageways and tracks."""
    length = deck.line.length
    if length < 1.0:
        return 0
    stations = np.concatenate([[0.4], np.arange(2.0, length - 1.5), [length - 0.4]])
    xy = shapely.get_coordinates(shapely.line_interpolate_point(deck.line, stations))
    ahead = shapely.get_coordinates(shapely.line_interpolate_point(deck.line, stations + 0.3))
    behind = shapely.get_coordinates(shapely.line_interpolate_point(deck.line, stations - 0.3))
    way = ahead - behind
    under = deck.height(xy) - deck.thickness
    ground = on_ground(xy, ground_height(xy))[:, 2]
    free = ~shapely.contains_xy(blocked, xy[:, 0], xy[:, 1])
    free &= shapely.intersects_xy(place, xy[:, 0], xy[:, 1])
    at_end = np.zeros(len(xy), bool)
    at_end[[0, -1]] = True
    keep = free & (under - ground > np.where(at_end, 0.3, LOWEST_PIER_M))
    keep[1:-1] = _chosen(stations[1:-1], keep[1:-1], length)
    if not keep.any():
        return 0
    tall = (under - ground)[keep] + BURIED_M + 0.02
    centre = np.column_stack([xy[keep], ground[keep] - BURIED_M + tall / 2])
    wide = np.full(len(tall), 0.7 * deck.width)
    size = np.column_stack([np.full(len(tall), PIER_M), wide, tall])
    piers = box(centre, size, np.arctan2(way[keep, 1], way[keep, 0]))
    assembly.add(piers, "other-structure", "concrete", part)
    return int(keep.sum())


def _chosen(
    stations: NDArray[np.float64], possible: NDArray[np.bool_], length: float
) -> NDArray[np.bool_]:
    """Return the possible stations nearest to those of evenly spaced piers."""
    chosen = np.zeros(len(stations), bool)
    places = np.flatnonzero(possible)
    count = max(round(length / PIER_STEP_M), 1)
    for wanted in np.arange(1, count) / count * length:
        if len(places):
            nearest = places[np.abs(stations[places] - wanted).argmin()]
            chosen[nearest] |= bool(abs(stations[nearest] - wanted) < PIER_STEP_M / 2)
    return chosen


def _add_roofs(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    place: Geometry,
    blocked: Geometry,
    ground_height: GroundHeight,
) -> int:
    """Add roofs on posts over ways with ``covered=yes``, outside of buildings."""
    houses = shapely.union_all(
        [f.geometry for f in features
         if "building" in f.tags and f.geometry.geom_type.endswith("Polygon")]
    )  # fmt: skip
    count = 0
    for feature in features:
        tags, line = feature.tags, feature.geometry
        if tags.get("covered") != "yes" or tags.get("highway") not in (
            "footway", "path", "pedestrian", "cycleway",
        ):  # fmt: skip
            continue
        if tags.get("tunnel", "no") != "no" or tags.get("indoor", "no") != "no":
            continue
        if tags.get("layer", "0") != "0" or not isinstance(line, LineString):
            continue
        open_air = shapely.difference(shapely.intersection(line, place), houses.buffer(0.3))
        for piece in shapely.get_parts(open_air):
            if isinstance(piece, LineString) and piece.length > 2.0:
                _add_roof(assembly, piece, place, blocked, ground_height)
                count += 1
    return count


def _add_roof(
    assembly: Assembly,
    line: LineString,
    place: Geometry,
    blocked: Geometry,
    ground_height: GroundHeight,
) -> None:
    part = assembly.new_part()
    cover = line.buffer(1.5, cap_style="flat", join_style="mitre").intersection(place)
    for shape in plain_polygons(cover):
        fine = shapely.segmentize(shape, FINE_M)
        xy, _, _ = plan_of(fine)
        under = on_ground(xy, ground_height(xy))[:, 2] + ROOF_M
        roof = slab(fine, under, under + ROOF_THICK_M)
        assembly.add(roof, "other-structure", "metal-painted", part)
    for side in (1.3, -1.3):
        for border in shapely.get_parts(shapely.offset_curve(line, side)):
            if border.length < 1.0:
                continue
            spots = shapely.get_coordinates(shapely.segmentize(border, ROOF_POST_M))
            spots = spots[~shapely.contains_xy(blocked, spots[:, 0], spots[:, 1])]
            if len(spots):
                feet = on_ground(spots, ground_height(spots))
                posts = fence.posts(feet, ROOF_M + 0.05, 0.12)
                assembly.add(posts, "other-structure", "metal-painted", part)
