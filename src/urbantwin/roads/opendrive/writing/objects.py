"""Objects, signals and controllers of roads.

The standard knows which signals are switched together, not when. Programs are written as
``userData`` of a controller. ``code="offset"`` is the delay of the program's start in seconds.
``code="phases"`` lists its phases, separated by ``", "``, each as seconds, a space, and one letter
per link in SUMO's alphabet: ``G`` and ``g`` green, ``y`` amber, ``r`` red, ``s`` stop and go, ``u``
red with amber, ``o`` and ``O`` off. ``userData`` ``code="links"`` of a signal lists the indices of
its letters. ``userData`` ``code="marking"`` of a crosswalk is its marking (``CROSSING_MARKINGS``):
the standard's ``markings`` only support lines along a border.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
from lxml import etree

from urbantwin.geometry import wrapped
from urbantwin.roads.model import LaneModel, ModelRoad, RoadArea, RoadSignal, SignalController
from urbantwin.roads.opendrive.writing.carla import CARRIER_M, carrier
from urbantwin.roads.opendrive.writing.number_format import number, numbers, xml_text
from urbantwin.roads.signals import pose_of

__all__ = ["with_signal_references", "write_controller", "write_objects", "write_signals"]

#: ``validity`` of a signal that applies to no lane of its road.
NO_LANE = (0,)
#: Maximum distance of a signal from the road that it is placed beside, metres.
NEAR_M = 60.0
#: A signal within the first of the stop line is at it; one farther than the second has none,
#: metres.
LINE_M, LINE_WITHIN_M = 0.5, 15.0
#: Smaller lane offsets, and distances beyond a road's end, are ignored, metres.
EXACT_M = 0.01


def write_objects(
    road_item: etree._Element, road: ModelRoad, areas: Sequence[RoadArea], version: str
) -> None:
    """Write ``<objects>`` of a road: areas as outlines, and a bridge for an elevated road."""
    if not areas and road.level <= 0:
        return
    parent = etree.SubElement(road_item, "objects")
    for area in areas:
        size = np.maximum(np.ptp(area.corners, axis=0), 0.01)
        item = etree.SubElement(
            parent,
            "object",
            type=area.kind,
            name=xml_text(area.name),
            id=str(area.id),
            **numbers(s=min(max(area.s, 0.0), road.length), t=0, zOffset=0, hdg=0, pitch=0, roll=0),
            orientation="none",
            **numbers(length=size[0], width=size[1], height=area.height),
        )
        if version == "1.4":
            outline = etree.SubElement(item, "outline")
        else:
            outline = etree.SubElement(etree.SubElement(item, "outlines"), "outline", id="0")
        # CARLA draws outlines that repeat their first corner.
        for u, v, z in (*area.corners, area.corners[0]):
            etree.SubElement(outline, "cornerLocal", **numbers(u=u, v=v, z=z, height=area.height))
        if area.marking:
            etree.SubElement(item, "userData", code="marking", value=xml_text(area.marking))
    if road.level > 0:
        etree.SubElement(
            parent,
            "bridge",
            id=f"bridge-{road.id}",
            name=xml_text(road.name),
            **numbers(s=0, length=road.length),
            type="concrete",
        )


def write_signals(
    road_item: etree._Element,
    road: ModelRoad,
    signals: Sequence[RoadSignal],
    references: Sequence[RoadSignal],
    version: str,
) -> None:
    """Write ``<signals>`` of a road: its heads and signs, and references to those elsewhere."""
    if not signals and not references:
        return
    parent = etree.SubElement(road_item, "signals")
    for signal in signals:
        turned = heading_offset(road, signal) if version == "1.4" else 0.0
        item = etree.SubElement(
            parent,
            "signal",
            name=xml_text(signal.name),
            id=str(signal.id),
            **numbers(s=min(max(signal.s, 0.0), road.length), t=signal.t),
            # The standard measures to the lower edge.
            zOffset=number(signal.z - signal.height / 2),
            dynamic="yes" if signal.dynamic else "no",
            orientation=signal.orientation,
            country=signal.country,
            type=signal.type,
            subtype=signal.subtype or "-1",
            **numbers(height=signal.height, width=signal.width, hOffset=turned, pitch=0, roll=0),
        )
        if math.isfinite(signal.value):
            item.set("value", number(signal.value))
            if signal.unit:
                item.set("unit", signal.unit)
        for first, last in _runs(signal.lanes):
            etree.SubElement(item, "validity", fromLane=str(first), toLane=str(last))
        if signal.pose and version != "1.4":
            x, y, z, heading = signal.pose
            lower = z - signal.height / 2
            pose = numbers(x=x, y=y, z=lower, hdg=heading, pitch=0, roll=0)
            etree.SubElement(item, "positionInertial", **pose)
        if signal.links:
            links = " ".join(map(str, signal.links))
            etree.SubElement(item, "userData", code="links", value=links)
    for signal in references:
        item = etree.SubElement(
            parent,
            "signalReference",
            **numbers(s=min(max(signal.s, 0.0), road.length), t=signal.t),
            id=str(signal.id),
            orientation=signal.orientation,
        )
        for first, last in _runs(signal.lanes):
            etree.SubElement(item, "validity", fromLane=str(first), toLane=str(last))


def write_controller(root: etree._Element, controller: SignalController) -> None:
    """Write a ``<controller>`` with its program."""
    item = etree.SubElement(
        root, "controller", name=xml_text(controller.name), id=str(controller.id), sequence="0"
    )
    for signal in controller.signals:
        etree.SubElement(item, "control", signalId=str(signal), type="0")
    if controller.phases:
        phases = ", ".join(f"{number(seconds)} {state}" for seconds, state in controller.phases)
        etree.SubElement(item, "userData", code="phases", value=phases)
        etree.SubElement(item, "userData", code="offset", value=number(controller.offset))


def _runs(lanes: Iterable[int]) -> list[tuple[int, int]]:
    """Return lanes as runs of consecutive ids: first and last of each."""
    ids = sorted(set(lanes))
    breaks = [k for k, (a, b) in enumerate(pairwise(ids), start=1) if b - a > 1]
    return [(ids[a], ids[b - 1]) for a, b in pairwise([0, *breaks, len(ids)]) if b > a]


def with_signal_references(model: LaneModel) -> tuple[LaneModel, tuple[RoadSignal, ...]]:
    """Return a model with each signal on the road beside it, and the signals to refer to.

    References are on the road that the signals apply to, with its lanes, at the stop line: CARLA
    stops vehicles there, so signals metres before the line are referred to as well. CARLA measures
    from the lane offset and the standard from the reference line, so a signal is placed beside a
    street without an offset. If there is none, it gets a road of its own, one metre long, without
    traffic, which signals of one arm share.
    """
    streets = [road for road in model.roads if road.junction < 0 and road.length > CARRIER_M]
    tree = shapely.STRtree([road.curve.line for road in streets])
    carriers: list[ModelRoad] = []
    standing, referred = [], []
    for signal in model.signals:
        road = model.road_by_id[signal.road]
        line = _stop_line(model, signal)
        if not signal.pose and _beside(road, signal) is not None:
            before_line = signal.lanes != NO_LANE and abs(line - signal.s) > LINE_M
            standing.append(replace(signal, lanes=NO_LANE) if before_line else signal)
            referred += [replace(signal, s=line)] if before_line else []
            continue
        posed = replace(signal, pose=pose_of(model, signal))
        near_index = np.sort(tree.query(shapely.Point(posed.pose[:2]).buffer(NEAR_M)))
        hosts = [h for k in near_index if (h := _beside(streets[k], posed)) is not None]
        hosts = hosts or [h for c in carriers if (h := _beside(c, posed)) is not None]
        if not hosts:
            place = np.array([posed.pose[:3]]) - [0.0, 0.0, signal.z]
            heading = posed.pose[3] + math.pi
            carriers.append(carrier(model.next_id + len(carriers), road.level, heading, place))
            hosted = _beside(carriers[-1], posed)
            hosts = [hosted] if hosted is not None else [signal]
        standing.append(min(hosts, key=lambda host: (round(abs(host.t), 3), host.road)))
        if signal.lanes and signal.lanes != NO_LANE:
            referred.append(replace(signal, s=line))
    roads = (*model.roads, *carriers)
    return replace(model, roads=roads, signals=tuple(standing)), tuple(referred)


def _stop_line(model: LaneModel, signal: RoadSignal) -> float:
    """Return the station of a signal's stop line, metres; its own station if there is none."""
    lines = [
        area.s
        for area in model.areas
        if area.name == "StopLine" and area.road == signal.road and signal.dynamic
    ]
    nearest = min(lines, key=lambda s: abs(s - signal.s), default=signal.s)
    return nearest if abs(nearest - signal.s) <= LINE_WITHIN_M else signal.s


def _beside(road: ModelRoad, signal: RoadSignal) -> RoadSignal | None:
    """Return a signal as placed beside a road; ``None`` if offset or distance make it ambiguous."""
    s = signal.s
    if signal.pose:
        s, t = (float(v[0]) for v in road.curve.locate([signal.pose[:2]]))
    if not -EXACT_M <= s <= road.length + EXACT_M or abs(float(road.offset.at(s)[0])) > EXACT_M:
        return None
    if not signal.pose:
        return signal
    z = signal.pose[2] - float(road.elevation.at(s)[0])
    hosted = replace(signal, road=road.id, s=s, t=t, z=z)
    if not signal.lanes:
        return hosted
    along = math.cos(signal.pose[3] - float(road.curve.at(s)[0, 2])) < 0
    return replace(hosted, lanes=NO_LANE, orientation="+" if along else "-")


def heading_offset(road: ModelRoad, signal: RoadSignal) -> float:
    """Return a signal's rotation from facing the traffic of its orientation, radians."""
    if not signal.pose:
        return 0.0
    facing = float(road.curve.at(signal.s)[0, 2]) + (0.0 if signal.orientation == "-" else math.pi)
    return wrapped(signal.pose[3] - facing)
