"""Measures a lane model against the Lanelet2 map that it was read from, by the file alone."""

import itertools
import math
from collections import defaultdict
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyproj
import shapely


class Drawn:
    """A Lanelet2 file in metres around an anchor, read without the project's reader."""

    def __init__(self, path: Path, anchor):
        root = ElementTree.parse(path).getroot()
        plane = pyproj.Proj(f"+proj=tmerc +lat_0={anchor[0]} +lon_0={anchor[1]} +ellps=WGS84")
        self.nodes = {}
        for node in root.iter("node"):
            xy = plane(float(node.get("lon")), float(node.get("lat")))
            self.nodes[node.get("id")] = (*xy, float(_tags(node).get("ele", 0.0)))
        self.ways = {w.get("id"): [n.get("ref") for n in w.iter("nd")] for w in root.iter("way")}
        self.lanelets = {}
        for relation in root.iter("relation"):
            if _tags(relation).get("type") == "lanelet":
                members = {m.get("role"): m.get("ref") for m in relation.iter("member")}
                pair = self.ways[members["left"]], self.ways[members["right"]]
                self.lanelets[int(relation.get("id"))] = (*self._turned(*pair), _tags(relation))

    def line(self, refs):
        return np.array([self.nodes[n] for n in refs])

    def _turned(self, left, right):
        """Both bounds in the direction of travel: left, back along right, runs clockwise."""
        best = None
        for a in (left, left[::-1]):
            for b in (right, right[::-1]):
                ring = shapely.LinearRing(self.line([*a, *b[::-1]])[:, :2])
                if not shapely.is_ccw(ring):
                    cost = (not ring.is_simple, -shapely.Polygon(ring).area)
                    if best is None or cost < best[0]:
                        best = cost, a, b
        return best[1], best[2]

    def area(self, identity):
        left, right, _ = self.lanelets[identity]
        return shapely.make_valid(shapely.Polygon(self.line([*left, *right[::-1]])[:, :2]))

    def followers(self):
        """Pairs of lanelets for wheels; the second begins with the last points of the first."""
        walks = ("walkway", "crosswalk")
        rows = {i: n for i, n in self.lanelets.items() if n[2].get("subtype") not in walks}
        return {
            (a, b)
            for a, one in rows.items()
            for b, two in rows.items()
            if a != b and (one[0][-1], one[1][-1]) == (two[0][0], two[1][0])
        }


def _tags(element):
    return {tag.get("k"): tag.get("v") for tag in element.iter("tag")}


def lane_border(model, key, *, left, step=0.1):
    """Points (N, 3) of a lane's border on the left or right of its traffic."""
    road = model.road_by_id[key[0]]
    section = road.sections[key[1]]
    lane, end = section.by_id[key[2]], road.section_ends[key[1]]
    s = np.linspace(section.s, end, max(5, int((end - section.s) / step)))
    breaks = np.concatenate([lane.width.start + section.s, road.offset.start])
    s = np.unique(np.concatenate([s, breaks[(breaks > section.s) & (breaks < end)]]))
    outer = (lane.id > 0) == (left == lane.forward)
    return road.place(s, road.border(section, lane, s, outer=outer))


def lane_area(model, key):
    rows = [lane_border(model, key, left=left, step=0.5)[:, :2] for left in (True, False)]
    return shapely.make_valid(shapely.Polygon(np.vstack([rows[0], rows[1][::-1]])))


def lane_links(model):
    """Pairs of lanes (road, section, lane) where traffic goes on from the first to the second."""
    found = set()
    for road in model.roads:
        for k, section in enumerate(road.sections):
            for lane in section.lanes:
                key = (road.id, k, lane.id)
                if k + 1 < len(road.sections) and lane.successor is not None:
                    other = (road.id, k + 1, lane.successor)
                    found.add((key, other) if lane.forward else (other, key))
                if road.junction >= 0:
                    before = model.road_by_id[road.predecessor.id]
                    after = model.road_by_id[road.successor.id]
                    for link, street, number in (
                        (road.predecessor, before, lane.predecessor),
                        (road.successor, after, lane.successor),
                    ):
                        at = len(street.sections) - 1 if link.contact == "end" else 0
                        other = (street.id, at, number)
                        found.add((other, key) if street is before else (key, other))
    return found


def farthest(drawn, model, lanes):
    """{lanelet: how far its bounds lie from the borders of its lanes at most}, metres.

    Where a road ends obliquely, the rest of a lane lies in those that it is joined to.
    """
    beside = defaultdict(set)
    for a, b in lane_links(model):
        beside[a].add(b)
        beside[b].add(a)
    found = {}
    for identity, (*bounds, _) in drawn.lanelets.items():
        keys = set(lanes.get(identity, ()))
        keys |= {other for key in keys for other in beside[key]}
        found[identity] = math.inf if not keys else 0.0
        for bound, left in zip(bounds, (True, False), strict=True):
            if not keys:
                continue
            points = shapely.get_coordinates(
                shapely.segmentize(shapely.LineString(drawn.line(bound)[:, :2]), 0.1)
            )
            lines = [lane_border(model, key, left=left)[:, :2] for key in sorted(keys)]
            away = shapely.distance(shapely.MultiLineString(lines), shapely.points(points))
            found[identity] = max(found[identity], float(away.max()))
    return found


def lanelet_links(model, lanes, drawn):
    """Pairs of lanelets that follow each other over the links of a model's lanes."""
    held = defaultdict(list)
    for identity, keys in lanes.items():
        for key in keys:
            held[key].append(identity)
    for key, rows in held.items():
        road = model.road_by_id[key[0]]
        lane = road.sections[key[1]].by_id[key[2]]
        middles = [drawn.line(drawn.lanelets[i][0])[:, :2].mean(axis=0) for i in rows]
        order = np.argsort(road.curve.locate(np.array(middles))[0])
        held[key] = [rows[k] for k in (order if lane.forward else order[::-1])]
    pairs = set()
    for rows in held.values():
        pairs |= set(itertools.pairwise(rows))
    links = lane_links(model)
    after = defaultdict(set)
    for a, b in links:
        after[a].add(b)
    for a, b in links:
        # A way through a junction may be made of nothing but the ends of two streets.
        targets = [b] if held.get(b) else list(after[b])
        if held.get(a):
            pairs |= {(held[a][-1], held[c][0]) for c in targets if held[a][-1] != held[c][0]}
    return pairs


def placed(model, area):
    """Corners (N, 3) of an area on a road, in the site frame."""
    road = model.road_by_id[area.road]
    x, y, heading = road.curve.at(area.s)[0]
    c, s = math.cos(heading), math.sin(heading)
    u, v, z = area.corners.T
    up = float(road.elevation.at(area.s)[0])
    return np.column_stack([x + u * c - v * s, y + u * s + v * c, up + z])
