"""Fixtures: a reader of OpenDRIVE of its own, from the standard's formulas, as a ruler."""

import math
from xml.etree import ElementTree

import numpy as np
import pytest


def cubic(records, s, key="s"):
    """Value at s of the last record that starts at or before it (ASAM OpenDRIVE 1.8, 8.4)."""
    value = 0.0
    for record in records:
        start = float(record.get(key))
        if start <= s + 1e-9:
            d = s - start
            value = sum(float(record.get(c)) * d**k for k, c in enumerate("abcd"))
    return value


class Road:
    def __init__(self, element):
        self.element = element
        self.id, self.junction = element.get("id"), element.get("junction")
        self.length = float(element.get("length"))
        self.geometry = element.findall("planView/geometry")
        self.lanes = {int(lane.get("id")): lane for lane in element.iter("lane")}
        self.forward = {  # 1.8: the traffic rule says on which side traffic runs along s
            lane: (lane < 0) == (element.get("rule", "RHT") == "RHT") for lane in self.lanes
        }

    def reference(self, s):
        """x, y, heading of the reference line (ASAM OpenDRIVE 1.8, 9.2 to 9.6)."""
        for item in self.geometry:
            if float(item.get("s")) <= s + 1e-9:
                piece = item
        start, length = float(piece.get("s")), float(piece.get("length"))
        x, y, heading = (float(piece.get(k)) for k in ("x", "y", "hdg"))
        d = min(max(s - start, 0.0), length)
        shape = piece[0]
        if shape.tag == "line":
            u, v, turn = d, 0.0, 0.0
        elif shape.tag == "arc":
            k = float(shape.get("curvature"))
            u, v, turn = math.sin(k * d) / k, (1 - math.cos(k * d)) / k, k * d
        else:
            assert shape.tag == "paramPoly3"
            assert shape.get("pRange") == "normalized"
            p = d / length
            cu, cv = ([float(shape.get(c + axis)) for c in "abcd"] for axis in "UV")
            u, v = (sum(c[k] * p**k for k in range(4)) for c in (cu, cv))
            turn = math.atan2(*(sum(k * c[k] * p ** (k - 1) for k in (1, 2, 3)) for c in (cv, cu)))
        c, sn = math.cos(heading), math.sin(heading)
        return x + u * c - v * sn, y + u * sn + v * c, heading + turn

    def border(self, s, lane):
        """t of a lane's border away from the reference line."""
        t = cubic(self.element.findall("lanes/laneOffset"), s)
        step = 1 if lane > 0 else -1
        for inner in range(step, lane + step, step) if lane else ():
            t += step * cubic(self.lanes[inner].findall("width"), s, "sOffset")
        return t

    def place(self, s, t):
        x, y, heading = self.reference(s)
        roll = cubic(self.element.findall("lateralProfile/superelevation"), s)
        z = cubic(self.element.findall("elevationProfile/elevation"), s) + t * math.sin(roll)
        across = t * math.cos(roll)
        return np.array([x - across * math.sin(heading), y + across * math.cos(heading), z])

    def borders(self, s, lane):
        """Inner and outer border points (3,) of a lane."""
        step = 1 if lane > 0 else -1
        return self.place(s, self.border(s, lane - step)), self.place(s, self.border(s, lane))

    def middle(self, s, lane):
        return sum(self.borders(s, lane)) / 2


@pytest.fixture(scope="session")
def read_opendrive():
    """Return a function: path -> the root element and {id: Road}."""

    def read(path):
        root = ElementTree.parse(path).getroot()
        return root, {road.get("id"): Road(road) for road in root.findall("road")}

    return read
