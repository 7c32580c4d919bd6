"""A motion as ASAM OpenSCENARIO XML 1.3: each actor follows its trajectory, each event is a story.

Elements and their order: the schema of ASAM OpenSCENARIO XML 1.3.0.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from urbantwin import __version__
from urbantwin.artefact import replaced_file
from urbantwin.taxonomy import OBSTACLE
from urbantwin.traffic import Motion
from urbantwin.traffic.events.openscenario import TRAFFIC_STORY

__all__ = ["write_openscenario"]

#: vehicleCategory of a class, and its approximate mass, kg.
_VEHICLES = {
    "car": ("car", 1500),
    "van": ("van", 2200),
    "truck": ("truck", 12000),
    "bus": ("bus", 12000),
    "trailer": ("trailer", 8000),
    "tram": ("tram", 40000),
    "motorcycle": ("motorbike", 250),
    "bicycle": ("bicycle", 90),
}
_PLACES = 4  # a tenth of a millimetre, and of a milliradian
#: A fixed date, so that files do not depend on the time of writing.
_DATE = "2000-01-01T00:00:00"


def write_openscenario(motion: Motion, path: Path, *, road_file: str | None = None) -> None:
    """Write a motion: positions in the site's frame, which is that of the exported OpenDRIVE.

    The origin of an object is the centre of its box on the ground. Actors inserted for an event are
    in its story (``near_miss 2 at 15 s``); all others, which also react to events, are in the story
    ``traffic``, whose acts of an event's actors have its name.

    Args:
        motion: the motion.
        path: the ``.xosc`` to write.
        road_file: name of the twin's OpenDRIVE file; omitted if not given.
    """
    root = etree.Element("OpenSCENARIO")
    header = {"revMajor": "1", "revMinor": "3", "date": _DATE}
    words = f"traffic of {motion.manifest['duration_s']:g} s, seed {motion.manifest['seed']}"
    _add(root, "FileHeader", **header, description=words, author=f"UrbanTwin {__version__}")
    _add(root, "CatalogLocations")
    network = _add(root, "RoadNetwork")
    if road_file is not None:
        _add(network, "LogicFile", filepath=road_file)
    tracks = _tracks(motion)
    entities = _add(root, "Entities")
    for track, rows in tracks.items():
        _entity(entities, _name(track), rows)
    board = _add(root, "Storyboard")
    actions = _add(_add(board, "Init"), "Actions")
    for track, rows in tracks.items():
        private = _add(actions, "Private", entityRef=_name(track))
        action = _add(_add(private, "PrivateAction"), "TeleportAction")
        _position(action, rows, 0)
    stories, others = _stories(motion, tracks)
    for name, members in stories.items():
        story = _add(board, "Story", name=name)
        for track in members:
            _act(story, f"{name}, {_name(track)}", track, tracks[track])
    # Actors with a single step, and parked ones, stay where `Init` put them.
    moving = {track: name for track, name in others.items() if len(tracks[track]["time_s"]) > 1}
    if moving:
        story = _add(board, "Story", name=TRAFFIC_STORY)
        for track, name in moving.items():
            _act(story, name, track, tracks[track])
    end = _add(_add(_add(board, "StopTrigger"), "ConditionGroup"), "Condition")
    _timed(end, "end", float(motion.manifest["duration_s"]))
    with replaced_file(path, kind="openscenario") as scratch:
        etree.ElementTree(root).write(
            str(scratch), encoding="utf-8", xml_declaration=True, pretty_print=True
        )


def _tracks(motion: Motion) -> dict[int, dict[str, Any]]:
    """Return the columns of each track in order of time; parked vehicles have one row."""
    table = motion.actors
    columns = {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}
    order = np.lexsort([columns["time_s"], columns["track"]])
    columns = {name: values[order] for name, values in columns.items()}
    found, first = np.unique(columns["track"], return_index=True)
    ends = np.append(first[1:], len(order))
    tracks = {
        int(track): {name: values[a:b] for name, values in columns.items()}
        for track, a, b in zip(found, first, ends, strict=True)
    }
    for row in motion.parked.to_pylist():
        tracks[int(row["track"])] = {name: np.array([value]) for name, value in row.items()}
    return tracks


def _stories(
    motion: Motion, tracks: Mapping[int, Any]
) -> tuple[dict[str, list[int]], dict[int, str]]:
    """Return the tracks of each event that inserted actors, and the acts of all others."""
    put_in = {row["track"] for row in motion.manifest.get("inserted", ())}
    stories: dict[str, list[int]] = {}
    told: dict[int, str] = {}
    for number, row in enumerate(motion.manifest.get("events", ()), 1):
        name = f"{row['event']} {number} at {row['from_s']:g} s"
        mine = [track for track in row["tracks"] if track in tracks]
        members = [track for track in mine if track in put_in]
        if members:
            stories[name] = members
        told |= {track: f"{name}, {_name(track)}" for track in mine if track not in put_in}
    taken = {track for members in stories.values() for track in members}
    return stories, {track: told.get(track, _name(track)) for track in tracks if track not in taken}


def _entity(entities: etree._Element, name: str, rows: Mapping[str, Any]) -> None:
    thing = _add(entities, "ScenarioObject", name=name)
    kind = str(rows["class"][0])
    size = {side: _text(float(rows[side].max())) for side in ("width", "length", "height")}

    def box(parent: etree._Element) -> None:
        bounds = _add(parent, "BoundingBox")
        _add(bounds, "Center", x="0", y="0", z=_text(float(rows["height"].max()) / 2))
        _add(bounds, "Dimensions", **size)

    asset = str(rows["asset"][0])
    if kind in ("pedestrian", "animal"):
        body = _add(thing, "Pedestrian", name=asset, mass="75", pedestrianCategory=kind)
        box(body)
    elif kind == OBSTACLE:
        body = _add(thing, "MiscObject", name=asset, mass="10", miscObjectCategory="obstacle")
        box(body)
    else:
        category, mass = _VEHICLES[kind]
        body = _add(thing, "Vehicle", name=asset, vehicleCategory=category, mass=str(mass))
        box(body)
        _add(body, "Performance", maxSpeed="60", maxAcceleration="9.8", maxDeceleration="9.8")
        axles = _add(body, "Axles")
        half = float(rows["length"].max()) * 0.3
        wheel = {"wheelDiameter": "0.6", "trackWidth": _text(0.8 * float(rows["width"].max()))}
        for tag, x, steering in (("FrontAxle", half, "0.6"), ("RearAxle", -half, "0")):
            _add(axles, tag, maxSteering=steering, positionX=_text(x), positionZ="0.3", **wheel)
    _add(body, "Properties")


def _act(story: etree._Element, name: str, track: int, rows: Mapping[str, Any]) -> None:
    """Add an act in which a track follows its trajectory."""
    act = _add(story, "Act", name=name)
    group = _add(act, "ManeuverGroup", maximumExecutionCount="1", name=f"group of {name}")
    actors = _add(group, "Actors", selectTriggeringEntities="false")
    _add(actors, "EntityRef", entityRef=_name(track))
    event = _add(_add(group, "Maneuver", name=f"maneuver of {name}"), "Event")
    event.set("name", f"event of {name}")
    event.set("priority", "override")
    action = _add(event, "Action", name=f"action of {name}")
    follows = _add(_add(_add(action, "PrivateAction"), "RoutingAction"), "FollowTrajectoryAction")
    reference = _add(follows, "TrajectoryRef")
    line = _add(reference, "Trajectory", name=f"trajectory of {name}", closed="false")
    polyline = _add(_add(line, "Shape"), "Polyline")
    for number, time_s in enumerate(rows["time_s"].tolist()):
        _position(_add(polyline, "Vertex", time=_text(time_s)), rows, number)
    timing = _add(follows, "TimeReference")
    _add(timing, "Timing", domainAbsoluteRelative="absolute", scale="1", offset="0")
    _add(follows, "TrajectoryFollowingMode", followingMode="position")
    begins = float(rows["time_s"][0])
    for parent in (event, act):
        trigger = _add(_add(parent, "StartTrigger"), "ConditionGroup")
        _timed(_add(trigger, "Condition"), f"{parent.tag} of {name}", begins)


def _timed(condition: etree._Element, name: str, time_s: float) -> None:
    condition.set("name", name)
    condition.set("delay", "0")
    condition.set("conditionEdge", "none")
    rule = {"value": _text(time_s), "rule": "greaterOrEqual"}
    _add(_add(condition, "ByValueCondition"), "SimulationTimeCondition", **rule)


def _position(parent: etree._Element, rows: Mapping[str, Any], number: int) -> None:
    place = {axis: _text(float(rows[axis][number])) for axis in ("x", "y", "z")}
    turn = {"h": "yaw", "p": "pitch", "r": "roll"}
    angles = {short: _text(float(rows[name][number])) for short, name in turn.items()}
    _add(_add(parent, "Position"), "WorldPosition", **place, **angles)


def _name(track: int) -> str:
    return f"track-{track}"


def _add(parent: etree._Element, tag: str, **attributes: str) -> etree._Element:
    return etree.SubElement(parent, tag, attributes)


def _text(value: float) -> str:
    return f"{round(value, _PLACES) + 0.0:.10g}"
