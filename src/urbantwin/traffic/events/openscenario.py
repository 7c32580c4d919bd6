"""ASAM OpenSCENARIO XML as a scenario: objects that follow trajectories are inserted."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from urbantwin.errors import InputError
from urbantwin.taxonomy import BOX_SEMANTICS
from urbantwin.traffic.assets import asset
from urbantwin.traffic.recorded.description import TracksSpec, class_of
from urbantwin.traffic.recorded.formats import openscenario_rows

__all__ = ["TRAFFIC_STORY", "openscenario_events"]

#: Objects of the story with this name are the exported motion's traffic, not events.
TRAFFIC_STORY = "traffic"


def openscenario_events(path: Path, until_s: float) -> list[dict[str, Any]]:
    """Return an event ``trajectory`` for each object that a file moves outside of the traffic.

    Args:
        path: the ``.xosc``; positions are in the site frame.
        until_s: duration of the motion, seconds.

    Raises:
        InputError: it is no such file, or has no such object; the message names the line.
    """
    rows = openscenario_rows(path, TracksSpec(tracks=path.name), without_story=TRAFFIC_STORY)
    bodies = _bodies(path)
    by_object: dict[str, list[int]] = defaultdict(list)
    for number, name in enumerate(rows.track.tolist()):
        by_object[name].append(number)
    events = []
    for name, rows_of_object in by_object.items():
        kind = str(rows.kind[rows_of_object[0]])
        actor = kind if kind in BOX_SEMANTICS else class_of(kind)
        if actor not in BOX_SEMANTICS:
            raise rows.error(
                rows_of_object[0], f"{name[:40]!r} is of no class that is known: {kind[:40]!r}"
            )
        times = rows.time_s[rows_of_object]
        if (np.diff(times) <= 0).any():
            row = rows_of_object[int(np.argmax(np.diff(times) <= 0)) + 1]
            raise rows.error(row, f"time does not go on for {name[:40]!r}", "later times")
        if not 0 <= times[0] < until_s:
            expected = f"0 to less than {until_s:g} s, the motion"
            raise rows.error(rows_of_object[0], f"{name[:40]!r} begins at {times[0]:g} s", expected)
        event: dict[str, Any] = {
            "event": "trajectory",
            "at_s": float(times[0]),
            "name": name,
            "actor": actor,
            "time_s": times.tolist(),
            "x": rows.xyz[rows_of_object, 0].tolist(),
            "y": rows.xyz[rows_of_object, 1].tolist(),
        }
        if np.isfinite(rows.yaw[rows_of_object]).all():
            event["yaw_deg"] = np.round(np.degrees(rows.yaw[rows_of_object]), 6).tolist()
        if _is_asset(bodies.get(name, ""), actor):
            event["asset"] = bodies[name]
        events.append(event)
    return events


def _is_asset(name: str, actor: str) -> bool:
    try:
        return asset(name).actor_class == actor
    except InputError:
        return False


def _bodies(path: Path) -> dict[str, str]:
    """Return the name of each object's model."""
    root = etree.parse(path, etree.XMLParser(resolve_entities=False, no_network=True)).getroot()
    return {
        str(element.get("name")): str(body.get("name"))
        for element in root.iterfind("Entities/ScenarioObject")
        for body in element.iterchildren("Vehicle", "Pedestrian", "MiscObject")
    }
