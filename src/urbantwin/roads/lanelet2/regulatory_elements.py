"""Signals and signs of regulatory elements, and the controllers of signals."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.number_text import finite_number
from urbantwin.roads.lanelet2.document import Relation
from urbantwin.roads.lanelet2.markings import BuiltMap, Host
from urbantwin.roads.lanelet2.traffic_rules import speed_of
from urbantwin.roads.model import RoadSignal, SignalController

__all__ = ["POSTED", "controllers_of", "sign_ways", "signals_of"]

#: Types of signals in OpenDRIVE's own catalogue: three lights for vehicles, two for pedestrians.
VEHICLE_LIGHTS, WALKER_LIGHTS = "1000001", "1000002"
#: Default height of their centres above the road, metres (US MUTCD 4D.15).
LIGHTS_M = {VEHICLE_LIGHTS: 5.0, WALKER_LIGHTS: 2.2}
#: Default height of a sign's centre, metres (German VzKat: lower edge at 2.0 to 2.25 m).
SIGN_M = 2.5
#: Signals moved by more than this to the end of their road are counted, metres.
BEYOND_M = 1.0
#: Subtypes of regulatory elements that refer to lights or signs; others refer to areas.
POSTED = ("traffic_light", "traffic_sign", "speed_limit", "right_of_way", "all_way_stop")
#: Subtypes of a way that are pedestrian lights.
WALKER_SUBTYPES = {"red_green", "white"}
_SIGN = re.compile(r"^([a-z]{2})\s*([0-9]+(?:\.[0-9]+)?)(?:-([0-9]+))?$", re.IGNORECASE)


def sign_ways(relation: Relation) -> list[int]:
    """Return the ways of a regulatory element that are lights or signs."""
    return relation.of_role("refers") if relation.tags.get("subtype") in POSTED else []


def signals_of(built: BuiltMap, first: int, notes: dict[str, object]) -> tuple[RoadSignal, ...]:
    """Return a signal for each light or sign and each street that it applies to.

    A signal has its mapped position. If that is beyond the end of its street, as for lights on the
    far side of a junction, it is moved back to that end.

    Args:
        built: the map and its streets.
        first: the first free id.
        notes: receives the counts of moved signals and of those without a street.
    """
    document, hosts = built.document, built.hosts
    items: list[RoadSignal] = []
    without_street = moved_back = 0
    for identity, relation in sorted(document.relations.items()):
        subtype = relation.tags.get("subtype", "")
        if relation.tags.get("type") != "regulatory_element" or not sign_ways(relation):
            continue
        lanes: dict[int, list[int]] = {}
        walkers = False
        for i in built.governed.get(identity, []):
            walkers |= built.lanelets[i].kind in ("crosswalk", "sidewalk")
            for road, lane in built.approaches.get(i, ()):
                lanes.setdefault(road, []).append(lane)
        for way_id in sign_ways(relation):
            points = np.array([built.places[n] for n in document.ways[way_id].nodes])
            place = points.mean(axis=0)
            tags = document.ways[way_id].tags
            if walkers and not lanes:
                point = shapely.Point(place[:2])
                nearest = min(
                    hosts.values(), key=lambda h: float(h.area.distance(point)), default=None
                )
                rows: Iterable[tuple[int, list[int]]] = [(nearest.road.id, [])] if nearest else []
            else:
                rows = lanes.items()
            without_street += not rows
            for road, ids in rows:
                host = hosts[road]
                moved_back += _distance_beyond(host, place) > BEYOND_M
                items.append(
                    _signal(first + len(items), identity, subtype, relation, tags, place, host, ids)
                )
    if without_street:
        notes["lights_and_signs_without_a_street"] = without_street
    if moved_back:
        notes["lights_and_signs_moved_back_to_the_end_of_their_street"] = moved_back
    return tuple(items)


def controllers_of(
    signals: Sequence[RoadSignal], hosts: Mapping[int, Host], first: int
) -> tuple[tuple[RoadSignal, ...], tuple[SignalController, ...]]:
    """Return the signals with their programs, and one controller per junction with lights.

    The map assigns lights to lanes but has no timing: programs have no phases.
    """
    junction_of: dict[int, int] = {}
    for signal in signals:
        if signal.dynamic:
            road = hosts[signal.road].road
            ahead = signal.s >= road.length / 2 if not signal.lanes else signal.orientation == "+"
            link = road.successor if ahead else road.predecessor
            junction_of[signal.id] = link.id if link and link.element == "junction" else -1
    numbered = tuple(
        replace(signal, program=_program(junction_of[signal.id], signal))
        if signal.id in junction_of
        else signal
        for signal in signals
    )
    programs: dict[str, list[RoadSignal]] = {}
    for signal in numbered:
        if signal.dynamic:
            programs.setdefault(signal.program, []).append(signal)
    return numbered, tuple(
        SignalController(
            first + k,
            name,
            tuple(signal.id for signal in rows),
            tuple(sorted({junction_of[signal.id] for signal in rows} - {-1})),
        )
        for k, (name, rows) in enumerate(programs.items())
    )


def _program(junction: int, signal: RoadSignal) -> str:
    return f"junction {junction}" if junction >= 0 else f"road {signal.road}"


def _distance_beyond(host: Host, place: NDArray[np.float64]) -> float:
    """Return the distance of a point beyond the ends of a street, metres."""
    s = float(host.road.curve.locate(place[None, :2])[0][0])
    return max(-s, s - host.road.length, 0.0)


def _signal(
    number: int,
    identity: int,
    subtype: str,
    relation: Relation,
    tags: Mapping[str, str],
    place: NDArray[np.float64],
    host: Host,
    lanes: Sequence[int],
) -> RoadSignal:
    road = host.road
    s, t = (float(v[0]) for v in road.curve.locate(place[None, :2]))
    s = min(max(s, 0.0), road.length)
    tall = _number(tags.get("height"))
    above = float(place[2]) + tall / 2 - float(road.heights(s, t)[0])
    forward = {
        lane.forward for section in road.sections for lane in section.lanes if lane.id in lanes
    }
    if subtype == "traffic_light":
        kind = VEHICLE_LIGHTS if lanes else WALKER_LIGHTS
        if tags.get("subtype") in WALKER_SUBTYPES and not lanes:
            kind = WALKER_LIGHTS
        catalogue = ("OpenDRIVE", kind, "-1", math.nan, "")
        default_m = LIGHTS_M[kind]
    else:
        catalogue = _catalogue(tags.get("subtype", "") or relation.tags.get("sign_type", ""))
        default_m = SIGN_M
    country, code, sub, value, unit = catalogue
    return RoadSignal(
        number,
        road.id,
        f"regulatory element {identity}",
        subtype == "traffic_light",
        country,
        code,
        sub,
        value,
        unit,
        s,
        t,
        above if above > 1.0 else default_m,
        "none" if len(forward) != 1 else "+" if forward == {True} else "-",
        tuple(sorted(set(lanes))),
        height=tall or 0.9,
    )


def _catalogue(text: str) -> tuple[str, str, str, float, str]:
    """Return country, type, subtype, value and unit of a sign such as ``de274-60``."""
    match = _SIGN.match(text.strip())
    if not match:
        speed = speed_of([text])
        if speed is not None:
            return "OpenDRIVE", "274", "-1", round(speed * 3.6, 3), "km/h"
        return "OpenDRIVE", text or "-1", "-1", math.nan, ""
    country, code, sub = match[1].upper(), match[2], match[3] or "-1"
    if country == "DE" and code == "274" and sub != "-1":
        return country, code, sub, float(sub), "km/h"
    return country, code, sub, math.nan, ""


def _number(text: str | None) -> float:
    return max(finite_number(text) or 0.0, 0.0)
