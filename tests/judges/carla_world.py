"""Run by the judges' own Python, which has CARLA: what its classes make of a package.

Reads a job from standard input and answers on standard output, both JSON.
"""

import json
import math
import sys
from pathlib import Path

import carla


def placed(entry):
    return carla.Transform(carla.Location(**entry["location"]), carla.Rotation(**entry["rotation"]))


def transformed(job):
    """Where CARLA's own transforms take points."""
    answers = []
    for entry in job["transforms"]:
        transform = placed(entry)
        points = [transform.transform(carla.Location(*point)) for point in entry["points"]]
        answers.append([[p.x, p.y, p.z] for p in points])
    return answers


def on_map(job):
    """What lane CARLA's map has at each spawn point, and how far its middle is."""
    chart = carla.Map("map", Path(job["xodr"]).read_text(encoding="utf-8"))
    answers = []
    for entry in job["points"]:
        at = placed(entry)
        found = chart.get_waypoint(at.location, project_to_road=False, lane_type=carla.LaneType.Any)
        if found is None:
            answers.append(None)
            continue
        there = found.transform
        gap, yaw = at.location - there.location, math.radians(there.rotation.yaw)
        answers.append(
            {
                "type": str(found.lane_type),
                "junction": found.is_junction,
                "aside": gap.y * math.cos(yaw) - gap.x * math.sin(yaw),
                "above": at.location.z - there.location.z,
                "turned": (at.rotation.yaw - there.rotation.yaw + 180) % 360 - 180,
                "width": found.lane_width,
            }
        )
    return answers


def waypoints(job):
    """Places all over the lanes, in CARLA's frame."""
    chart = carla.Map("map", Path(job["xodr"]).read_text(encoding="utf-8"))
    found = chart.generate_waypoints(2.0)
    rows = [w.transform.location for w in found if w.lane_type == carla.LaneType.Driving]
    return [[p.x, p.y, p.z] for p in rows]


def missing(job):
    """Members that CARLA's classes do not have."""
    return [
        f"{name}.{member}"
        for name, members in job["members"].items()
        for member in members
        if not hasattr(getattr(carla, name), member)
    ]


if __name__ == "__main__":
    task = json.load(sys.stdin)
    print(
        json.dumps(
            {
                "transformed": transformed,
                "on_map": on_map,
                "waypoints": waypoints,
                "missing": missing,
            }[task["task"]](task)
        )
    )
