"""Overhead contact lines of trams, trains and trolleybuses, with their supports."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Point, Polygon

from urbantwin.scene.placement import on_ground
from urbantwin.scene.solids import Assembly, GroundHeight, columns, rods
from urbantwin.scene.wire.catenary import catenaries, wire_solid
from urbantwin.site.extract import OsmFeature

__all__ = ["CONTACT_M", "add_contact_lines"]

#: Height of contact wires above the rails (EN 50119: nominally 5.0 to 5.75 m), and of the span
#: wires across the street, metres.
CONTACT_M, SPAN_M = 5.5, 6.6
#: Distance between supports of the wire: streets, railways, metres.
STREET_STEP_M, RAILWAY_STEP_M = 28.0, 55.0
#: Height of a railway's messenger wire at its supports above the rails, and its sag, metres.
MESSENGER_M, MESSENGER_SAG_M = 6.8, 0.9
MAST_M, BURIED_M = 7.4, 0.3
#: Range of the distance of a mast or wall from the track, metres.
NEAREST_M, FARTHEST_M = {"tram": 1.9, "rail": 2.6, "trolley": 1.9}, 15.0
#: A mapped mast within this distance is used instead of an assumed one, metres.
MAPPED_M = 9.0
#: Minimum distance of an assumed span to another; spans are shared by adjacent tracks, metres.
SHARED_M = 14.0


@dataclass
class _Works:
    """Possible supports of wires, and the stations with a support."""

    region: Polygon
    blocked: Geometry
    walls: shapely.STRtree
    ground: GroundHeight
    masts: NDArray[np.float64]
    spans: list[Point]


def add_contact_lines(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    region: Polygon,
    ride_height: GroundHeight,
    carriageway: Geometry,
    notes: Counter[str],
) -> None:
    """Add contact wires and their supports: mapped masts, otherwise assumed spans between poles.

    Args:
        assembly: assembly to extend.
        features: the map's features, site frame.
        region: the region.
        ride_height: height of the rails or the road at (N, 2) points: ground and decks.
        carriageway: area without masts.
        notes: counter of objects built.
    """
    tracks = {kind: _lines(features, kind) for kind in ("tram", "rail", "trolley")}
    everything = [line for lines in tracks.values() for line in lines]
    if not everything:
        return
    rails = shapely.union_all([f.geometry for f in features if _is_track(f)])
    blocked = shapely.union_all(
        [carriageway.buffer(0.45), rails.buffer(1.8), *[line.buffer(1.5) for line in everything]]
    )
    shapely.prepare(blocked)
    shapely.prepare(region)
    houses = [
        f.geometry for f in features
        if "building" in f.tags and f.geometry.geom_type.endswith("Polygon")
    ]  # fmt: skip
    masts = [
        (f.geometry.x, f.geometry.y) for f in features
        if isinstance(f.geometry, Point) and _is_mast(f.tags)
    ]  # fmt: skip
    works = _Works(
        region, blocked, shapely.STRtree(houses), ride_height,
        np.array(masts, np.float64).reshape(-1, 2), [],
    )  # fmt: skip
    for kind, lines in tracks.items():
        joined = shapely.line_merge(shapely.union_all(lines)) if lines else None
        inside = shapely.intersection(joined, region) if joined is not None else None
        for line in shapely.get_parts(inside) if inside is not None else []:
            if isinstance(line, LineString) and line.length > 1.0:
                _add_line(assembly, line, kind, works, notes)


def _is_track(feature: OsmFeature) -> bool:
    tags = feature.tags
    return (
        tags.get("railway") in ("tram", "light_rail", "rail", "narrow_gauge", "subway")
        and isinstance(feature.geometry, LineString)
        and tags.get("tunnel", "no") == "no"
        and not tags.get("layer", "0").startswith("-")
    )


def _lines(features: Sequence[OsmFeature], kind: str) -> list[LineString]:
    found = []
    for feature in features:
        tags = feature.tags
        if kind == "trolley":
            wired = (
                tags.get("trolley_wire", "no") not in ("no",)
                and "highway" in tags
                and isinstance(feature.geometry, LineString)
            )
        else:
            street = tags.get("railway") in ("tram", "light_rail")
            wired = _is_track(feature) and street == (kind == "tram")
            power = tags.get(
                "electrified", "contact_line" if tags.get("railway") == "tram" else "no"
            )
            wired = wired and power in ("contact_line", "yes", "contact_line;rail")
        if wired:
            found.append(feature.geometry)
    return found


def _is_mast(tags: dict[str, str]) -> bool:
    return tags.get("power") == "catenary_mast" or tags.get("railway") == "catenary_mast"


def _add_line(
    assembly: Assembly, line: LineString, kind: str, works: _Works, notes: Counter[str]
) -> None:
    part = assembly.new_part()
    gap = 0.3 if kind == "trolley" else 0.0
    fine = shapely.segmentize(line, 5.0)
    for side in {gap, -gap}:
        path = fine if side == 0 else shapely.offset_curve(fine, side)
        for piece in shapely.get_parts(path):
            xy = shapely.get_coordinates(shapely.remove_repeated_points(piece, 0.05))
            if len(xy) < 2:
                continue
            points = on_ground(xy, works.ground(xy)) + [0, 0, CONTACT_M]
            assembly.add(wire_solid(points[None]), "other-object", "metal-bare", part)
    notes["contact wires, m"] += round(line.length)
    step = RAILWAY_STEP_M if kind == "rail" else STREET_STEP_M
    count = max(round(line.length / step), 1)
    stations = (np.arange(count) + 0.5) / count * line.length
    mapped = _held_by_masts(assembly, line, works, part, notes)
    held = list(mapped)
    for station in stations.tolist():
        at = line.interpolate(station)
        if mapped and min(abs(station - h) for h in mapped) < 1.2 * step:
            continue
        if any(at.distance(other) < SHARED_M for other in works.spans):
            continue
        if _add_span(assembly, line, station, kind, works, part, notes):
            works.spans.append(at)
            held.append(station)
    if kind == "rail":
        _add_messenger(assembly, line, sorted(held), works, part)


def _held_by_masts(
    assembly: Assembly, line: LineString, works: _Works, part: int, notes: Counter[str]
) -> list[float]:
    """Add a bracket from every mapped mast beside a line; return the stations."""
    if not len(works.masts):
        return []
    spots = shapely.points(works.masts)
    near = np.flatnonzero(shapely.distance(spots, line) < MAPPED_M)
    stations = []
    for k in near.tolist():
        station = float(line.project(spots[k]))
        foot = on_ground(works.masts[[k]], works.ground(works.masts[[k]]))[0]
        _add_bracket(assembly, foot, line.interpolate(station), works, part)
        notes["brackets at mapped masts"] += 1
        stations.append(station)
    return stations


def _add_bracket(
    assembly: Assembly, foot: NDArray[np.float64], at: Point, works: _Works, part: int
) -> None:
    xy = np.array([[at.x, at.y]])
    wire = on_ground(xy, works.ground(xy))[0] + [0, 0, CONTACT_M]
    high = np.array([foot[0], foot[1], max(foot[2], wire[2] - CONTACT_M) + SPAN_M + 0.3])
    tip = wire + [0, 0, 0.5]
    bars = rods([high, high - [0, 0, 1.0], tip], [tip, tip, wire], 0.03, 0.03, 4)
    assembly.add(bars, "pole", "metal-painted", part)


def _add_span(
    assembly: Assembly,
    line: LineString,
    station: float,
    kind: str,
    works: _Works,
    part: int,
    notes: Counter[str],
) -> bool:
    """Support the wire at a station: a span between both sides, or a bracket on one side."""
    at = np.array(line.interpolate(station).coords[0][:2])
    ends = [np.array(line.interpolate(station + d).coords[0][:2]) for d in (-0.5, 0.5)]
    way = ends[1] - ends[0]
    if np.hypot(*way) < 1e-6:
        return False
    way /= np.hypot(*way)
    left = np.array([-way[1], way[0]])
    sides = [_hold(at, sign * left, NEAREST_M[kind], works) for sign in (1, -1)]
    found = [side for side in sides if side is not None]
    if not found:
        return False
    if kind == "rail":
        found = found[:1]
    xy = np.array([at, *[spot for spot, _ in found]])
    z = on_ground(xy, works.ground(xy))
    for (_, on_wall), foot in zip(found, z[1:], strict=True):
        if on_wall:
            continue
        mast = columns(foot - [0, 0, BURIED_M], MAST_M + BURIED_M, 0.11, 0.08)
        assembly.add(mast, "pole", "metal-painted", part)
        notes["masts of contact wires seeded"] += 1
    wire = z[0] + [0, 0, CONTACT_M]
    if len(found) == 1:
        _add_bracket(assembly, z[1], Point(at), works, part)
        return True
    hooks = np.column_stack([z[1:, :2], np.full(2, z[0, 2] + SPAN_M + 0.4)])
    span = float(np.linalg.norm(hooks[1] - hooks[0]))
    curve = catenaries(hooks[:1], hooks[1:], 0.02 * span, 8)
    assembly.add(wire_solid(curve, 0.01), "other-object", "metal-bare", part)
    cross = curve[0][np.argmin(np.linalg.norm(curve[0][:, :2] - at, axis=1))]
    dropper = rods([wire], [np.array([at[0], at[1], cross[2]])], 0.01, 0.01, 3)
    assembly.add(dropper, "other-object", "metal-bare", part)
    notes["spans across streets seeded"] += 1
    return True


def _hold(
    at: NDArray[np.float64], way: NDArray[np.float64], nearest: float, works: _Works
) -> tuple[NDArray[np.float64], bool] | None:
    """Return the first place beside a track for a mast, or the wall of a house before it."""
    tries = at + np.arange(nearest, FARTHEST_M, 0.25)[:, None] * way
    free = ~shapely.contains_xy(works.blocked, tries[:, 0], tries[:, 1])
    free &= shapely.contains_xy(works.region, tries[:, 0], tries[:, 1])
    within = np.zeros(len(tries), bool)
    if len(works.walls.geometries):
        within[works.walls.query(shapely.points(tries), predicate="within")[0]] = True
    if not (free | within).any():
        return None
    first = int(np.argmax(free | within))
    return tries[first], bool(within[first])


def _add_messenger(
    assembly: Assembly, line: LineString, held: Sequence[float], works: _Works, part: int
) -> None:
    if len(held) < 2:
        return
    xy = shapely.get_coordinates(shapely.line_interpolate_point(line, np.array(held)))
    points = on_ground(xy, works.ground(xy)) + [0, 0, MESSENGER_M]
    far = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1) > 5.0
    if far.any():
        curves = catenaries(points[:-1][far], points[1:][far], MESSENGER_SAG_M, 10)
        assembly.add(wire_solid(curves), "other-object", "metal-bare", part)
