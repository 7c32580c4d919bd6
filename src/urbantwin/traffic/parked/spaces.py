"""Parking spaces: along parking lanes, and in rows on mapped car parks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.roads.marking.give_way import BAY_ACROSS_M, NARROWEST_M, bay_length
from urbantwin.taxonomy import semantic_id

__all__ = ["Space", "car_park_spaces", "rectangle", "service_ground", "street_spaces"]

#: Car parks: depth and width of a space, and width of the aisle between two rows, metres (German
#: EAR 05, perpendicular spaces: 5.00 m deep, 2.50 m wide, aisle of 6.00 m).
DEEP_M, WIDE_M, AISLE_M = 5.0, 2.5, 6.0
#: Width of a usual car, metres, which is also the length that it loses between two lines at 45
#: degrees.
CAR_WIDE_M = 1.8
#: Ground within this distance of a parking lane belongs to the street, metres; least area of a car
#: park, square metres.
STREET_M, LEAST_M2 = 0.5, 60.0
#: Service ways within this distance of the kerb are driveways, metres: they end at the sidewalk.
BEYOND_M = 4.0


@dataclass(frozen=True, eq=False)
class Space:
    """A space for one vehicle.

    Attributes:
        kind: ``street`` or ``car_park``.
        place: (3,) its centre on the ground, site frame, metres.
        yaw: heading of a vehicle that drove in forwards, rad.
        length: along ``yaw``, metres.
        width: metres.
        kerb: side of the kerb, 1 left, -1 right; 0 for spaces across the road.
        lane: id of the parking lane; empty in car parks.
        slanted: whether it is at an angle to the road, so that no vehicle reverses into it.
    """

    kind: str
    place: NDArray[np.float64]
    yaw: float
    length: float
    width: float
    kerb: int = 0
    lane: str = ""
    slanted: bool = False

    def outline(self) -> shapely.Polygon:
        """Return its area in plan."""
        return rectangle(self.place[:2], self.yaw, self.length, self.width)

    def beyond(self) -> shapely.Polygon:
        """Return the area beyond the kerb, where a driveway would begin."""
        yaw = self.yaw + self.kerb * np.pi / 2
        depth = self.width if self.kerb else self.length
        wide = self.length if self.kerb else self.width
        middle = self.place[:2] + (depth + BEYOND_M) / 2 * np.array([np.cos(yaw), np.sin(yaw)])
        return rectangle(middle, yaw, BEYOND_M, wide - 0.4)


def rectangle(
    middle: NDArray[np.float64], yaw: float, length: float, width: float
) -> shapely.Polygon:
    """Return a rectangle in plan about a centre (2,), its length along ``yaw`` (rad), metres."""
    ahead = np.array([np.cos(yaw), np.sin(yaw)]) * length / 2
    left = np.array([-np.sin(yaw), np.cos(yaw)]) * width / 2
    return shapely.Polygon(
        [middle + ahead + left, middle - ahead + left, middle - ahead - left, middle + ahead - left]
    )


def street_spaces(network: RoadNetwork) -> Iterator[Space]:
    """Yield the spaces of parking lanes, between the painted lines.

    Vehicles parked along the road point in the direction of the nearest traffic lane, those across
    it point away from that lane, and diagonal ones halfway between.

    Args:
        network: the lanes.
    """
    driving = [lane for lane in network.lanes if lane.kind == "driving" and not lane.junction]
    if not driving:
        return
    tree = shapely.STRtree([shapely.LineString(lane.centre[:, :2]) for lane in driving])
    for lane in network.lanes:
        if lane.kind == "parking":
            yield from _spaces_along(lane, driving, tree)


def _spaces_along(lane: Lane, driving: list[Lane], tree: shapely.STRtree) -> Iterator[Space]:
    steps = np.linalg.norm(np.diff(lane.centre[:, :2], axis=0), axis=1)
    station_m = np.concatenate([[0.0], np.cumsum(steps)])
    if station_m[-1] < 1e-6:
        return
    widths = lane.widths if len(lane.widths) else np.full(len(station_m), lane.width)
    fine = np.arange(0.0, station_m[-1], 0.25)
    wide = fine[np.interp(fine, station_m, widths) >= NARROWEST_M]
    if not len(wide):
        return
    widest = float(np.max(widths))
    pitch, slanted = bay_length(lane.parking, widest)
    across = not slanted and pitch == BAY_ACROSS_M
    lean = widest if slanted else 0.0
    count = int((wide[-1] - wide[0] + 0.25 - lean) // pitch)
    for s in (wide[0] + wide[-1]) / 2 + pitch * (np.arange(count) - (count - 1) / 2):
        beside = (pitch + lean) / 2
        if np.interp([s - beside, s + beside], station_m, widths).min() < NARROWEST_M:
            continue
        place = np.array([np.interp(s, station_m, lane.centre[:, axis]) for axis in range(3)])
        before, after = (
            np.array([np.interp(k, station_m, lane.centre[:, axis]) for axis in range(2)])
            for k in (s - 0.5, s + 0.5)
        )
        yaw = float(np.arctan2(*(after - before)[::-1]))
        nearest_lane = driving[int(tree.nearest(shapely.Point(place[:2])))]
        line = shapely.LineString(nearest_lane.centre[:, :2])
        foot = line.project(shapely.Point(place[:2]))
        ends = [shapely.get_coordinates(line.interpolate(foot + d))[0] for d in (-0.5, 0.5)]
        traffic = ends[1] - ends[0]
        if np.cos(yaw) * traffic[0] + np.sin(yaw) * traffic[1] < 0:
            yaw += np.pi
        away = place[:2] - (ends[0] + ends[1]) / 2
        left = -np.sin(yaw) * away[0] + np.cos(yaw) * away[1] > 0
        width = float(np.interp(s, station_m, widths))
        if slanted:
            # A car of usual width keeps its corners within the lane.
            yaw += np.pi / 4 if left else -np.pi / 4
            length = width * np.sqrt(2.0) - CAR_WIDE_M
            yield Space("street", place, yaw, length, BAY_ACROSS_M, 0, lane.id, slanted=True)
        elif across:
            yaw += np.pi / 2 if left else -np.pi / 2
            yield Space("street", place, yaw, width, pitch, 0, lane.id)
        else:
            yield Space("street", place, yaw, pitch, width, 1 if left else -1, lane.id)


def car_park_spaces(mesh: LabelledMesh, network: RoadNetwork) -> Iterator[Space]:
    """Yield spaces on the ground of mapped car parks: rows along their longer side, with aisles.

    Maps do not contain the rows. The layout is assumed: the first row along the edge, two back to
    back after every aisle.

    Args:
        mesh: the ground; parking areas beside the lanes of streets are car parks.
        network: the lanes.
    """
    up = (mesh.semantic == semantic_id("parking")) & (mesh.normals()[:, 2] > 0.5)
    triangles = mesh.triangles()[up]
    if not len(triangles):
        return
    streets = network.carriageway(0).buffer(STREET_M)
    free = _level_ground(mesh, "parking").difference(streets).buffer(-0.3).buffer(0.3)
    middles = triangles.mean(axis=1)
    heights = shapely.STRtree(shapely.points(middles[:, :2]))
    for area in shapely.get_parts(free):
        if area.geom_type != "Polygon" or area.area < LEAST_M2:
            continue
        for middle, yaw in _spaces_in_rows(area):
            z = middles[int(heights.nearest(shapely.Point(middle))), 2]
            yield Space("car_park", np.array([*middle, z]), yaw, DEEP_M, WIDE_M)


def service_ground(mesh: LabelledMesh, network: RoadNetwork) -> shapely.Geometry:
    """Return the ground of service ways: road beside the lanes of streets."""
    ground = _level_ground(mesh, "road").difference(network.carriageway(0).buffer(STREET_M))
    inside = shapely.union_all(
        [junction.polygon for junction in network.junctions if junction.level == 0]
    )
    area = ground.difference(inside.buffer(STREET_M)).buffer(-0.5).buffer(0.5)
    shapely.prepare(area)
    return area


def _level_ground(mesh: LabelledMesh, name: str) -> shapely.Geometry:
    """Return the area in plan of the level triangles of a class."""
    up = (mesh.semantic == semantic_id(name)) & (mesh.normals()[:, 2] > 0.5)
    flat = shapely.polygons(mesh.triangles()[up][:, :, :2])
    return shapely.union_all(flat[shapely.area(flat) > 1e-6], grid_size=1e-3)


def _spaces_in_rows(area: shapely.Polygon) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Yield centre (2,) and yaw of the spaces of an area."""
    corners = shapely.get_coordinates(area.minimum_rotated_rectangle)
    sides = np.diff(corners[:3], axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    longer = int(lengths[1] > lengths[0])
    ahead = sides[longer] / lengths[longer]
    across = sides[1 - longer] / lengths[1 - longer]
    start = corners[0] if longer == 0 else corners[1]
    if longer == 1:
        across = -across
    long, deep = lengths[longer], lengths[1 - longer]
    room = area.buffer(0.05)
    shapely.prepare(room)
    # Depth of the middle of each row, and the side it faces: away from its aisle.
    rows, depth_m = [], 0.0
    while depth_m + DEEP_M <= deep + 1e-6:
        rows.append((depth_m + DEEP_M / 2, -1.0))
        depth_m += DEEP_M + AISLE_M
        if depth_m + DEEP_M <= deep + 1e-6:
            rows.append((depth_m + DEEP_M / 2, 1.0))
            depth_m += DEEP_M
    count = int(long // WIDE_M)
    for depth, side in rows:
        yaw = float(np.arctan2(*(across * side)[::-1]))
        for k in range(count):
            along = (long - count * WIDE_M) / 2 + (k + 0.5) * WIDE_M
            middle = start + ahead * along + across * depth
            if room.contains(rectangle(middle, yaw, DEEP_M, WIDE_M)):
                yield middle, yaw
