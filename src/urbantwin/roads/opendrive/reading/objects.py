"""Reading objects: crosswalks, stop lines and islands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads.model import CROSSING_MARKINGS, MINI_ROUNDABOUT, Curve, Profile
from urbantwin.roads.opendrive.reading.parsing import Spot

__all__ = ["Outline", "read_outlines"]

#: How far beyond its road an object may lie, metres.
BEYOND_M = 1.0
#: Corners closer together are one, metres.
SAME_M = 1e-4


@dataclass(frozen=True)
class Outline:
    """An area on a road; see ``RoadArea``."""

    id: str
    kind: str
    name: str
    s: float
    corners: NDArray[np.float64]
    height: float
    marking: str


def read_outlines(
    road: etree._Element, curve: Curve, elevation: Profile, spot: Spot
) -> Iterator[Outline]:
    """Yield the areas of a road that the lane model has; others are counted in a remark.

    Args:
        road: the ``<road>``.
        curve: its reference line.
        elevation: height of its reference line.
        spot: the road, for errors.
    """
    for item in road.findall("objects/object"):
        kind, name = _kind(item)
        if not kind:
            spot.remark(
                f"objects of the type {(item.get('type') or 'none')[:40]!r} that are not read"
            )
            continue
        here = spot.within(f"object {item.get('id', '')}")
        with here.dropping():
            s = here.number(item, "s")
            if not -BEYOND_M <= s <= curve.length + BEYOND_M:
                here.remark("objects and signals beyond their road: they are put at its end")
            s = min(max(s, 0.0), curve.length)
            if item.find("repeat") is not None:
                here.remark("objects that repeat: only the first is read")
            corners = _corners(item, s, curve, elevation, here)
            if len(corners) < 3:
                here.remark("areas without an outline that are not read")
                continue
            height = max(here.number(item, "height", 0.0), 0.0) if kind == "trafficIsland" else 0.0
            marking = _marking(item, here) if kind == "crosswalk" else ""
            yield Outline(item.get("id", ""), kind, name, s, corners, height, marking)


def _kind(item: etree._Element) -> tuple[str, str]:
    """Return the kind of an object in the lane model and its name; empty without one."""
    kind = item.get("type") or ""
    name = item.get("name") or ""
    plain = "".join(c for c in f"{kind} {name} {item.get('subtype') or ''}".lower() if c.isalpha())
    if kind == "crosswalk" or "crosswalk" in plain or "pedestriancrossing" in plain:
        return "crosswalk", name or "crosswalk"
    if "stopline" in plain:
        return "roadMark", "StopLine"
    if "miniroundabout" in plain:
        return "roadMark", MINI_ROUNDABOUT
    if kind == "trafficIsland":
        return kind, name or "island"
    return "", ""


def _marking(item: etree._Element, spot: Spot) -> str:
    """Return what a crosswalk is marked with, if the file tells."""
    told = next((e.get("value") for e in item.iterfind("userData[@code='marking']")), None) or ""
    if told and told not in CROSSING_MARKINGS:
        spot.remark(f"the marking {told[:40]!r} of crosswalks that is not known")
        return ""
    return told


def _corners(
    item: etree._Element, s: float, curve: Curve, elevation: Profile, spot: Spot
) -> NDArray[np.float64]:
    """Return the outline (N, 3) in the road's frame at s: ahead, left, up; not closed."""
    t, up, turn = (spot.number(item, key, 0.0) for key in ("t", "zOffset", "hdg"))
    outline = item.find("outlines/outline")
    if outline is None:
        outline = item.find("outline")
    roads = [] if outline is None else outline.findall("cornerRoad")
    if roads:
        rows = np.array([[spot.number(c, k, 0.0) for k in ("s", "t", "dz")] for c in roads])
        x, y, heading = curve.at(s)[0]
        gap = curve.beside(rows[:, 0], rows[:, 1]) - [x, y]
        c, sn = math.cos(heading), math.sin(heading)
        height = elevation.at(rows[:, 0]) + rows[:, 2] - float(elevation.at(s)[0])
        corners = np.column_stack(
            [gap[:, 0] * c + gap[:, 1] * sn, gap[:, 1] * c - gap[:, 0] * sn, height]
        )
    else:
        local = [] if outline is None else outline.findall("cornerLocal")
        if local:
            uvz = np.array([[spot.number(c, k, 0.0) for k in "uvz"] for c in local])
        else:
            length, width = (spot.number(item, key, 0.0) for key in ("length", "width"))
            if length <= 0 or width <= 0:
                return np.zeros((0, 3))
            u, v = length / 2, width / 2
            uvz = np.array([[-u, -v, 0], [u, -v, 0], [u, v, 0], [-u, v, 0]])
        c, sn = math.cos(turn), math.sin(turn)
        corners = np.column_stack(
            [
                uvz[:, 0] * c - uvz[:, 1] * sn,
                t + uvz[:, 0] * sn + uvz[:, 1] * c,
                up + uvz[:, 2],
            ]
        )
    if len(corners) > 1 and np.linalg.norm(corners[0] - corners[-1]) < SAME_M:
        corners = corners[:-1]
    return corners
