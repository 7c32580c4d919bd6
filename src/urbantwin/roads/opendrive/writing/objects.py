"""Writing objects, signals and controllers of roads.

The standard knows which signals are switched together, not when. Programs are written as
``userData`` of a controller: ``code="offset"``, the seconds by which the program starts late, and
``code="phases"``, its phases in order, joined by ``", "``, each as seconds, a space, and one letter
per link in SUMO's alphabet (``G`` and ``g`` green, ``y`` amber, ``r`` red, ``s`` stop and go,
``u`` red with amber, ``o`` and ``O`` off). ``userData`` ``code="links"`` of a signal lists which of
these letters it shows. ``userData`` ``code="marking"`` of a crosswalk says what is painted
(``CROSSING_MARKINGS``): the standard's ``markings`` know lines along a border alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from lxml import etree

from urbantwin.roads.model import ModelRoad, RoadArea, RoadSignal, SignalController
from urbantwin.roads.opendrive.writing.number_format import number, numbers, xml_text
from urbantwin.roads.opendrive.writing.signal_references import heading_offset

__all__ = ["write_controller", "write_objects", "write_signals"]


def write_objects(
    road_item: etree._Element, road: ModelRoad, areas: Sequence[RoadArea], version: str
) -> None:
    """Write ``<objects>`` of a road: areas as outlines, a bridge where it leads over others."""
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
        # CARLA draws outlines that come back to their first corner.
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
    """Write ``<signals>`` of a road: heads and signs, and those for it that stand elsewhere."""
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
            where = numbers(x=x, y=y, z=lower, hdg=heading, pitch=0, roll=0)
            etree.SubElement(item, "positionInertial", **where)
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
    """Return lanes as runs of ids one after the other: first and last of each."""
    ids = sorted(set(lanes))
    breaks = [k for k, (a, b) in enumerate(pairwise(ids), start=1) if b - a > 1]
    return [(ids[a], ids[b - 1]) for a, b in pairwise([0, *breaks, len(ids)]) if b > a]
