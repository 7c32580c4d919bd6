"""Says what CARLA's own library makes of an OpenDRIVE: run as a program, never imported.

Its Python needs the package ``carla``. A map that CARLA trips over ends its process; here it ends
only this one. Its arguments are the ``.xodr``, the map's name, a file of spawn points and a
folder, where CARLA writes, and the answer is ``answer.json``. Places are in CARLA's frame: x east,
y south, z up, metres.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

#: From one waypoint to the next, metres.
STEP_M = 2.0


def main(source: str, name: str, spawns: str, folder: str) -> dict[str, Any]:
    """Read the map as the server, ``make import`` and the Traffic Manager do."""
    import carla

    chart = carla.Map(name, Path(source).read_text(encoding="utf-8"))
    graph = Path(folder) / f"{name}.bin"
    chart.cook_in_memory_map(str(graph))  # Import.py, build_binary_for_tm
    every = chart.generate_waypoints(STEP_M)
    return {
        "traffic_manager_bytes": graph.stat().st_size if graph.exists() else 0,
        "waypoints": [row(w) for w in every],
        "ends": [row(w) for w in every if not w.next(STEP_M)],
        "topology": [[row(a), row(b)] for a, b in chart.get_topology()],
        "crosswalks": [place(corner) for corner in chart.get_crosswalks()],
        "signals": [signal(chart, mark) for mark in chart.get_all_landmarks()],
        "spawns": [
            spawn(carla, chart, one) for one in json.loads(Path(spawns).read_text(encoding="utf-8"))
        ],
    }


def spawn(carla: Any, chart: Any, entry: dict[str, Any]) -> dict[str, Any] | None:  # noqa: ANN401
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

    def gap(waypoint: Any) -> float:  # noqa: ANN401
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


def place(location: Any) -> list[float]:  # noqa: ANN401 - carla has no types
    """Return x, y, z."""
    return [location.x, location.y, location.z]


def row(waypoint: Any) -> list[float]:  # noqa: ANN401
    """Return road, lane, station, x, y, z, and whether it is in a junction."""
    where = [waypoint.road_id, waypoint.lane_id, waypoint.s]
    return [*where, *place(waypoint.transform.location), int(waypoint.is_junction)]


def signal(chart: Any, mark: Any) -> dict[str, Any]:  # noqa: ANN401
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
    answer = main(*sys.argv[1:])
    Path(sys.argv[-1], "answer.json").write_text(json.dumps(answer), encoding="utf-8")
