"""Places of counts: approaches, turns, roads and crossings by id, name or compass direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from urbantwin.errors import InputError
from urbantwin.roads import Lane, Road, RoadNetwork
from urbantwin.taxonomy import road_user

__all__ = [
    "Way",
    "arm_of",
    "crossing_of",
    "main_junction",
    "ridden_along",
    "road_of",
    "turn_of",
    "way_of",
]

_ARMS = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")
_TURNS = ("left", "through", "right", "u-turn")
#: Changes of direction below the first are through, above the second u-turns, degrees.
_MAX_THROUGH_DEG, _MIN_U_TURN_DEG = 35.0, 150.0
_MAX_NAMES = 20  # maximum number of names in an error
_DIRECTION_M = 20.0  # length of a road from which its direction is taken


@dataclass(frozen=True)
class Way:
    """The approach and exit road of a row of counts."""

    approach: Road
    exit: Road


def turn_of(roads: RoadNetwork, approach: Road, leaving: Road) -> str:
    """Return the turn from one road into another: left, through, right or u-turn."""
    into = _direction(roads, approach, at_end=True)
    away = _direction(roads, leaving, at_end=False)
    turned = float(np.degrees(np.angle(np.exp(1j * (away - into)))))
    if abs(turned) < _MAX_THROUGH_DEG:
        return "through"
    if abs(turned) > _MIN_U_TURN_DEG:
        return "u-turn"
    return "left" if turned > 0 else "right"


def way_of(row: Mapping[str, Any], roads: RoadNetwork, place: str) -> Way:
    """Return the roads that a row of counts refers to.

    Raises:
        InputError: a road is unknown or ambiguous.
    """
    by_id = {road.id: road for road in roads.roads}
    name, turn = str(row["approach"]), str(row["turn"])
    junction = _junction(str(row.get("junction") or ""), roads, place)
    kind = road_user(row.get("actor_class") or "car")
    driven = [
        road
        for road in roads.roads
        if any(kind in roads.lane_by_id[lane].allowed for lane in road.lanes)
    ]
    approaches = [road for road in driven if road.to_junction == junction]
    approach = by_id.get(name)
    if approach is None:
        approach = _road_by_name(name, approaches, roads, at_end=True, place=place, what="approach")
    exits = [road for road in driven if road.from_junction == approach.to_junction]
    leaving = by_id.get(turn)
    if leaving is None and turn in _TURNS:
        turned = [road for road in exits if turn_of(roads, approach, road) == turn]
        if not turned:
            turns = ", ".join(f"{road.id} ({turn_of(roads, approach, road)})" for road in exits)
            raise InputError(
                f"there is no movement {turn} from {name}", place=place, expected=f"one of {turns}"
            )
        # Among several, the one nearest to a right angle, or to straight on.
        leaving = min(turned, key=lambda road: _turn_deviation(roads, approach, road, turn))
    if leaving is None:
        leaving = _road_by_name(turn, exits, roads, at_end=False, place=place, what="turn")
    return Way(approach, leaving)


def _road_by_name(
    name: str, among: list[Road], roads: RoadNetwork, *, at_end: bool, place: str, what: str
) -> Road:
    """Return the road of a junction with a given name or compass direction."""
    arms = {road.id: arm_of(roads, road, at_end=at_end) for road in among}
    matches = [road for road in among if name == road.name or _is_arm(name, arms[road.id])]
    if len(matches) == 1:
        return matches[0]
    roads_there = ", ".join(
        f"{road.id} ({arms[road.id]}{', ' + road.name if road.name else ''})" for road in among
    )
    problem = f"means {len(matches)} roads" if matches else "is not there"
    extra = f", or {', '.join(_TURNS)}" if what == "turn" else ""
    raise InputError(
        f"the {what} {name!r} {problem}", place=place, expected=f"one of {roads_there}{extra}"
    )


def main_junction(roads: RoadNetwork) -> str:
    """Return the default junction: many incoming lanes, and near the origin of the site."""
    destinations = {road.to_junction for road in roads.roads}
    count = {
        junction.id: sum(len(road.lanes) for road in roads.roads if road.to_junction == junction.id)
        for junction in roads.junctions
        if junction.id in destinations
    }
    place = {
        junction.id: junction.polygon.centroid
        for junction in roads.junctions
        if not junction.polygon.is_empty
    }
    return max(
        sorted(count),
        key=lambda junction_id: (
            count[junction_id]
            - (
                np.hypot(place[junction_id].x, place[junction_id].y) / 50
                if junction_id in place
                else 9
            )
        ),
    )


def _direction(roads: RoadNetwork, road: Road, *, at_end: bool) -> float:
    """Return the direction of a road at the junction, rad from east."""
    centre = roads.lane_by_id[road.lanes[-1]].centre[:, :2]
    away_from = centre[::-1] if at_end else centre
    end_point = away_from[0]
    beyond = np.linalg.norm(away_from - end_point, axis=1) >= _DIRECTION_M
    far = away_from[int(np.argmax(beyond)) if beyond.any() else -1]
    step = end_point - far if at_end else far - end_point
    return float(np.arctan2(step[1], step[0]))


def arm_of(roads: RoadNetwork, road: Road, *, at_end: bool) -> str:
    """Return the compass direction in which a road lies from the junction."""
    bearing = _direction(roads, road, at_end=at_end) + (np.pi if at_end else 0.0)
    return _ARMS[round(float(np.degrees(bearing)) % 360 / 45) % 8]


def _is_arm(name: str, arm: str) -> bool:
    """Return whether a name denotes an arm; signal programs write it without a hyphen."""
    return name.lower().replace("-", "") == arm.replace("-", "")


def _turn_deviation(roads: RoadNetwork, approach: Road, leaving: Road, turn: str) -> float:
    into = _direction(roads, approach, at_end=True)
    away = _direction(roads, leaving, at_end=False)
    turned = abs(float(np.degrees(np.angle(np.exp(1j * (away - into))))))
    return abs(turned - {"through": 0.0, "u-turn": 180.0}.get(turn, 90.0))


def road_of(name: str, roads: RoadNetwork, place: str) -> Road:
    """Return the road with an id, with a lane of that id, or with a street name.

    Raises:
        InputError: it does not exist, or several roads have this name.
    """
    lane = roads.lane_by_id.get(name)
    wanted = lane.road if lane is not None and lane.road else name
    matches = [road for road in roads.roads if road.id == wanted]
    matches = matches or [road for road in roads.roads if road.name and road.name == name]
    if len(matches) == 1:
        return matches[0]
    candidates = matches or roads.roads
    listed = ", ".join(
        f"{candidate.id} ({candidate.name})" if candidate.name else candidate.id
        for candidate in candidates[:_MAX_NAMES]
    )
    problem = f"means {len(matches)} roads" if matches else "is not there"
    raise InputError(f"the road {name[:60]!r} {problem}", place=place, expected=f"one of {listed}")


def crossing_of(row: Mapping[str, Any], roads: RoadNetwork, place: str) -> Lane:
    """Return the crossing with an id, or across the arm of a junction.

    Of the parts of a crossing with islands, the longest.

    Raises:
        InputError: it does not exist.
    """
    name = str(row["crossing"])
    crossings = [lane for lane in roads.lanes if lane.kind == "crossing"]
    for lane in crossings:
        if name in (lane.id, lane.id.rpartition("_")[0]):
            return lane
    junction = _junction(str(row.get("junction") or ""), roads, place)
    arms = [
        (np.asarray(roads.lane_by_id[road.lanes[-1]].centre[-1 if at_end else 0, :2]), road, at_end)
        for road in roads.roads
        for at_end in (True, False)
        if (road.to_junction if at_end else road.from_junction) == junction
        and "car" in roads.lane_by_id[road.lanes[-1]].allowed
    ]
    of_junction = [lane for lane in crossings if lane.junction == junction] if arms else []
    arm: dict[str, str] = {}
    for lane in of_junction:
        middle = lane.centre[:, :2].mean(axis=0)
        _, road, at_end = min(arms, key=lambda arm: float(np.linalg.norm(arm[0] - middle)))
        arm[lane.id] = arm_of(roads, road, at_end=at_end)
    matches = [lane for lane in of_junction if _is_arm(name, arm[lane.id])]
    if matches:
        return max(matches, key=lambda lane: lane.length)
    listed = ", ".join(f"{lane.id} ({arm[lane.id]})" for lane in of_junction)
    raise InputError(
        f"the crossing {name[:60]!r} is not there",
        place=place,
        expected=f"one of {listed}" if listed else "the id of a crossing: this junction has none",
    )


def ridden_along(row: Mapping[str, Any], roads: RoadNetwork, place: str) -> Way:
    """Return the through movement of the cyclists that are counted on a crossing.

    They ride parallel to the pedestrians: past the arm that is crossed, which lies at their kerb.
    Of several movements it is the one nearest to the crossing.

    Raises:
        InputError: the crossing does not exist, or no bicycle route passes it.
    """
    crossing = crossing_of(row, roads, place)
    middle = crossing.centre[:, :2].mean(axis=0)
    kerb = 1.0 if roads.driving_side == "left" else -1.0
    lane_of = {
        road.id: [roads.lane_by_id[lane] for lane in road.lanes if _is_ridden(lane, roads)]
        for road in roads.roads
    }
    movements: list[tuple[float, Way]] = []
    for approach in roads.roads:
        if approach.to_junction != crossing.junction or not lane_of[approach.id]:
            continue
        for leaving in roads.roads:
            if leaving.from_junction != crossing.junction or not lane_of[leaving.id]:
                continue
            begin = lane_of[approach.id][0].centre[-1, :2]
            step = lane_of[leaving.id][0].centre[0, :2] - begin
            off = middle - begin
            length = float(np.hypot(*step))
            along = float(step @ off) / max(length, 1e-9)
            lateral_m = kerb * float(step[0] * off[1] - step[1] * off[0]) / max(length, 1e-9)
            if not (0 < along < length and lateral_m > 0):
                continue
            if turn_of(roads, approach, leaving) == "through":
                movements.append((lateral_m, Way(approach, leaving)))
    if not movements:
        raise InputError(
            f"no bicycle route follows the crossing {str(row['crossing'])[:60]!r}",
            place=place,
            expected="a crossing that bicycles pass straight on, or approach and turn",
        )
    return min(
        movements,
        key=lambda candidate: (candidate[0], candidate[1].approach.id, candidate[1].exit.id),
    )[1]


def _is_ridden(lane: str, roads: RoadNetwork) -> bool:
    return "bicycle" in roads.lane_by_id[lane].allowed


def _junction(name: str, roads: RoadNetwork, place: str) -> str:
    """Return the junction with an id or with streets (``First Street / Second Street``).

    Without a name, the main junction.

    Raises:
        InputError: it does not exist, or is ambiguous.
    """
    if not name:
        return main_junction(roads)
    streets: dict[str, set[str]] = {}
    for road in roads.roads:
        for junction in (road.to_junction, road.from_junction):
            streets.setdefault(junction, set()).update([road.name] if road.name else [])
    if name in streets:
        return name
    wanted = {part.strip() for part in name.split("/")}
    ids = {junction.id for junction in roads.junctions}
    matches = [
        junction_id
        for junction_id in sorted(streets)
        if junction_id in ids and wanted <= streets[junction_id]
    ]
    if len(matches) == 1:
        return matches[0]
    listed = [
        f"{junction_id} ({' / '.join(sorted(streets[junction_id]))})"
        for junction_id in sorted(streets)
        if streets[junction_id]
    ]
    problem = (
        f"means {len(matches)} junctions ({', '.join(matches)})" if matches else "is not there"
    )
    raise InputError(
        f"the junction {name[:60]!r} {problem}",
        place=place,
        expected="one of " + ", ".join(listed[:_MAX_NAMES]),
    )
