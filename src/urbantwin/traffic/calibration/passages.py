"""Passages over the junction: approach, exit, and time at the stop line."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads import Road, RoadNetwork
from urbantwin.roads.signals.controlled_links import Signalised, signalised_junctions
from urbantwin.traffic.demand.counted_places import main_junction
from urbantwin.traffic.paths.lane_below import LanesBelow
from urbantwin.traffic.recorded.track import RecordedTrack

__all__ = [
    "HEAVY",
    "MOTORS",
    "SETTLES_S",
    "STANDS_MS",
    "JunctionLinks",
    "Passage",
    "SeenTrack",
    "passages_of",
]

#: Least number of samples on a road to the junction for a further passage: paths may cut across
#: lanes.
_MIN_APPROACH_SAMPLES = 3
#: Number of samples, and least speed, m/s, for extrapolation to before a track.
_FIRST_SAMPLES, _MIN_SPEED_MS = 10, 3.0
#: Classes whose passages are counted.
MOTORS = ("car", "van", "truck", "bus", "motorcycle")
#: Those of them that accelerate slowly.
HEAVY = ("truck", "bus")
#: Speed below which a vehicle stands, m/s.
STANDS_MS = 0.5
#: Time that trackers need to settle on a new track, seconds.
SETTLES_S = 1.0


@dataclass(frozen=True, eq=False)
class SeenTrack:
    """A track with its speed, resampled.

    Attributes:
        track: the recorded or simulated track.
        time_s: (N,) seconds.
        xy: (N, 2) metres.
        yaw: (N,) rad.
        speed: (N,) m/s.
    """

    track: RecordedTrack
    time_s: NDArray[np.float64]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    speed: NDArray[np.float64]

    def part(self, rows: slice) -> SeenTrack:
        """Return a part of the same track."""
        columns = (self.time_s, self.xy, self.yaw, self.speed)
        return SeenTrack(self.track, *(column[rows] for column in columns))


@dataclass(frozen=True, eq=False)
class Passage:
    """A vehicle's passage over the junction; what was not observed is empty, or nan.

    Attributes:
        seen: the vehicle's track.
        lanes: (N,) the lane below each sample.
        approach: road that it came from.
        leaving: road that it left by.
        lane: lane of the approach from which it entered the junction.
        passed_s: time at which its centre passed the stop line, seconds; extrapolated by its speed
            if it was first seen beyond.
    """

    seen: SeenTrack
    lanes: NDArray[np.object_]
    approach: str
    leaving: str
    lane: str
    passed_s: float


@dataclass(frozen=True)
class JunctionLinks:
    """The movements over the main junction, from SUMO's network.

    Attributes:
        junction: its id.
        ways: lane within -> (lane before, road after).
        links: (lane before, road after) -> indices of the signal's links.
        signals: the movements that its signals control; ``None`` without signals.
        green: (phases, links) which links are green in the phases of its program; (0, 0) without.
        beside: as ``links``, of movements at adjacent junctions with the same program.
    """

    junction: str
    ways: dict[str, tuple[str, str]]
    links: dict[tuple[str, str], tuple[int, ...]]
    signals: Signalised | None
    green: NDArray[np.bool_]
    beside: dict[tuple[str, str], tuple[int, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, net: Path, roads: RoadNetwork) -> JunctionLinks:
        """Read them from a network."""
        junction = main_junction(roads)
        into = {road.id for road in roads.roads if road.to_junction == junction}
        movement_of_lane: dict[str, tuple[str, str]] = {}
        links: dict[tuple[str, str], list[int]] = defaultdict(list)
        root, program = etree.parse(net).getroot(), ""
        follow: dict[str, str] = {}
        for item in root.iterfind("connection"):
            before = f"{item.get('from')}_{item.get('fromLane')}"
            if item.get("via"):
                follow[before] = item.get("via")
            if item.get("from") not in into or not item.get("via"):
                continue
            movement = (before, item.get("to"))
            movement_of_lane[item.get("via")] = movement
            if item.get("tl"):
                program = item.get("tl")
                links[movement].append(int(item.get("linkIndex")))
        # A movement over a large junction has several lanes.
        for first, movement in list(movement_of_lane.items()):
            lane = first
            while (lane := follow.get(lane, "")) and lane not in movement_of_lane:
                movement_of_lane[lane] = movement
        junctions = signalised_junctions(root) if program else []
        signals = next(
            (
                junction_signals
                for junction_signals in junctions
                if junction_signals.program == program
            ),
            None,
        )
        beside: dict[tuple[str, str], list[int]] = defaultdict(list)
        for item in root.iterfind("connection") if program else ():
            road = str(item.get("from"))
            if item.get("tl") == program and road not in into and not road.startswith(":"):
                movement = (f"{road}_{item.get('fromLane')}", str(item.get("to")))
                beside[movement].append(int(item.get("linkIndex")))
        movements, others = (
            {movement: tuple(numbers) for movement, numbers in links_of.items()}
            for links_of in (links, beside)
        )
        return cls(junction, movement_of_lane, movements, signals, _green(root, program), others)

    def together(self, one: tuple[str, str], other: tuple[str, str]) -> bool:
        """Return whether two movements are ever green at once; always true without signals."""
        first, second = self.links.get(one, ()), self.links.get(other, ())
        if not first or not second:
            return True
        green = self.green[:, list(first)].any(axis=1) & self.green[:, list(second)].any(axis=1)
        return bool(green.any())


def _green(root: etree._Element, program: str) -> NDArray[np.bool_]:
    """Return which links (phases, links) of a program are green."""
    states = [
        phase.get("state")
        for program_element in root.iterfind("tlLogic")
        if program_element.get("id") == program
        for phase in program_element.iterfind("phase")
    ]
    if not states:
        return np.zeros((0, 0), np.bool_)
    return np.array([[letter in "Gg" for letter in state] for state in states], np.bool_)


def passages_of(
    tracks: Iterable[SeenTrack],
    roads: RoadNetwork,
    links: JunctionLinks,
    classes: Collection[str] = MOTORS,
) -> list[Passage]:
    """Return the passages of some classes over the main junction, in the order of the tracks.

    A vehicle that returns has a passage for each time, with the respective part of its track.
    """
    below = LanesBelow(roads)
    road_of = {lane: road for road in roads.roads for lane in road.lanes}
    passages: list[Passage | None] = []
    for whole in tracks:
        name = whole.track.actor_class
        if name not in classes:
            continue
        # Lanes for cars on the map serve all motor traffic.
        lane_ids = below.at(whole.xy, whole.yaw, "car" if name in MOTORS else name)
        passages += [
            _passage(whole.part(part), lane_ids[part], roads, road_of, links)
            for part in _visits(lane_ids, road_of, links.junction)
        ]
    return [passage for passage in passages if passage is not None]


def _visits(lanes: NDArray[np.object_], road_of: dict[str, Road], junction: str) -> list[slice]:
    """Return the parts of a track, split where it returns to a junction that it had left."""
    comes = np.array([_junction_at_end(road_of, lane) == junction for lane in lanes])
    leaves = np.array([_junction_at_begin(road_of, lane) == junction for lane in lanes])
    on_roads = np.flatnonzero(comes | leaves)
    before, then = on_roads[:-1], on_roads[1:]
    again = then[comes[then] & ~leaves[then] & leaves[before] & ~comes[before]]
    cuts = [0]
    for cut, end in pairwise([*again, len(lanes)]):
        if comes[cut:end].sum() >= _MIN_APPROACH_SAMPLES:
            cuts.append(int(cut))
    return [slice(a, b) for a, b in pairwise([*cuts, len(lanes)])]


def _passage(
    seen: SeenTrack,
    lanes: NDArray[np.object_],
    roads: RoadNetwork,
    road_of: dict[str, Road],
    links: JunctionLinks,
) -> Passage | None:
    """Return the passage of a track over the main junction; ``None`` if it is not on it."""
    on_approach = [
        k for k, lane_id in enumerate(lanes) if _junction_at_end(road_of, lane_id) == links.junction
    ]
    approach = lane = leaving = ""
    passed = np.nan
    if on_approach:
        last = on_approach[-1]
        lane = str(lanes[last])
        approach = road_of[lane].id
        if last + 1 < len(lanes):
            passed = _passed_between(seen, last, roads.lane_by_id[lane].centre[-1, :2])
    left = [
        k
        for k, lane_id in enumerate(lanes)
        if _junction_at_begin(road_of, lane_id) == links.junction
    ]
    left = [k for k in left if not on_approach or k > on_approach[-1]]
    if left:
        leaving = road_of[str(lanes[left[0]])].id
    if not approach or not leaving:
        lane, leaving = _by_inner_lanes(lanes, links, lane, leaving)
        approach = road_of[lane].id if lane else ""
        if lane and not on_approach:
            passed = _before(seen, roads.lane_by_id[lane].centre[-1, :2])
    if approach or leaving:
        return Passage(seen, lanes, approach, leaving, lane, passed)
    return None


def _passed_between(seen: SeenTrack, last: int, end: NDArray[np.float64]) -> float:
    """Return when a vehicle passed a stop line, between its last sample before and the next."""
    away = float(np.linalg.norm(seen.xy[last] - end))
    step = float(np.linalg.norm(seen.xy[last + 1] - seen.xy[last]))
    share = min(away / step, 1.0) if step > 0 else 1.0
    return float(seen.time_s[last] + share * (seen.time_s[last + 1] - seen.time_s[last]))


def _before(seen: SeenTrack, end: NDArray[np.float64]) -> float:
    """Return when a vehicle that was first seen beyond a stop line passed it, seconds."""
    speed = float(np.abs(seen.speed[:_FIRST_SAMPLES]).mean())
    away = float(np.linalg.norm(seen.xy[0] - end))
    return float(seen.time_s[0]) - away / max(speed, _MIN_SPEED_MS)


def _by_inner_lanes(
    lanes: NDArray[np.object_], links: JunctionLinks, lane: str, leaving: str
) -> tuple[str, str]:
    """Return the lane before and the road after, from the junction's lanes that it was on."""
    votes: dict[tuple[str, str], int] = defaultdict(int)
    for lane_id in lanes:
        movement = links.ways.get(str(lane_id))
        if (
            movement
            and (not lane or movement[0] == lane)
            and (not leaving or movement[1] == leaving)
        ):
            votes[movement] += 1
    if not votes:
        return lane, leaving
    return max(votes, key=lambda movement: (votes[movement], movement))


def _junction_at_end(road_of: dict[str, Road], lane: object) -> str:
    road = road_of.get(str(lane))
    return "" if road is None else road.to_junction


def _junction_at_begin(road_of: dict[str, Road], lane: object) -> str:
    road = road_of.get(str(lane))
    return "" if road is None else road.from_junction
