"""Fixtures: a reader of OpenDRIVE of its own, from the standard's formulas, as a ruler."""

import math
import pickle
import runpy
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from scipy.integrate import quad

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, driving_side
from urbantwin.site import init_site, load_site, read_extract
from urbantwin.site.junction_proposal import propose_junction


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
    """A road; ``lanes`` and the methods without a section are those of its first section."""

    def __init__(self, element):
        self.element = element
        self.id, self.junction = element.get("id"), element.get("junction")
        self.length = float(element.get("length"))
        self.geometry = element.findall("planView/geometry")
        self.sections = element.findall("lanes/laneSection")
        self.starts = [float(section.get("s")) for section in self.sections]
        self.ends = [*self.starts[1:], self.length]
        self.lanes = self.lanes_of(0)
        self.forward = {  # 1.8: the traffic rule says on which side traffic runs along s
            lane: ((lane < 0) == (element.get("rule", "RHT") == "RHT"))
            != (item.get("direction") == "reversed")
            for lane, item in self.lanes.items()
        }

    def lanes_of(self, k):
        return {int(lane.get("id")): lane for lane in self.sections[k].iter("lane")}

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
        elif shape.tag == "spiral":
            first, last = (float(shape.get(k)) for k in ("curvStart", "curvEnd"))

            def angle(q):
                return first * q + (last - first) / length * q * q / 2

            u, v = (
                quad(lambda q, f=f: f(angle(q)), 0, d, limit=400)[0] for f in (math.cos, math.sin)
            )
            turn = angle(d)
        else:
            assert shape.tag == "paramPoly3"
            p = d / length if shape.get("pRange") == "normalized" else d
            cu, cv = ([float(shape.get(c + axis)) for c in "abcd"] for axis in "UV")
            u, v = (sum(c[k] * p**k for k in range(4)) for c in (cu, cv))
            turn = math.atan2(*(sum(k * c[k] * p ** (k - 1) for k in (1, 2, 3)) for c in (cv, cu)))
        c, sn = math.cos(heading), math.sin(heading)
        return x + u * c - v * sn, y + u * sn + v * c, heading + turn

    def border(self, s, lane, section=0):
        """t of a lane's border away from the reference line."""
        t = cubic(self.element.findall("lanes/laneOffset"), s)
        step = 1 if lane > 0 else -1
        lanes = self.lanes_of(section)
        for inner in range(step, lane + step, step) if lane else ():
            widths = lanes[inner].findall("width")
            t += step * cubic(widths, s - self.starts[section], "sOffset")
        return t

    def shape(self, s, t):
        """Height of the cross section over the plane of the superelevation (1.8, 10.5.3)."""
        rows = self.element.findall("lateralProfile/shape")
        stations = sorted({float(row.get("s")) for row in rows})
        if not stations:
            return 0.0

        def height(at):
            return cubic([row for row in rows if float(row.get("s")) == at], t, "t")

        after = next((k for k, at in enumerate(stations) if at > s), len(stations))
        a, b = stations[max(after - 1, 0)], stations[min(after, len(stations) - 1)]
        share = (s - a) / (b - a) if b > a else 0.0
        return (1 - share) * height(a) + share * height(b)

    def fall(self, s, t):
        """Height lost by the crossfall of 1.4 (5.3.5.2)."""
        rows = self.element.findall("lateralProfile/crossfall")
        sides = ("both", "left" if t > 0 else "right")
        rows = [row for row in rows if row.get("side", "both") in sides]
        return abs(t) * math.tan(cubic(rows, s))

    def place(self, s, t):
        x, y, heading = self.reference(s)
        roll = cubic(self.element.findall("lateralProfile/superelevation"), s)
        z = cubic(self.element.findall("elevationProfile/elevation"), s) + t * math.sin(roll)
        z += self.shape(s, t) - self.fall(s, t)
        across = t * math.cos(roll)
        return np.array([x - across * math.sin(heading), y + across * math.cos(heading), z])

    def borders(self, s, lane, section=0):
        """Inner and outer border points (3,) of a lane."""
        step = 1 if lane > 0 else -1
        inner, outer = (self.border(s, k, section) for k in (lane - step, lane))
        return self.place(s, inner), self.place(s, outer)

    def middle(self, s, lane, section=0):
        return sum(self.borders(s, lane, section)) / 2


@pytest.fixture(scope="session")
def town():
    """Return a function: driving side -> a small town as a lane model, made by hand."""
    return runpy.run_path(str(Path(__file__).with_name("lane_town.py")))["town"]


@pytest.fixture(scope="session")
def ruler():
    """Return a function: path -> the root element and {id: Road}."""

    def read(path):
        root = ElementTree.parse(path).getroot()
        return root, {road.get("id"): Road(road) for road in root.findall("road")}

    return read


#: Junctions of real extracts: latitude and longitude.
JUNCTIONS = {
    "taipei": (25.052396, 121.522635),
    "neukolln": (52.47328, 13.439643),
    "quad_intersection": (47.644172, -122.303614),
    "perth_stretched_lights": (-31.974855, 115.897588),
    "munich": (48.186032, 11.551664),
    "West-Oakland": (37.807071, -122.302363),
}


@pytest.fixture(scope="session")
def real_roads(shared_data, made_once):
    """Return a function: name of a real extract -> its roads, built once for all tests.

    ``roads_of(name)``: 110 m around its junction of `JUNCTIONS`, or else 130 m around the one that
    is proposed; ``closed_loop``: the site that `init` makes of it, closed to a loop.
    ``extract`` (the file), ``frame``, ``region``, ``net`` (SUMO's), ``built``.
    """

    def site_of(name, folder):
        boundary = shared_data / "osm" / f"{name}.boundary.json"
        region = boundary if boundary.exists() else None
        site = load_site(init_site(folder, extract_of(name), region=region))
        return read_extract(site.osm.path), site.frame, site.region

    def place_of(name):
        content = read_extract(extract_of(name))
        if name in JUNCTIONS:
            return content, SiteFrame(*JUNCTIONS[name]), shapely.Point(0, 0).buffer(110)
        place = propose_junction(content)
        frame = SiteFrame(place.latitude, place.longitude)
        return content, frame, shapely.Point(0, 0).buffer(130)

    def extract_of(name):
        (extract,) = (shared_data / "osm").glob(f"{name}.osm*")
        return extract

    def roads_of(name, *, closed_loop=False):
        def make(folder):
            found = site_of(name, folder / "site") if closed_loop else place_of(name)
            content, frame, region = found
            built = build_roads(
                content,
                frame,
                region,
                Elevation.flat(),
                driving_side=driving_side(frame.latitude, frame.longitude),
                closed_loop=closed_loop,
                out=folder / "n.net.xml",
            )
            (folder / "roads.pickle").write_bytes(pickle.dumps((frame, region, built)))

        folder = made_once(f"roads-{name}{'-loop' if closed_loop else ''}", make)
        frame, region, built = pickle.loads((folder / "roads.pickle").read_bytes())
        return SimpleNamespace(
            extract=extract_of(name),
            frame=frame,
            region=region,
            built=built,
            net=folder / "n.net.xml",
        )

    return roads_of
