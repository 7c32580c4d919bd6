"""Turn arrows on lanes before their stop lines."""

from __future__ import annotations

from functools import cache

import numpy as np
import shapely
from shapely.affinity import affine_transform

from urbantwin.roads.marking.lane_turns import turns
from urbantwin.roads.network import Lane, RoadNetwork

__all__ = ["ARROW_M", "arrow", "arrow_at", "turn_arrow"]

#: Length of an arrow, and how far its tip is from the stop line, metres.
ARROW_M, BEFORE_STOP_M = 6.0, 2.5
#: The shortest arrow that is painted where the map signs one, and how near the stop line, metres.
SHORTEST_M, CLOSEST_M = 3.0, 0.8
#: Turns as the map names them (OSM wiki, "Key:turn") -> as they are painted.
PAINTED = {
    "left": "left", "slight_left": "left", "sharp_left": "left", "merge_to_left": "left",
    "right": "right", "slight_right": "right", "sharp_right": "right", "merge_to_right": "right",
    "through": "through", "reverse": "around",
}  # fmt: skip
ORDER: tuple[str, ...] = ("left", "through", "right", "around")
#: An arrow of unit length is drawn for lanes this wide, metres; narrower ones get narrower arrows.
LANE_M, WIDEST = 3.0, 1.15


def turn_arrow(network: RoadNetwork, lane: Lane) -> shapely.Geometry | None:
    """Return the arrow before a lane's stop line, site frame, metres.

    What the map signs is painted as it is. Where it signs nothing for a street, arrows show where
    lanes lead; none where the lane leads to no junction, or where no signal stops it and it can
    only go on or may go anywhere. None on a lane that is too short.
    """
    if lane.kind == "bicycle" or lane.length < SHORTEST_M + 2 * CLOSEST_M:
        return None
    before = min(BEFORE_STOP_M, (lane.length - SHORTEST_M) / 2)
    length = min(ARROW_M, lane.length - 2 * before)
    if lane.arrows is not None:
        words = {PAINTED[word] for word in lane.arrows if word in PAINTED}
        signed = tuple(way for way in ORDER if way in words)
        return arrow_at(signed, lane, lane.length - before, length) if signed else None
    ways = turns(network, lane)
    if not ways or length < ARROW_M:
        return None
    plain = ways == ("through",) or {"left", "through", "right"} <= set(ways)
    if plain and lane.id not in {head.lane for head in network.signals}:
        return None
    return arrow_at(ways, lane, lane.length - BEFORE_STOP_M, ARROW_M)


def arrow_at(ways: tuple[str, ...], lane: Lane, at: float, length: float) -> shapely.Geometry:
    """Return an arrow with its tip on a lane's middle, ``at`` metres from the lane's start."""
    line = shapely.LineString(lane.centre[:, :2])
    a, b = (np.array(line.interpolate(s).coords[0]) for s in (max(at - length, 0.0), at))
    c, s = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
    wide = ARROW_M * min(lane.width / LANE_M, WIDEST)
    wide *= 1.0 if length >= ARROW_M else 0.9
    return affine_transform(arrow(ways), [length * c, -wide * s, length * s, wide * c, b[0], b[1]])


@cache
def arrow(ways: tuple[str, ...]) -> shapely.Geometry:
    """Return a turn arrow of length 1 along x, its tip at 0, for traffic that may go these ways.

    The shapes follow the arrows of road markings (US MUTCD, figure 3B-24; German RMS 1, 297).
    """
    thick, parts = 0.05, []
    several = len(ways) > 1
    if "through" in ways:
        parts += [_stroke([(-1.0, 0.0), (-0.3, 0.0)], thick)]
        parts += [shapely.Polygon([(0.0, 0.0), (-0.32, 0.12), (-0.32, -0.12)])]
    for way, side in (("left", 1.0), ("right", -1.0)):
        if way not in ways:
            continue
        back = 0.36 if "through" in ways else 0.0
        start = (-1.0, 0.0) if not several else (-0.62 - back, 0.0)
        bend = [(-0.34, 0.0), (-0.25, 0.015), (-0.19, 0.05), (-0.16, 0.1)]
        path = [start, *((x - back, y * side) for x, y in bend)]
        x, y = path[-1]
        head = [(x - 0.14, y), (x + 0.14, y), (x, y + 0.15 * side)]
        parts += [_stroke(path, thick), shapely.Polygon(head)]
        if several and "through" not in ways:
            parts += [_stroke([(-1.0, 0.0), (-0.3, 0.0)], thick)]
    if "around" in ways:
        side = -1.0 if "right" in ways and "left" not in ways else 1.0
        back = 0.4 if several else 0.0
        bend = [(-0.16, 0.0), (-0.08, 0.03), (-0.03, 0.1), (-0.08, 0.17), (-0.16, 0.2), (-0.3, 0.2)]
        path = [(-1.0, 0.0), *((x - back, y * side) for x, y in bend)]
        x, y = path[-1]
        head = [(x, y - 0.09), (x, y + 0.09), (x - 0.24, y)]
        parts += [_stroke(path, thick), shapely.Polygon(head)]
    shape = shapely.union_all(parts)
    # An arrow that bends to one side stands to the other, so that it is in the lane's middle.
    y0, y1 = shape.bounds[1], shape.bounds[3]
    return affine_transform(shape, [1, 0, 0, 1, 0, -0.5 * (y0 + y1)])


def _stroke(path: list[tuple[float, float]], width: float) -> shapely.Geometry:
    return shapely.LineString(path).buffer(width / 2, cap_style="flat", join_style="mitre")
