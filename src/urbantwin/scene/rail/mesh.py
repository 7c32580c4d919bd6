"""Rails, ballast and sleepers, and the platforms of stations and stops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.number_text import whole_number
from urbantwin.roads.building_ground import building_ground
from urbantwin.scene.placement import not_imported, on_ground
from urbantwin.scene.slab import plain_polygons, plan_of, slab
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, box, sweep
from urbantwin.scene.tag_values import length_m_of
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["rail_mesh"]

#: Heights above the rails' ground: trains 0.55 m (TSI PRM: 0.55 or 0.76), trams 0.25 m.
TRAIN_M, TRAM_M = 0.55, 0.25
#: Width of platforms mapped as a line; and clearances beside a track and a kerb, metres.
WIDTH_M, TRACK_M, KERB_M = 3.0, 1.35, 0.05
PLATFORM_BURIED_M, FINE_M = 0.3, 4.0
NEAR_TRACK_M = 8.0


def add_platforms(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    buildings: Sequence[Polygon] = (),
) -> int:
    """Add the raised platforms of trains and trams; return their number.

    Bus stops without a mapped height are part of the sidewalk and are not drawn; nor are platforms
    inside a building.
    """
    tracks: dict[str, list[Geometry]] = {"tram": [], "train": []}
    for feature in features:
        if isinstance(feature.geometry, LineString) and _is_open(feature.tags):
            railway = feature.tags.get("railway", "")
            if railway in ("tram", "light_rail", "rail", "narrow_gauge", "subway"):
                tracks["tram" if railway == "tram" else "train"].append(feature.geometry)
    lines = {kind: shapely.union_all(found) for kind, found in tracks.items()}
    clear = shapely.union_all([
        carriageway.buffer(KERB_M),
        *(line.buffer(TRACK_M) for line in lines.values()),
        *buildings,
    ])  # fmt: skip
    count = 0
    for feature in features:
        if not _is_platform(feature.tags):
            continue
        height = _height(feature, lines)
        if height is None:
            continue
        area = feature.geometry
        if isinstance(area, LineString):
            width = min(max(length_m_of(feature.tags.get("width")) or WIDTH_M, 1.0), 12.0)
            area = area.buffer(width / 2, cap_style="flat", join_style="mitre")
        if not area.geom_type.endswith("Polygon"):
            continue
        area = shapely.intersection(shapely.difference(area, clear), region)
        part = assembly.new_part()
        shapes = plain_polygons(area.simplify(0.05), smallest_m2=1.0)
        for shape in shapes:
            fine = shapely.segmentize(shape, FINE_M)
            xy, _, _ = plan_of(fine)
            ground = on_ground(xy, ground_height(xy))[:, 2]
            body = slab(fine, ground - PLATFORM_BURIED_M, ground + height)
            top = body.rises() > 0.5
            kinds = np.where(top, semantic_id("sidewalk"), semantic_id("other-structure"))
            matter = np.where(top, material_id("paving"), material_id("concrete"))
            assembly.add(body, kinds, matter, part)
        count += bool(shapes)
    return count


def _is_open(tags: Mapping[str, str]) -> bool:
    return (
        tags.get("tunnel", "no") == "no"
        and tags.get("location") not in ("underground", "indoor")
        and tags.get("indoor", "no") == "no"
        and not tags.get("layer", "0").startswith("-")
        and not tags.get("level", "0").startswith("-")
        and tags.get("subway") != "yes"
    )


def _is_platform(tags: Mapping[str, str]) -> bool:
    named = "platform" in (tags.get("railway"), tags.get("public_transport"), tags.get("highway"))
    return named and _is_open(tags) and "building" not in tags


def _height(feature: OsmFeature, lines: Mapping[str, Geometry]) -> float | None:
    """Return a platform's height; ``None`` if it is not raised."""
    tags = feature.tags
    said = length_m_of(tags.get("height") or tags.get("platform:height"))
    if said is not None:
        return min(max(said, 0.05), 1.4)
    if tags.get("bus") == "yes" and tags.get("tram") != "yes" and tags.get("train") != "yes":
        return None
    near = {
        kind: line.distance(feature.geometry) if not line.is_empty else np.inf
        for kind, line in lines.items()
    }
    if tags.get("train") == "yes" or near["train"] < min(near["tram"], NEAR_TRACK_M):
        return TRAIN_M
    if tags.get("tram") == "yes" or near["tram"] < NEAR_TRACK_M:
        return TRAM_M
    return TRAIN_M if tags.get("railway") == "platform" else None


#: Standard gauge, and the width of a rail's head (EN 13674: 49E1 67 mm, 60E1 72 mm), metres.
GAUGE_M, HEAD_M = 1.435, 0.07
#: Height of rails above the pavement, so that beams hit them, metres.
PROUD_M = 0.004
#: Height of rails on ballast above the ground, and distance from a road to reach it, metres.
BALLASTED_M, RISE_M = 0.55, 12.0
RAILWAYS = ("tram", "light_rail", "rail", "narrow_gauge", "subway", "preserved", "funicular")
STEP_M = 2.5


@dataclass(frozen=True, eq=False)
class Track:
    """A piece of track.

    Attributes:
        path: (N, 3) its centre line, at the height of the rails' upper edges, site frame.
        gauge: distance between the inner edges of the rail heads, metres.
        lift: (N,) height of the path above the ground.
    """

    path: NDArray[np.float64]
    gauge: float
    lift: NDArray[np.float64]


def tracks_of(
    features: Sequence[OsmFeature],
    region: Polygon,
    ride_height: GroundHeight,
    carriageway: Geometry,
    paved: Geometry,
) -> list[Track]:
    """Return the tracks inside a region.

    Tram tracks are embedded in the pavement unless mapped otherwise; other tracks are on ballast,
    and descend to the pavement where they cross a road.

    Args:
        features: the map's features.
        region: the region.
        ride_height: heights of the ground and of decks that carry rails.
        carriageway: area in which tracks are embedded in the pavement.
        paved: other paved areas, such as squares, in which tracks are embedded.
    """
    street = shapely.union(carriageway, paved)
    shapely.prepare(street)
    found = []
    for feature in features:
        tags, line = feature.tags, feature.geometry
        if not _is_track(tags) or not isinstance(line, LineString):
            continue
        for piece in shapely.get_parts(shapely.intersection(line, region)):
            clean = shapely.remove_repeated_points(piece, 0.2)
            if not isinstance(clean, LineString) or clean.length < 0.5:
                continue
            xy = shapely.get_coordinates(shapely.segmentize(clean, STEP_M))
            away = shapely.distance(street, shapely.points(xy))
            if street.is_empty:
                away = np.full(len(xy), np.inf)
            lift = np.full(len(xy), PROUD_M)
            # Tracks on bridges are fixed to the deck.
            if not _is_embedded(tags) and tags.get("bridge", "no") == "no":
                lift = PROUD_M + BALLASTED_M * np.clip((away - 1.0) / RISE_M, 0, 1)
            path = on_ground(xy, ride_height(xy)) + np.column_stack([np.zeros((len(xy), 2)), lift])
            found += [Track(path, gauge, lift) for gauge in _gauges(tags)]
    return found


def _is_track(tags: Mapping[str, str]) -> bool:
    return (
        tags.get("railway") in RAILWAYS
        and tags.get("tunnel", "no") == "no"
        and tags.get("covered", "no") == "no"
        and tags.get("location") != "underground"
        and not tags.get("layer", "0").startswith("-")
        and not (tags.get("railway") == "subway" and "bridge" not in tags and "layer" not in tags)
    )


def _is_embedded(tags: Mapping[str, str]) -> bool:
    if (
        tags.get("embedded")
        or tags.get("railway:embedded")
        or tags.get("tram:segregation:physical")
    ):
        said = tags.get("embedded") or tags.get("railway:embedded")
        if said in ("no", "yes"):
            return said == "yes"
    if tags.get("surface") in ("ballast", "gravel", "sleepers") or tags.get("ballastless") == "no":
        return False
    return tags["railway"] == "tram" or "surface" in tags


def _gauges(tags: Mapping[str, str]) -> list[float]:
    """Return the gauges in metres; dual-gauge tracks have two."""
    said = map(whole_number, tags.get("gauge", "").split(";"))
    found = [g / 1000 for g in said if g is not None and 300 <= g <= 3000]
    return found[:2] or [GAUGE_M]


#: Depth of drawn rails; on ballast they are 0.17 m high on sleepers (EN 13674), metres.
DEPTH_M, RAIL_M = 0.2, 0.17
#: Concrete sleepers: 0.6 m apart, 2.6 m long on standard gauge, metres.
SLEEPER_STEP_M, SLEEPER_M = 0.6, (0.26, 0.21)
#: The bed is wider than sleepers by this to both sides, its slopes 1 in 1.5.
SHOULDER_M, SLOPE = 0.4, 1.5
MOST_SLEEPERS = 4000
BURIED_M = 0.3
#: Track with its rails lower than this above the ground is embedded in the pavement, metres.
EMBEDDED_M = 0.25


def rail_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    ride_height: GroundHeight | None = None,
    without: Geometry | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build tracks and platforms.

    Rails and ballast have the class ``other-ground``, as in SemanticKITTI.

    Args:
        features: the map's features, site frame.
        region: tracks end at its border.
        ground_height: heights of the ground.
        carriageway: area with embedded tracks and without platforms.
        ride_height: heights of the ground and of decks that carry rails.
        without: area in which imported geometry contains the tracks and platforms.

    Returns:
        The mesh, ``part`` 1, 2, ... per track or platform, and counts of objects built.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    paved = shapely.union_all(
        [f.geometry for f in features
         if f.tags.get("highway") == "pedestrian" and f.geometry.geom_type.endswith("Polygon")]
    )  # fmt: skip
    mine = [f for f in features if "railway" in f.tags or "public_transport" in f.tags
            or f.tags.get("highway") == "platform"]  # fmt: skip
    mine = not_imported(mine, without)
    tracks = tracks_of(mine, region, ride_height or ground_height, carriageway, paved)
    sleepers = 0
    for track in tracks:
        part = assembly.new_part()
        for side in (1.0, -1.0):
            assembly.add(_rail(track, side), "other-ground", "metal-bare", part)
        for run in _ballasted(track):
            sleepers += _add_bed(assembly, track, run, part, sleepers < MOST_SLEEPERS)
        notes["tracks, m"] += round(
            float(np.linalg.norm(np.diff(track.path, axis=0), axis=1).sum())
        )
    notes["sleepers"] = sleepers
    notes["platforms"] = add_platforms(
        assembly, mine, region, ground_height, carriageway, building_ground(features)
    )
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _rail(track: Track, side: float) -> Solid:
    """Return one rail: its inner edge is half the gauge from the centre line."""
    inner, outer = side * track.gauge / 2, side * (track.gauge / 2 + HEAD_M)
    left, right = max(inner, outer), min(inner, outer)
    profile = np.array([(left, -DEPTH_M), (right, -DEPTH_M), (right, 0.0), (left, 0.0)])
    return sweep(track.path, profile)


def _ballasted(track: Track) -> list[NDArray[np.int64]]:
    """Return the runs of points of a track on ballast."""
    high = track.lift > EMBEDDED_M
    runs = np.split(np.arange(len(high)), np.flatnonzero(np.diff(high)) + 1)
    return [run for run in runs if len(run) > 1 and high[run[0]]]


def _add_bed(
    assembly: Assembly, track: Track, run: NDArray[np.int64], part: int, with_sleepers: bool
) -> int:
    """Add the ballast under a run of a track and its sleepers; return the number of sleepers."""
    path, lift = track.path[run], track.lift[run]
    long = track.gauge + 1.165
    half = long / 2 + SHOULDER_M
    crest = -RAIL_M - 0.05
    low = -lift - BURIED_M
    foot = half + SLOPE * (crest - low)
    count = len(run)
    profile = np.empty((count, 4, 2))
    profile[:, 0] = np.column_stack([foot, low])
    profile[:, 1] = np.column_stack([-foot, low])
    profile[:, 2] = [-half, crest]
    profile[:, 3] = [half, crest]
    assembly.add(sweep(path, profile), "other-ground", "gravel", part)
    if not with_sleepers:
        return 0
    step = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    at = np.arange(SLEEPER_STEP_M / 2, along[-1], SLEEPER_STEP_M)
    if not len(at):
        return 0
    piece = np.clip(np.searchsorted(along, at, side="right") - 1, 0, count - 2)
    way = np.diff(path, axis=0)[piece]
    centre = np.column_stack([np.interp(at, along, path[:, k]) for k in range(3)])
    centre[:, 2] -= RAIL_M + SLEEPER_M[1] / 2
    size = np.full((len(at), 3), [SLEEPER_M[0], long, SLEEPER_M[1]])
    ties = box(centre, size, np.arctan2(way[:, 1], way[:, 0]))
    assembly.add(ties, "other-ground", "concrete", part)
    return len(at)
