"""Run by the judges' own Python: what CARLA's own library makes of a package's OpenDRIVE.

Reads a job from standard input and answers on standard output, both JSON. Places are in CARLA's
frame: x east, y south, z up, metres.
"""

import json
import math
import sys
import tempfile
from pathlib import Path

import carla

#: From one waypoint to the next, metres.
STEP_M = 2.0


def read(source, spawns):
    """The map as the server, ``make import`` and the Traffic Manager read it."""
    chart = carla.Map("m", Path(source).read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        graph = Path(folder) / "m.bin"
        chart.cook_in_memory_map(str(graph))  # Import.py, build_binary_for_tm
        size = graph.stat().st_size if graph.exists() else 0
    every = chart.generate_waypoints(STEP_M)
    return {
        "traffic_manager_bytes": size,
        "waypoints": [row(w) for w in every],
        "ends": [row(w) for w in every if not w.next(STEP_M)],
        "topology": [[row(a), row(b)] for a, b in chart.get_topology()],
        "crosswalks": [place(corner) for corner in chart.get_crosswalks()],
        "signals": [signal(chart, mark) for mark in chart.get_all_landmarks()],
        "spawns": [spawn(chart, one) for one in spawns],
    }


def spawn(chart, entry):
    """Return the lane at a spawn point, how far beside its middle it is and how it is turned.

    In bends, the waypoint that CARLA finds may be metres further along its lane.
    """
    at, turn = carla.Location(**entry["location"]), carla.Rotation(**entry["rotation"])
    found = chart.get_waypoint(at, project_to_road=True, lane_type=carla.LaneType.Driving)
    if found is None:
        return None
    near = [found]
    for step in range(1, 13):
        near += [*found.next(0.25 * step), *found.previous(0.25 * step)]

    def gap(waypoint):
        there = waypoint.transform.location
        return math.hypot(at.x - there.x, at.y - there.y)

    found = min(near, key=gap)
    yaw = found.transform.rotation.yaw
    return {
        "aside": gap(found),
        "width": found.lane_width,
        "junction": bool(found.is_junction),
        "turned": (turn.yaw - yaw + 180) % 360 - 180,
    }


def place(location):
    """Return x, y, z."""
    return [location.x, location.y, location.z]


def row(waypoint):
    """Return road, lane, station, x, y, z, and whether it is in a junction."""
    where = [waypoint.road_id, waypoint.lane_id, waypoint.s]
    return [*where, *place(waypoint.transform.location), int(waypoint.is_junction)]


def signal(chart, mark):
    """Return a reference to a signal, and the lanes that it names which are not there."""
    lanes = [
        lane
        for first, last in mark.get_lane_validities()
        for lane in range(max(min(first, last), -99), min(max(first, last), 99) + 1)
        if lane
    ]
    there = {lane: chart.get_waypoint_xodr(mark.road_id, lane, mark.s) for lane in lanes}
    return {
        "id": mark.id,
        "type": mark.type,
        "road": mark.road_id,
        "s": mark.s,
        "place": place(mark.transform.location),
        "lanes": {str(lane): w and place(w.transform.location) for lane, w in there.items()},
        "driven": [lane for lane, w in there.items() if w and str(w.lane_type) == "Driving"],
    }


if __name__ == "__main__":
    print(json.dumps(read(**json.load(sys.stdin))))
