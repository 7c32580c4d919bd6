"""Manoeuvres: connecting roads through junctions, each with a curve of its own."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import stations_of_points
from urbantwin.roads.model.curve import Curve, all_turned, splined
from urbantwin.roads.network import Lane, Road, RoadNetwork
from urbantwin.roads.round_standing import round_standing
from urbantwin.roads.streets.street import Street, Strip, vehicle_lanes

__all__ = ["Manoeuvre", "Route", "Topology", "build_manoeuvres", "find_topology", "gentle_curves"]

#: Edges shorter than this between junctions are part of one larger junction, metres.
WITHIN_JUNCTION_M = 3.0
#: A street from such a junction back into it is a road where so much of it lies beyond, metres.
LOOP_M = 30.0
#: Room that lanes get to meet each other: roads are cut back where a junction leaves less, metres.
ROOM_M = 3.0
#: The same at a signal, whose stop line should keep its place.
ROOM_AT_SIGNAL_M = 1.0
#: Lanes that go on to one side do so no more tightly than this, where there is room, metres.
SHIFT_RADIUS_M = 25.0
#: Lanes that turn by more than this do not go straight on, radians.
SHIFT_TURN = 0.35
#: Lines that meet at such angles turn a corner, radians: motor traffic does so no more tightly than
#: this (turning circles of cars are 10 to 12 m), as far as roads keep this for arrows, metres.
CORNERS, CORNER_RADIUS_M, LEFT_M = (0.6, 2.4), 4.5, 13.0
#: Largest share of an edge that is cut off at one end.
TRIM_SHARE = 0.25
#: Points of a way closer than this are thinned, so that a spline through them is calm, metres.
SPACING_M = 1.5
#: Directness of the curves that are tried in turn, and how far each may lie from netconvert's way,
#: in metres and tenths of its length.
DIRECTNESS = ((1.0, 1.0), (4.0, 1.0), (12.0, 3.0))
#: Ways over junctions of several nodes are kept to this closely, metres; how their names begin.
KEPT_M, CLUSTER = 0.3, "cluster_"


@dataclass(frozen=True)
class Route:
    """A way through a junction: lanes of the model from ``start`` over ``via`` to ``end``."""

    start: str
    via: tuple[str, ...]
    end: str


@dataclass(frozen=True)
class Topology:
    """What becomes a road, what a manoeuvre, and which junctions are one.

    Attributes:
        edges: edges that become roads.
        routes: ways between their lanes.
        junction: id of a junction of the lane model -> id of the one that stands for its group.
        trims: (edge id, ``start`` or ``end``) -> metres of the edge left to the junction.
    """

    edges: tuple[Road, ...]
    routes: tuple[Route, ...]
    junction: Mapping[str, str]
    trims: Mapping[tuple[str, str], float]


@dataclass(frozen=True)
class Manoeuvre:
    """A connecting road: one lane, one way, its reference line in the lane's middle.

    Attributes:
        number: id of the road.
        side: number of its lane: -1 where lanes lie to the right of their reference line, else 1.
        route: the lanes that it stands for.
        junction: id of its junction.
        entry, exit: the roads that it joins, and
        start, end: the lanes there.
        kind: ``driving``, ``bus`` or ``bicycle``.
        allowed: classes of actors that may go this way.
        speed_limit: m/s.
        curve: the middle of its lane.
    """

    number: int
    side: int
    route: Route
    junction: str
    entry: Street
    exit: Street
    start: Strip
    end: Strip
    kind: str
    allowed: tuple[str, ...]
    speed_limit: float
    curve: Curve


def find_topology(network: RoadNetwork) -> Topology:
    """Return which lanes of the lane model become roads and which become manoeuvres."""
    kind_of = {junction.id: junction.kind for junction in network.junctions}
    border = {name for name, kind in kind_of.items() if kind == "dead_end"}
    within = {
        edge.id
        for edge in network.roads
        if min(lane.length for lane in vehicle_lanes(network, edge)) < WITHIN_JUNCTION_M
        and not {edge.from_junction, edge.to_junction} & border
    }
    group = _groups(network, within)
    # What runs from such a junction back into it lies within it too, but for loops beyond it.
    outline = _outlines(network, group)
    within |= {
        edge.id
        for edge in network.roads
        if edge.from_junction != edge.to_junction
        and group[edge.from_junction] == group[edge.to_junction]
        and _beyond(network, edge, outline[group[edge.from_junction]]) < LOOP_M
    }
    edges = tuple(edge for edge in network.roads if edge.id not in within)
    edge_of = {name: edge for edge in network.roads for name in edge.lanes}
    routes: dict[tuple[str, str], Route] = {}
    for edge in edges:
        for lane in vehicle_lanes(network, edge):
            for route in _routes(network, lane, within, edge_of):
                routes.setdefault((route.start, route.end), route)
    # Lanes that end without a connection join their neighbour's.
    every = tuple(routes.values()) + _merges(network, edges, routes, border, group)
    return Topology(edges, every, group, _trims(network, every, edge_of))


def _outlines(network: RoadNetwork, group: Mapping[str, str]) -> dict[str, shapely.Geometry]:
    """Return the hull of the junctions of each group."""
    members: dict[str, list[shapely.Geometry]] = defaultdict(list)
    for junction in network.junctions:
        members[group.get(junction.id, junction.id)].append(junction.polygon)
    return {name: shapely.union_all(parts).convex_hull for name, parts in members.items()}


def _beyond(network: RoadNetwork, edge: Road, outline: shapely.Geometry) -> float:
    """Return how much of an edge lies beyond an outline, metres."""
    line = shapely.LineString(vehicle_lanes(network, edge)[0].centre[:, :2])
    return float(line.difference(outline).length)


def _groups(network: RoadNetwork, within: set[str]) -> dict[str, str]:
    parent: dict[str, str] = {}

    def top(name: str) -> str:
        while parent.setdefault(name, name) != name:
            name = parent[name]
        return name

    for edge in network.roads:
        a, b = top(edge.from_junction), top(edge.to_junction)
        if edge.id in within:
            parent[max(a, b)] = min(a, b)
    return {name: top(name) for name in sorted(parent)}


def _routes(
    network: RoadNetwork, lane: Lane, within: set[str], edge_of: Mapping[str, Road]
) -> Iterable[Route]:
    """Return the ways from a lane's end to the next lanes that are roads', shortest first."""
    waiting: list[tuple[str, tuple[str, ...]]] = [(name, ()) for name in lane.successors]
    while waiting:
        name, via = waiting.pop(0)
        following = network.lane_by_id.get(name)
        if following is None or name in via:
            continue
        if following.kind in ("crossing", "walkingarea", "sidewalk"):
            continue
        if following.road and edge_of[name].id not in within:
            yield Route(lane.id, via, name)
            continue
        waiting += [(after, (*via, name)) for after in following.successors]


def _merges(
    network: RoadNetwork,
    edges: tuple[Road, ...],
    routes: Mapping[tuple[str, str], Route],
    border: set[str],
    group: Mapping[str, str],
) -> tuple[Route, ...]:
    """Return ways for lanes of motor traffic that end at a junction without one.

    They join the way of the nearest lane beside them that goes on, else the edge that leaves the
    junction most nearly straight on.
    """
    onward: dict[str, list[Route]] = defaultdict(list)
    for route in routes.values():
        onward[route.start].append(route)
    found = []
    for edge in edges:
        lanes = [lane for lane in vehicle_lanes(network, edge) if lane.kind != "bicycle"]
        if edge.to_junction in border or all(lane.kind == "sidewalk" for lane in lanes):
            continue
        for k, lane in enumerate(lanes):
            if onward[lane.id]:
                continue
            beside = sorted((abs(k - j), j) for j, other in enumerate(lanes) if onward[other.id])
            ends = [r.end for r in onward[lanes[beside[0][1]].id]] if beside else []
            ends = ends or _straight_on(network, edges, edge, lane, group)
            found += [Route(lane.id, (), end) for end in ends[:1]]
    return tuple(found)


def _straight_on(
    network: RoadNetwork,
    edges: tuple[Road, ...],
    edge: Road,
    lane: Lane,
    group: Mapping[str, str],
) -> list[str]:
    ahead = lane.centre[-1, :2] - lane.centre[-2, :2]
    best: list[tuple[float, str]] = []
    for other in edges:
        if group[other.from_junction] != group[edge.to_junction]:
            continue
        for start in vehicle_lanes(network, other):
            leg = start.centre[1, :2] - start.centre[0, :2]
            cosine = ahead @ leg / np.linalg.norm(ahead) / np.linalg.norm(leg)
            if start.kind == "driving" and cosine > -0.5:
                best.append((-round(float(cosine), 6), start.id))
    return [name for _, name in sorted(best)]


def _trims(
    network: RoadNetwork, routes: Iterable[Route], edge_of: Mapping[str, Road]
) -> dict[tuple[str, str], float]:
    signalled = {edge_of[head.lane].id for head in network.signals if head.lane in edge_of}
    trims: dict[tuple[str, str], float] = defaultdict(float)
    for route in routes:
        chain = [network.lane_by_id[name] for name in route.via]
        first, last = network.lane_by_id[route.start], network.lane_by_id[route.end]
        way = sum(lane.length for lane in chain)
        way = way or float(np.linalg.norm(last.centre[0, :2] - first.centre[-1, :2]))
        before, after = edge_of[route.start], edge_of[route.end]
        lacking = max(0.0, max(ROOM_M, _room_to_shift(first, last)) - way)
        give = lacking / 2
        if before.id in signalled:
            # The stop line keeps its place; the other side gives the remaining length.
            give = max(0.0, ROOM_AT_SIGNAL_M - way) / 2
        corner = _room_to_turn(first, last)
        giving = max(give, corner[0] if before.id not in signalled else 0.0)
        keys = (
            (before.id, "end", giving, first),
            (after.id, "start", max(lacking - give, corner[1]), last),
        )
        for edge, end, want, lane in keys:
            trims[edge, end] = max(trims[edge, end], min(want, TRIM_SHARE * lane.length))
    return dict(trims)


def _room_to_turn(first: Lane, last: Lane) -> tuple[float, float]:
    """Return how much a lane has to end earlier, and the next to begin later, to turn gently."""
    if "bicycle" in (first.kind, last.kind):
        return 0.0, 0.0
    legs = first.centre[-1, :2] - first.centre[-2, :2], last.centre[1, :2] - last.centre[0, :2]
    a, b = (leg / max(float(np.linalg.norm(leg)), 1e-9) for leg in legs)
    across = float(a[0] * b[1] - a[1] * b[0])
    turn = abs(float(np.arctan2(across, a @ b)))
    if not CORNERS[0] < turn < CORNERS[1]:
        return 0.0, 0.0
    # How far ahead of the one and behind the other their lines meet.
    gap = last.centre[0, :2] - first.centre[-1, :2]
    ahead = float(gap[0] * b[1] - gap[1] * b[0]) / across
    behind = float(a[0] * gap[1] - a[1] * gap[0]) / across
    need = CORNER_RADIUS_M * np.tan(turn / 2)
    spare = (max(0.0, (lane.length - LEFT_M) / 2) for lane in (first, last))
    early, late = (
        min(max(0.0, need - there), left)
        for there, left in zip((ahead, behind), spare, strict=True)
    )
    return float(early), float(late)


def _room_to_shift(first: Lane, last: Lane) -> float:
    """Return how long a way must be that moves sideways from one lane to another ahead of it."""
    legs = first.centre[-1, :2] - first.centre[-2, :2], last.centre[1, :2] - last.centre[0, :2]
    a, b = (leg / max(float(np.linalg.norm(leg)), 1e-9) for leg in legs)
    if a @ b < np.cos(SHIFT_TURN):
        return 0.0
    gap = last.centre[0, :2] - first.centre[-1, :2]
    ahead = (a + b) / np.linalg.norm(a + b)
    aside = abs(float(ahead[0] * gap[1] - ahead[1] * gap[0]))
    # Two arcs that meet in the middle: aside = length^2 / (4 radius).
    return float(np.sqrt(4 * SHIFT_RADIUS_M * aside))


def build_manoeuvres(
    network: RoadNetwork,
    streets: tuple[Street, ...],
    topology: Topology,
    *,
    side: int,
    standing: Sequence[shapely.Geometry] = (),
) -> tuple[Manoeuvre, ...]:
    """Return a connecting road for every route.

    Args:
        network: the network.
        streets: its roads.
        topology: what becomes a road, what a manoeuvre.
        side: as in ``build_streets``.
        standing: outlines of what stands on the ground, which ways lead round, site frame.
    """
    street_of = {name: street for street in streets for name in street.strip_of}
    joints = [
        _Joint(
            street_of[route.start],
            street_of[route.start].strip_of[route.start],
            street_of[route.end],
            street_of[route.end].strip_of[route.end],
            [network.lane_by_id[name] for name in route.via],
        )
        for route in topology.routes
    ]
    result = []
    curves = _curves(joints, standing)
    for number, (route, joint, curve) in enumerate(
        zip(topology.routes, joints, curves, strict=True), start=len(streets) + 1
    ):
        start, end, chain = joint.start.lane, joint.end.lane, joint.chain
        edge = joint.entry.edge
        result.append(
            Manoeuvre(
                number,
                side,
                route,
                topology.junction[edge.to_junction if joint.start.forward else edge.from_junction],
                joint.entry,
                joint.exit,
                joint.start,
                joint.end,
                _kind(start, end, chain),
                _allowed(start, end, chain),
                min([lane.speed_limit for lane in chain] or [start.speed_limit]),
                curve,
            )
        )
    return tuple(result)


@dataclass(frozen=True)
class _Joint:
    """What a way through a junction joins, and netconvert's lanes there."""

    entry: Street
    start: Strip
    exit: Street
    end: Strip
    chain: list[Lane]

    @property
    def poses(self) -> NDArray[np.float64]:
        """x, y, heading (2, 3) where it begins and where it ends."""
        poses = np.empty((2, 3))
        ends = ((self.entry, self.start, True), (self.exit, self.end, False))
        for pose, (street, strip, leaving) in zip(poses, ends, strict=True):
            x, y, heading = street.curve.at(street.end_of(strip, leaving=leaving))[0]
            pose[:2] = x - strip.t * np.sin(heading), y + strip.t * np.cos(heading)
            pose[2] = heading + (0.0 if strip.forward else np.pi)
        turn = poses[1, 2] - poses[0, 2]
        # `wrapped`, rounded in the order that the curves of every twin so far were made with.
        poses[1, 2] = poses[0, 2] + (turn + np.pi) % (2 * np.pi) - np.pi
        return poses


def _allowed(start: Lane, end: Lane, chain: list[Lane]) -> tuple[str, ...]:
    """Return the classes that may use all lanes of a way; without any, those of its first lane."""
    common = [name for name in start.allowed if all(name in x.allowed for x in (*chain, end))]
    return tuple(common) or (chain[0] if chain else start).allowed


def _kind(start: Lane, end: Lane, chain: list[Lane]) -> str:
    kinds = {start.kind, end.kind}
    if "bicycle" in kinds or (chain and not {"car", "bus"} & set(chain[0].allowed)):
        return "bicycle"
    if "bus" in kinds or (chain and "car" not in chain[0].allowed):
        return "bus"
    return "driving"


def _curves(joints: Sequence[_Joint], standing: Sequence[shapely.Geometry]) -> list[Curve]:
    """Return the gentlest ways; where the map leads far round something, the map's own way."""
    poses = [joint.poses for joint in joints]
    mapped = [_mapped(x, pose) if x.chain else None for x, pose in zip(joints, poses, strict=True)]
    # Ways over junctions of several nodes are drawn before netconvert, and kept.
    kept = [any(lane.junction.startswith(CLUSTER) for lane in joint.chain) for joint in joints]
    curves = gentle_curves(poses, mapped, kept)
    free = [k for k, joint in enumerate(joints) if not kept[k] and joint.start.lane.level == 0]
    roads = [(joints[k].start.lane.road, joints[k].end.lane.road) for k in free]
    for number, curve in round_standing([curves[k] for k in free], roads, standing).items():
        curves[free[number]] = curve
    return curves


def gentle_curves(
    ends: Sequence[NDArray[np.float64]],
    mapped: Sequence[shapely.LineString | None],
    kept: Sequence[bool] | None = None,
) -> list[Curve]:
    """Return the gentlest way from pose to pose that keeps to the map's way.

    Args:
        ends: x, y, heading (2, 3) where each begins and ends.
        mapped: the map's way from one to the other, if it has one.
        kept: whether that is kept to as it is.
    """
    if not len(ends):
        return []
    poses = np.array(ends)
    found: dict[int, Curve] = {}
    for directness, tolerance in DIRECTNESS:
        left = [k for k in range(len(poses)) if k not in found]
        if not left:
            break
        curves = all_turned(poses[left, 0], poses[left, 1], directness=directness)
        for k, curve in zip(left, curves, strict=True):
            way = mapped[k]
            if way is not None:
                off = KEPT_M if kept and kept[k] else tolerance * (1.0 + 0.1 * way.length)
                if shapely.hausdorff_distance(way, curve.line) > off:
                    continue
            found[k] = curve
    for k in set(range(len(poses))) - set(found):
        way = shapely.get_coordinates(mapped[k])
        found[k] = splined(_calm(way), poses[k, 0, 2], poses[k, 1, 2])
    return [found[k] for k in range(len(poses))]


def _mapped(joint: _Joint, poses: NDArray[np.float64]) -> shapely.LineString:
    """Return netconvert's way from pose to pose."""
    first, last = poses[:, :2]
    return shapely.LineString(
        np.vstack(
            [
                first[None],
                _after(joint.start.lane.centre[:, :2], first),
                *(lane.centre[:, :2] for lane in joint.chain),
                _after(joint.end.lane.centre[::-1, :2], last)[::-1],
                last[None],
            ]
        )
    )


def _after(points: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points of a polyline that come after a place beside it."""
    at = shapely.LineString(points).project(shapely.Point(place))
    along = stations_of_points(points)
    return np.asarray(points[along > at + 0.05])


def _calm(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Thin points that lie closer together than ``SPACING_M``; the ends stay."""
    kept = [points[0]]
    for point in points[1:-1]:
        if min(np.linalg.norm(point - kept[-1]), np.linalg.norm(point - points[-1])) > SPACING_M:
            kept.append(point)
    return np.array([*kept, points[-1]])
