"""Crosswalks, stop lines and islands: the objects of the lane model."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads.model import CROSSING_MARKINGS, MINI_ROUNDABOUT, Curve, Profile, RoadArea
from urbantwin.roads.opendrive.reading.parsing import Spot, station_on_road, user_data

__all__ = ["WrittenArea", "read_areas"]

#: Corners closer to each other are merged, metres.
SAME_M = 1e-4


@dataclass(frozen=True)
class WrittenArea:
    """An area with its ids in the file; those of ``area`` are set later."""

    id: str
    road: str
    area: RoadArea


def read_areas(
    road: etree._Element, name: str, curve: Curve, elevation: Profile, spot: Spot
) -> Iterator[WrittenArea]:
    """Yield the areas of a ``<road>``; other objects are reported.

    Args:
        road: the ``<road>``.
        name: its id in the file.
        curve: its reference line.
        elevation: height of its reference line.
        spot: the road, for errors.
    """
    for item in road.findall("objects/object"):
        kind, label = _kind(item)
        if not kind:
            spot.remark(
                f"objects of the type {(item.get('type') or 'none')[:40]!r} that are not read"
            )
            continue
        identity = item.get("id", "")
        place = spot.within(f"object {identity}")
        with place.dropping():
            s = station_on_road(item, curve.length, place)
            if item.find("repeat") is not None:
                place.remark("objects that repeat: only the first is read")
            corners = _corners(item, s, curve, elevation, place)
            if len(corners) < 3:
                place.remark("areas without an outline that are not read")
                continue
            height = max(place.number(item, "height", 0.0), 0.0) if kind == "trafficIsland" else 0.0
            marking = _marking(item, place) if kind == "crosswalk" else ""
            area = RoadArea(0, 0, kind, label, s, corners, height, marking=marking)
            yield WrittenArea(identity, name, area)


def _kind(item: etree._Element) -> tuple[str, str]:
    """Return the kind and the name of an object in the lane model; empty for other objects."""
    kind = item.get("type") or ""
    name = item.get("name") or ""
    words = f"{kind} {name} {item.get('subtype') or ''}".lower()
    letters = "".join(c for c in words if c.isalpha())
    if kind == "crosswalk" or "crosswalk" in letters or "pedestriancrossing" in letters:
        return "crosswalk", name or "crosswalk"
    if "stopline" in letters:
        return "roadMark", "StopLine"
    if "miniroundabout" in letters:
        return "roadMark", MINI_ROUNDABOUT
    if kind == "trafficIsland":
        return kind, name or "island"
    return "", ""


def _marking(item: etree._Element, spot: Spot) -> str:
    """Return the marking of a crosswalk; empty if it is missing or unknown."""
    marking = user_data(item).get("marking", "")
    if marking and marking not in CROSSING_MARKINGS:
        spot.remark(f"the marking {marking[:40]!r} of crosswalks that is not known")
        return ""
    return marking


def _corners(
    item: etree._Element, s: float, curve: Curve, elevation: Profile, spot: Spot
) -> NDArray[np.float64]:
    """Return the outline (N, 3) in the road's frame at s: ahead, left, up, metres; not closed."""
    t, up, turn = (spot.number(item, key, 0.0) for key in ("t", "zOffset", "hdg"))
    outline = item.find("outlines/outline")
    if outline is None:
        outline = item.find("outline")
    on_road, local = (
        [] if outline is None else outline.findall(tag) for tag in ("cornerRoad", "cornerLocal")
    )
    if on_road:
        rows = np.array([[spot.number(c, k, 0.0) for k in ("s", "t", "dz")] for c in on_road])
        x, y, heading = curve.at(s)[0]
        gap = curve.beside(rows[:, 0], rows[:, 1]) - [x, y]
        c, sn = math.cos(heading), math.sin(heading)
        height = elevation.at(rows[:, 0]) + rows[:, 2] - float(elevation.at(s)[0])
        corners = np.column_stack(
            [gap[:, 0] * c + gap[:, 1] * sn, gap[:, 1] * c - gap[:, 0] * sn, height]
        )
    else:
        if local:
            u, v, z = np.array([[spot.number(c, k, 0.0) for k in "uvz"] for c in local]).T
        else:
            length, width = (spot.number(item, key, 0.0) for key in ("length", "width"))
            if length <= 0 or width <= 0:
                return np.zeros((0, 3))
            u, v = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]]) * [[length / 2], [width / 2]]
            z = np.zeros(4)
        c, sn = math.cos(turn), math.sin(turn)
        corners = np.column_stack([u * c - v * sn, t + u * sn + v * c, up + z])
    if len(corners) > 1 and np.linalg.norm(corners[0] - corners[-1]) < SAME_M:
        corners = corners[:-1]
    return corners
