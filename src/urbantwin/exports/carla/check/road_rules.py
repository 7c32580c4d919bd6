"""What the server, the Traffic Manager and its signals ask of the OpenDRIVE."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from typing import Any

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

from urbantwin.exports.carla.check.finding import NoCarlaError, Problems
from urbantwin.exports.carla.check.read import Package
from urbantwin.roads.opendrive.writing.carla import PLATES

__all__ = [
    "by_changing",
    "heights",
    "lanes",
    "on_mesh",
    "signal_lanes",
    "signals",
    "spawn_points",
    "stages",
    "stop_places",
]

#: ``carla/road/SignalType.cpp``: what is a traffic light.
LIGHTS = {f"10000{k:02d}" for k in (1, 2, *range(7, 21))} | {"F", "W", "A"}
#: What stands for itself: yield, stop, maximum speed (``TrafficLightManager.cpp``).
SIGNS = {"205", "206", "274"}
WALKERS = "1000002"
#: A lane's waypoint this far beside the carriageway, or above it, is beside it, metres.
BESIDE_M, ABOVE_M = 0.05, 0.5
#: From the stop line to the place that stops vehicles, metres.
STOP_M = 1.0


def lanes(package: Package) -> Problems:
    """CARLA's map: ways on and to everywhere, and a graph for the Traffic Manager."""
    answer = _answer(package)
    if not answer["traffic_manager_bytes"]:
        yield "the Traffic Manager's graph is empty"
    if not answer["waypoints"]:
        yield "it has no lane to drive on"
    joined = _joined(package.roads)
    for road, lane, s, *_ in answer["ends"]:
        if (road, lane < 0) in joined:
            yield f"lane {lane:.0f} of road {road:.0f} ends at {s:.1f} m, inside the map"
    alone = _alone(package)
    driven = {(road, lane) for road, lane, *_ in answer["waypoints"]}
    for road, forward in sorted({(road, lane < 0) for road, lane in alone}):
        if {lane for there, lane in driven if there == road and (lane < 0) == forward} <= {
            lane for there, lane in alone if there == road
        }:
            yield f"no way leads to road {road:.0f}, {'along' if forward else 'against'} its line"


def by_changing(package: Package) -> Problems:
    """Lanes that one comes to from the lane beside alone."""
    alone = _alone(package)
    if alone:
        yield f"{len(alone)} lanes are reached from the lane beside alone"


def _joined(root: etree._Element) -> set[tuple[int, bool]]:
    """Return the ends of roads that something is joined to: id, and whether it is the last."""
    return {
        (int(road.get("id")), tag == "successor")
        for road in root.iterfind("road")
        for tag in ("predecessor", "successor")
        if road.find(f"link/{tag}") is not None
    }


def _alone(package: Package) -> set[tuple[float, float]]:
    """Return the roads and lanes that no lane leads to, though they begin inside the map."""
    answer, joined = _answer(package), _joined(package.roads)
    reached = {(to[0], to[1]) for _, to in answer["topology"]}
    driven = {(road, lane) for road, lane, *_ in answer["waypoints"]}
    return {(road, lane) for road, lane in driven - reached if (road, lane > 0) in joined}


def on_mesh(package: Package) -> Problems:
    """Waypoints over the carriageway of the mesh: same frame, same unit, same roads."""
    over = _over(package)
    beside = np.isnan(over).sum()
    if beside:
        yield f"{beside} of {len(over)} waypoints are more than {BESIDE_M} m beside the carriageway"
    wrong = int((np.abs(over) > ABOVE_M).sum())
    if wrong:
        yield f"{wrong} of {len(over)} waypoints are more than {ABOVE_M} m above or below it"


def heights(package: Package) -> Problems:
    """How far waypoints are over the mesh: CARLA knows a road's middle line, and no cross-fall."""
    over = np.abs(_over(package))
    over = over[np.isfinite(over)]
    if len(over):
        near = 100.0 * float((over < BESIDE_M).mean())
        yield f"{near:.0f} % are within 5 cm of the mesh, all within {over.max():.2f} m"


def signal_lanes(package: Package) -> Problems:
    """Lanes of signals: there, and of vehicles only where the signal is for them."""
    for one in _answer(package)["signals"]:
        gone = [lane for lane, place in one["lanes"].items() if place is None]
        if gone:
            yield f"signal {one['id']} holds for lane {gone[0]} of road {one['road']}, not there"
        if one["type"] == WALKERS and one["driven"]:
            yield f"signal {one['id']}, for people on foot, stops vehicles of road {one['road']}"


def signals(package: Package) -> Problems:
    """Signals: types that CARLA knows, lanes of that direction, plates that it has."""
    for road in package.roads.iterfind("road"):
        for item in (*road.iterfind("signals/signal"), *road.iterfind("signals/signalReference")):
            name, facing = item.get("id"), item.get("orientation")
            if item.tag == "signal":
                kind = item.get("type")
                if kind not in LIGHTS | SIGNS:
                    yield f"signal {name} is of type {kind}, which CARLA does not know"
                if kind == "274" and not float(item.get("value") or 0) > 0:
                    yield f"signal {name} is a speed limit without a speed"
                if kind == "274" and item.get("subtype") not in map(str, PLATES):
                    yield f"signal {name} is a speed limit of which CARLA has no plate"
            held = [
                int(str(one.get(key)))
                for one in item.findall("validity")
                for key in ("fromLane", "toLane")
            ]
            if not held:
                yield f"signal {name} names no lanes: CARLA would take those of the other direction"
            elif (facing == "+" and max(held) > 0) or (facing == "-" and min(held) < 0):
                yield f"signal {name} faces {facing}, but holds for lanes of the other direction"


def stages(package: Package) -> Problems:
    """Controllers: one is green at a time, so each has the signals of one stage."""
    signal = {e.get("id"): e for e in package.roads.iter("signal")}
    control = {
        one.get("id"): [c.get("signalId") for c in one.iterfind("control")]
        for one in package.roads.iterfind("controller")
    }
    named = {
        junction.get("id"): [e.get("id") for e in junction.iterfind("controller")]
        for junction in package.roads.iterfind("junction")
    }
    yield from _at_once(package.roads, named, control)
    for junction, some in named.items():
        for one in some:
            if one not in control:
                yield f"junction {junction} names controller {one}, which does not exist"
    counted = Counter(one for some in control.values() for one in some)
    for one, some in control.items():
        for name in some:
            if name not in signal:
                yield f"controller {one} switches signal {name}, which does not exist"
        if not any(one in others for others in named.values()):
            yield f"controller {one} is of no junction: its signals stay as they are"
    for name, count in counted.items():
        if count > 1:
            yield f"signal {name} is of {count} controllers, of which CARLA takes one"
    for name, item in signal.items():
        if item.get("type") in LIGHTS and name not in counted:
            yield f"signal {name} is of no controller: CARLA switches it alone"


def _at_once(
    root: etree._Element,
    named: Mapping[str | None, list[str | None]],
    control: Mapping[str | None, list[str | None]],
) -> Problems:
    """Junctions that give green to three roads and more at once."""
    at = _held_roads(root)
    for junction, some in named.items():
        roads = {road for one in some for name in control.get(one, ()) for road in at[str(name)]}
        if len(some) == 1 and len(roads) > 2:
            yield f"junction {junction} has one controller for {len(roads)} roads: green at once"


def stop_places(package: Package) -> Problems:
    """Where lights stop vehicles: at the stop line, if there is one."""
    lines: dict[str, list[float]] = defaultdict(list)
    length, inner = {}, set()
    for road in package.roads.iterfind("road"):
        key = road.get("id")
        length[key] = float(road.get("length"))
        if road.get("junction") != "-1":
            inner.add(key)
        lines[key] = [
            float(e.get("s"))
            for e in road.iterfind("objects/object")
            if e.get("name") == "StopLine"
        ]
    for one in _answer(package)["signals"]:
        if one["type"] not in LIGHTS or not one["driven"]:
            continue
        key, s = str(one["road"]), float(one["s"])
        near = min((abs(s - line) for line in lines[key]), default=None)
        end = min(length[key] - s if lane < 0 else s for lane in one["driven"])
        if key in inner:
            yield f"signal {one['id']} stops vehicles inside a junction, on road {key}"
        elif near is not None and near > STOP_M:
            yield f"signal {one['id']} stops vehicles {near:.1f} m from the stop line of road {key}"
        elif near is None and end > 15.0:
            yield f"signal {one['id']} stops vehicles {end:.1f} m before road {key} ends"


def spawn_points(package: Package) -> Problems:
    """Spawn points: on a driving lane outside junctions, in its direction."""
    for number, found in enumerate(_answer(package)["spawns"]):
        if found is None or found["aside"] > found["width"] / 2:
            yield f"spawn point {number} is on no lane to drive on"
        elif found["junction"]:
            yield f"spawn point {number} is in a junction"
        elif found["aside"] > 0.5 or abs(found["turned"]) > 10.0:
            yield f"spawn point {number} is {found['aside']:.1f} m beside the middle of its lane"


def _answer(package: Package) -> dict[str, Any]:
    if package.carla is None:
        raise NoCarlaError
    return package.carla


def _held_roads(root: etree._Element) -> dict[str, set[str]]:
    """Return the roads whose vehicles each signal is for."""
    found: dict[str, set[str]] = defaultdict(set)
    for road in root.iterfind("road"):
        for item in (*road.iterfind("signals/signal"), *road.iterfind("signals/signalReference")):
            ends = [(one.get("fromLane"), one.get("toLane")) for one in item.findall("validity")]
            if any(pair != ("0", "0") for pair in ends):
                found[str(item.get("id"))].add(str(road.get("id")))
    return found


def _over(package: Package) -> NDArray[np.float64]:
    """Return how far waypoints are over the nearest carriageway; nan beside it."""
    points = np.array(_answer(package)["waypoints"], np.float64).reshape(-1, 7)[:, 3:6] * [1, -1, 1]
    corners = package.mesh.of("Road_Road")
    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    level = normal[:, 2] > 1e-6
    a, normal = a[level], normal[level]
    tree = shapely.STRtree(shapely.polygons(corners[level][:, :, :2]))
    places = shapely.points(points[:, :2])
    point, face = tree.query(places, predicate="dwithin", distance=BESIDE_M)
    gap = points[point, :2] - a[face, :2]
    plane = a[face, 2] - (gap * normal[face, :2]).sum(axis=1) / normal[face, 2]
    over = points[point, 2] - plane
    found = np.full(len(points), np.nan)
    order = np.argsort(-np.abs(over), kind="stable")
    found[point[order]] = over[order]
    return found
