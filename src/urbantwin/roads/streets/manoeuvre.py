"""Manoeuvres: connecting roads through junctions, each with its own curve."""

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

#: Edges shorter than this between two junctions become part of one larger junction, metres.
WITHIN_JUNCTION_M = 3.0
#: An edge from such a junction back into it stays a road if at least this length lies outside,
#: metres.
LOOP_M = 30.0
#: Minimum gap between the ends of linked lanes; roads are cut back where it is smaller, metres.
ROOM_M = 3.0
#: The same at a signal, where the stop line should keep its position.
ROOM_AT_SIGNAL_M = 1.0
#: Minimum radius of connecting roads that shift sideways without turning, metres, space permitting.
SHIFT_RADIUS_M = 25.0
#: Lanes whose headings differ by more than this turn instead of shifting sideways, radians.
SHIFT_TURN = 0.35
#: Range of angles of turns at corners, radians, and their minimum radius for motor traffic, metres
#: (turning circles of cars are 10 to 12 m). Roads keep the last length for arrows, metres.
CORNERS, CORNER_RADIUS_M, LEFT_M = (0.6, 2.4), 4.5, 13.0
#: Largest share of an edge that may be cut off at one end.
TRIM_SHARE = 0.25
#: Minimum spacing of the points that a spline passes through, metres: it avoids oscillation.
SPACING_M = 1.5
#: Stages of curve fitting: directness, and the allowed distance from netconvert's path in units of
#: 1 m + 0.1 of its length.
DIRECTNESS = ((1.0, 1.0), (4.0, 1.0), (12.0, 3.0))
#: Allowed distance from paths over junctions of several nodes, metres; prefix of the names of these
#: junctions.
KEPT_M, CLUSTER = 0.3, "cluster_"


@dataclass(frozen=True)
class Route:
    """A movement through a junction: from lane ``start`` over lanes ``via`` to lane ``end``."""

    start: str
    via: tuple[str, ...]
    end: str


@dataclass(frozen=True)
class Topology:
    """Division of a network into roads, connecting roads and junctions.

    Attributes:
        edges: edges that become roads.
        routes: movements between their lanes.
        junction: id of a junction -> id of the junction that represents its group.
        trims: (edge id, ``start`` or ``end``) -> length cut off the edge there, metres.
    """

    edges: tuple[Road, ...]
    routes: tuple[Route, ...]
    junction: Mapping[str, str]
    trims: Mapping[tuple[str, str], float]


@dataclass(frozen=True)
class Manoeuvre:
    """A connecting road: one lane, whose centre line is the reference line.

    Attributes:
        number: id of the road.
        side: id of its lane: -1 where lanes lie to the right of their reference line, else 1.
        route: the movement that it represents.
        junction: id of its junction.
        entry, exit: the streets that it links.
        start, end: the lanes of these streets that it links.
        kind: ``driving``, ``bus`` or ``bicycle``.
        allowed: classes of actors that may use it.
        speed_limit: m/s.
        curve: centre line of its lane, site frame.
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
    """Return which edges of a network become roads, and the movements between their lanes."""
    kind_of = {junction.id: junction.kind for junction in network.junctions}
    border = {name for name, kind in kind_of.items() if kind == "dead_end"}
    within = {
        edge.id
        for edge in network.roads
        if min(lane.length for lane in vehicle_lanes(network, edge)) < WITHIN_JUNCTION_M
        and not {edge.from_junction, edge.to_junction} & border
    }
    group = _groups(network, within)
    # Edges from such a junction back into it are part of it, except long loops outside.
    outline = _outlines(network, group)
    within |= {
        edge.id
        for edge in network.roads
        if edge.from_junction != edge.to_junction
        and group[edge.from_junction] == group[edge.to_junction]
        and _length_outside(network, edge, outline[group[edge.from_junction]]) < LOOP_M
    }
    edges = tuple(edge for edge in network.roads if edge.id not in within)
    edge_of = {name: edge for edge in network.roads for name in edge.lanes}
    routes: dict[tuple[str, str], Route] = {}
    for edge in edges:
        for lane in vehicle_lanes(network, edge):
            for route in _routes(network, lane, within, edge_of):
                routes.setdefault((route.start, route.end), route)
    # Lanes that end without a connection get one.
    every = tuple(routes.values()) + _merges(network, edges, routes, border, group)
    return Topology(edges, every, group, _trims(network, every, edge_of))


def _outlines(network: RoadNetwork, group: Mapping[str, str]) -> dict[str, shapely.Geometry]:
    """Return the convex hull of the junctions of each group."""
    members: dict[str, list[shapely.Geometry]] = defaultdict(list)
    for junction in network.junctions:
        members[group.get(junction.id, junction.id)].append(junction.polygon)
    return {name: shapely.union_all(parts).convex_hull for name, parts in members.items()}


def _length_outside(network: RoadNetwork, edge: Road, outline: shapely.Geometry) -> float:
    """Return the length of an edge outside an outline, metres."""
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
    """Yield the movements from a lane's end to the next lanes of roads, fewest lanes first."""
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
    """Return movements for lanes of motor traffic that end at a junction without a connection.

    They follow the nearest connected lane beside them, else the edge that leaves the junction with
    the smallest change of direction.
    """
    onward: dict[str, list[Route]] = defaultdict(list)
    for route in routes.values():
        onward[route.start].append(route)
    merges = []
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
            merges += [Route(lane.id, (), end) for end in ends[:1]]
    return tuple(merges)


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
        length_m = sum(lane.length for lane in chain)
        length_m = length_m or float(np.linalg.norm(last.centre[0, :2] - first.centre[-1, :2]))
        before, after = edge_of[route.start], edge_of[route.end]
        lacking = max(0.0, max(ROOM_M, _room_to_shift(first, last)) - length_m)
        give = lacking / 2
        if before.id in signalled:
            # The stop line keeps its position; the other side is cut by the remaining length.
            give = max(0.0, ROOM_AT_SIGNAL_M - length_m) / 2
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
    """Return the lengths to cut off the first and the last lane for a turn of sufficient radius."""
    if "bicycle" in (first.kind, last.kind):
        return 0.0, 0.0
    legs = first.centre[-1, :2] - first.centre[-2, :2], last.centre[1, :2] - last.centre[0, :2]
    a, b = (leg / max(float(np.linalg.norm(leg)), 1e-9) for leg in legs)
    across = float(a[0] * b[1] - a[1] * b[0])
    turn = abs(float(np.arctan2(across, a @ b)))
    if not CORNERS[0] < turn < CORNERS[1]:
        return 0.0, 0.0
    # Distances from the ends of the lanes to the intersection of their lines.
    gap = last.centre[0, :2] - first.centre[-1, :2]
    ahead = float(gap[0] * b[1] - gap[1] * b[0]) / across
    backward = float(a[0] * gap[1] - a[1] * gap[0]) / across
    tangent_m = CORNER_RADIUS_M * np.tan(turn / 2)
    spare = (max(0.0, (lane.length - LEFT_M) / 2) for lane in (first, last))
    early, late = (
        min(max(0.0, tangent_m - distance), spare_m)
        for distance, spare_m in zip((ahead, backward), spare, strict=True)
    )
    return float(early), float(late)


def _room_to_shift(first: Lane, last: Lane) -> float:
    """Return the minimum length for a sideways shift between two lanes, metres."""
    legs = first.centre[-1, :2] - first.centre[-2, :2], last.centre[1, :2] - last.centre[0, :2]
    a, b = (leg / max(float(np.linalg.norm(leg)), 1e-9) for leg in legs)
    if a @ b < np.cos(SHIFT_TURN):
        return 0.0
    gap = last.centre[0, :2] - first.centre[-1, :2]
    ahead = (a + b) / np.linalg.norm(a + b)
    offset_m = abs(float(ahead[0] * gap[1] - ahead[1] * gap[0]))
    # Two arcs that join in the middle: offset_m = length^2 / (4 radius).
    return float(np.sqrt(4 * SHIFT_RADIUS_M * offset_m))


def build_manoeuvres(
    network: RoadNetwork,
    streets: tuple[Street, ...],
    topology: Topology,
    *,
    side: int,
    standing: Sequence[shapely.Geometry] = (),
) -> tuple[Manoeuvre, ...]:
    """Return a connecting road for every movement.

    Args:
        network: the network.
        streets: its streets.
        topology: its division into roads and connecting roads.
        side: as in ``build_streets``.
        standing: outlines of static obstacles on the ground, which paths avoid, site frame.
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
    """The streets and strips that a movement links, and netconvert's lanes between them."""

    entry: Street
    start: Strip
    exit: Street
    end: Strip
    chain: list[Lane]

    @property
    def poses(self) -> NDArray[np.float64]:
        """x, y, heading (2, 3) of the start and the end."""
        poses = np.empty((2, 3))
        ends = ((self.entry, self.start, True), (self.exit, self.end, False))
        for pose, (street, strip, leaving) in zip(poses, ends, strict=True):
            x, y, heading = street.curve.at(street.end_of(strip, leaving=leaving))[0]
            pose[:2] = x - strip.t * np.sin(heading), y + strip.t * np.cos(heading)
            pose[2] = heading + (0.0 if strip.forward else np.pi)
        turn = poses[1, 2] - poses[0, 2]
        # Not `wrapped`: the order of rounding keeps the curves of existing twins unchanged.
        poses[1, 2] = poses[0, 2] + (turn + np.pi) % (2 * np.pi) - np.pi
        return poses


def _allowed(start: Lane, end: Lane, chain: list[Lane]) -> tuple[str, ...]:
    """Return the classes that may use all lanes of a movement; if none, those of its first lane."""
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
    """Return the curves of movements; where the map's path is no smooth curve, that path."""
    poses = [joint.poses for joint in joints]
    mapped = [_mapped(x, pose) if x.chain else None for x, pose in zip(joints, poses, strict=True)]
    # Paths over junctions of several nodes are drawn before netconvert, and are kept.
    fixed = [any(lane.junction.startswith(CLUSTER) for lane in joint.chain) for joint in joints]
    curves = gentle_curves(poses, mapped, fixed)
    free = [k for k, joint in enumerate(joints) if not fixed[k] and joint.start.lane.level == 0]
    roads = [(joints[k].start.lane.road, joints[k].end.lane.road) for k in free]
    for number, curve in round_standing([curves[k] for k in free], roads, standing).items():
        curves[free[number]] = curve
    return curves


def gentle_curves(
    ends: Sequence[NDArray[np.float64]],
    mapped: Sequence[shapely.LineString | None],
    kept: Sequence[bool] | None = None,
) -> list[Curve]:
    """Return smooth curves between pairs of poses that stay close to the map's paths.

    Args:
        ends: x, y, heading (2, 3) of each curve's start and end.
        mapped: the map's path between them, if any.
        kept: whether the curve follows that path closely.
    """
    if not len(ends):
        return []
    poses = np.array(ends)
    chosen: dict[int, Curve] = {}
    for directness, tolerance in DIRECTNESS:
        remaining = [k for k in range(len(poses)) if k not in chosen]
        if not remaining:
            break
        curves = all_turned(poses[remaining, 0], poses[remaining, 1], directness=directness)
        for k, curve in zip(remaining, curves, strict=True):
            path = mapped[k]
            if path is not None:
                off = KEPT_M if kept and kept[k] else tolerance * (1.0 + 0.1 * path.length)
                if shapely.hausdorff_distance(path, curve.line) > off:
                    continue
            chosen[k] = curve
    for k in set(range(len(poses))) - set(chosen):
        path = shapely.get_coordinates(mapped[k])
        chosen[k] = splined(_thinned(path), poses[k, 0, 2], poses[k, 1, 2])
    return [chosen[k] for k in range(len(poses))]


def _mapped(joint: _Joint, poses: NDArray[np.float64]) -> shapely.LineString:
    """Return netconvert's path between two poses."""
    first, last = poses[:, :2]
    return shapely.LineString(
        np.vstack(
            [
                first[None],
                _points_beyond(joint.start.lane.centre[:, :2], first),
                *(lane.centre[:, :2] for lane in joint.chain),
                _points_beyond(joint.end.lane.centre[::-1, :2], last)[::-1],
                last[None],
            ]
        )
    )


def _points_beyond(points: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points of a polyline beyond the projection of a place."""
    station_m = shapely.LineString(points).project(shapely.Point(place))
    along = stations_of_points(points)
    return np.asarray(points[along > station_m + 0.05])


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Remove points closer together than ``SPACING_M``; the ends stay."""
    spaced = [points[0]]
    for point in points[1:-1]:
        if min(np.linalg.norm(point - spaced[-1]), np.linalg.norm(point - points[-1])) > SPACING_M:
            spaced.append(point)
    return np.array([*spaced, points[-1]])
