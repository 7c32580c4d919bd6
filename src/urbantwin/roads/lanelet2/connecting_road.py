"""Connecting roads: chains of lanelets between two streets, one lane each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.lanelet2.border import Border
from urbantwin.roads.lanelet2.group import Member
from urbantwin.roads.lanelet2.lane_sections import Row, heights_of, section_of
from urbantwin.roads.lanelet2.reference_line import LEAST_SHARE, Followed, Pose, smooth_curve
from urbantwin.roads.lanelet2.street import Street, Track, joined
from urbantwin.roads.model import ModelRoad, Profile, RoadLink

__all__ = ["ConnectingRoad", "Gate", "connecting_road_of", "gates_of", "routes"]

#: Maximum number of connecting roads from one lane.
MOST_ROUTES = 64


@dataclass(frozen=True, eq=False)
class Gate:
    """A lane of a street at a junction.

    Attributes:
        street: the street.
        track: the lane.
        lane: its id there.
        end: whether it is at the end of the road, not at its start.
        inward: whether traffic leaves the street here.
        pose: position of the lane's left border in its direction of travel, and that direction.
        left: (N, 3) left border beyond the gate, as far as the lane is mapped.
        right: the same of the right border.
    """

    street: Street
    track: Track
    lane: int
    end: bool
    inward: bool
    pose: Pose
    left: NDArray[np.float64]
    right: NDArray[np.float64]

    @property
    def lanelet(self) -> int:
        """Id of the lane's last or first lanelet, at the junction."""
        return self.track.members[-1 if self.end else 0].lanelet.id


@dataclass(frozen=True)
class ConnectingRoad:
    """A connecting road and its sources."""

    road: ModelRoad
    start: Gate
    lanelets: tuple[int, ...]
    end: Gate
    dropped: int

    @property
    def area(self) -> shapely.Geometry:
        """Its area in plan."""
        road = self.road
        s = np.linspace(0.0, road.length, max(4, int(road.length) + 1))
        section = road.sections[0]
        rows = [
            road.place(s, road.border(section, section.lanes[0], s, outer=outer))[:, :2]
            for outer in (False, True)
        ]
        return shapely.make_valid(shapely.Polygon(np.vstack([rows[0], rows[1][::-1]])))


def gates_of(street: Street) -> Iterator[Gate]:
    """Yield all lanes of a street that reach its ends at junctions."""
    road = street.road
    last = len(street.chain.groups) - 1
    for end, cut in enumerate(street.chain.cuts):
        if cut is None:
            continue
        section = road.sections[-1 if end else 0]
        station = road.length if end else 0.0
        heading = float(road.curve.at(station)[0, 2])
        for track, identity in street.lanes[-1 if end else 0].items():
            reaches_end = track.first + len(track.members) - 1 == last if end else track.first == 0
            member = track.members[-1 if end else 0]
            if not reaches_end or not member.lanelet.drives:
                continue
            lane = section.by_id[identity]
            points = []
            for k, border in enumerate(street.whole[track]):
                # The outer border of a lane to the left of the reference line is its left one.
                outer = (identity > 0) == (k == 0)
                t = road.border(section, lane, station, outer=outer)
                border_points = (
                    border.beyond(street.reach[1]) if end else border.before(street.reach[0])
                )
                points.append(np.vstack([road.place(station, t), border_points]))
            if not member.forward:
                points = points[::-1]
            inward = member.forward == bool(end)
            if not inward:
                points = [line[::-1] for line in points]
            travel = heading if member.forward else heading + math.pi
            x, y = points[0][0 if inward else -1][:2]
            pose = (float(x), float(y), travel)
            yield Gate(street, track, identity, bool(end), inward, pose, points[0], points[1])


def routes(
    start: int,
    successors: Mapping[int, tuple[int, ...]],
    inner: frozenset[int],
) -> list[tuple[tuple[int, ...], int]]:
    """Return all paths from a lanelet through inner ones to the next outer one.

    Each consists of the lanelets between and the last one; none contains a lanelet twice.
    """
    paths: list[tuple[tuple[int, ...], int]] = []
    waiting: list[tuple[tuple[int, ...], int]] = [((), k) for k in successors.get(start, ())]
    while waiting and len(paths) < MOST_ROUTES:
        path, last = waiting.pop(0)
        if last not in inner:
            paths.append((path, last))
        elif last not in path:
            waiting += [((*path, last), k) for k in successors.get(last, ())]
    return paths


def connecting_road_of(
    identity: int,
    start: Gate,
    way: Sequence[Member],
    end: Gate,
    side: str,
    attributes: Callable[[Member], Row],
    ways: Mapping[int, dict[str, str]],
) -> ConnectingRoad:
    """Return the connecting road of a movement through a junction.

    It begins and ends exactly on the last cross sections of the two streets. Its reference line
    follows its left border (in left-hand traffic its right one), or its centre if that border has
    too tight bends.

    Args:
        identity: id of the road.
        start: gate at its start.
        way: the lanelets within the junction, in order.
        end: gate at its end.
        side: driving side, ``right`` or ``left``.
        attributes: function that returns the attributes of a lanelet along its road.
        ways: tags of the map's ways.
    """
    left = joined([start.left, *(m.left for m in way), end.left])
    right = joined([start.right, *(m.right for m in way), end.right])
    followed = _followed(left, right, start, end, side)
    curve, pair = followed.curve, (followed.borders[0], followed.borders[1])
    members = way or [_travelled(start), _travelled(end)]
    row = _common([attributes(member) for member in members])
    reach = (0.0, curve.length)
    elevation, bank = heights_of(curve, reach, [[(None, pair)]])
    section, offset = section_of(reach, [pair], 0 if side == "right" else 1, [row], bank, ways)
    lane = replace(section.lanes[0], predecessor=start.lane, successor=end.lane)
    road = ModelRoad(
        identity,
        "",
        start.street.road.kind,
        tuple(member.lanelet.id for member in way),
        -1,
        curve,
        offset,
        elevation,
        bank,
        Profile.constant(0.0),
        (replace(section, lanes=(lane,)),),
        RoadLink("road", start.street.road.id, "end" if start.end else "start"),
        RoadLink("road", end.street.road.id, "end" if end.end else "start"),
    )
    dropped = pair[0].dropped + pair[1].dropped
    return ConnectingRoad(road, start, tuple(m.lanelet.id for m in way), end, dropped)


def _followed(
    left: NDArray[np.float64], right: NDArray[np.float64], start: Gate, end: Gate, side: str
) -> Followed:
    borders = [Border(left), Border(right)]

    def along(share: float) -> Followed:
        """Follow the line at a share of the distance from the left border to the right one."""
        if share in (0.0, 1.0):
            line = (left if share == 0.0 else right)[:, :2]
        else:
            steps = np.linspace(0.0, 1.0, 65)
            line = sum(
                weight
                * shapely.get_coordinates(
                    shapely.line_interpolate_point(
                        shapely.LineString(bound[:, :2]), steps, normalized=True
                    )
                )
                for weight, bound in ((1.0 - share, left), (share, right))
            )
        pins = (
            (float(line[0, 0]), float(line[0, 1]), start.pose[2]),
            (float(line[-1, 0]), float(line[-1, 1]), end.pose[2]),
        )
        return smooth_curve(line, borders, pins)

    best = along(0.0 if side == "right" else 1.0)
    if best.room < LEAST_SHARE:
        best = max(best, along(0.5), key=lambda followed: followed.room)
    return best


def _travelled(gate: Gate) -> Member:
    member = gate.track.members[-1 if gate.end else 0]
    return member if member.forward else member.flipped


def _common(rows: Sequence[Row]) -> Row:
    """Return the attributes common to all lanelets of a movement."""
    allowed = set.intersection(*(set(row.allowed) for row in rows))
    return Row(
        rows[0].kind,
        True,
        min(row.speed_limit for row in rows),
        tuple(name for name in rows[0].allowed if name in allowed),
        rows[0].lines,
    )
