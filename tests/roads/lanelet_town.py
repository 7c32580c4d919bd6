"""Lanelet2 maps drawn by tests: places in metres, written as OSM XML with degrees."""

import math

import numpy as np
import pyproj

ANCHOR = (49.0, 8.4)


class LaneletMap:
    """Points, lines and relations; ids are given in the order of their making."""

    def __init__(self, anchor=ANCHOR):
        self.anchor = anchor
        self.plane = pyproj.Proj(
            f"+proj=tmerc +lat_0={anchor[0]} +lon_0={anchor[1]} +k=1 +x_0=0 +y_0=0 +ellps=WGS84"
        )
        self.nodes, self.ways, self.relations = {}, {}, {}
        self._at = {}
        self._next = 0

    def _id(self):
        self._next += 1
        return self._next

    def node(self, x, y, z=0.0, **tags):
        """The node at a place: the same one for the same millimetre."""
        key = (round(x, 3), round(y, 3), round(z, 3))
        if key not in self._at:
            self._at[key] = self._id()
            self.nodes[self._at[key]] = ((x, y, z), tags)
        return self._at[key]

    def way(self, points, **tags):
        refs = [self.node(*map(float, point)) for point in points]
        identity = self._id()
        self.ways[identity] = (refs, tags)
        return identity

    def relation(self, members, **tags):
        identity = self._id()
        self.relations[identity] = (members, tags)
        return identity

    def lanelet(self, left, right, subtype="road", regulations=(), **tags):
        members = [("way", left, "left"), ("way", right, "right")]
        members += [("relation", r, "regulatory_element") for r in regulations]
        said = {"type": "lanelet", "subtype": subtype, "location": "urban", "one_way": "yes"}
        return self.relation(
            members, **{**said, **{k.replace("__", ":"): v for k, v in tags.items()}}
        )

    def between(self, left, right, **tags):
        """A lanelet between two new lines."""
        return self.lanelet(self.way(left, type="virtual"), self.way(right, type="virtual"), **tags)

    def line(self, way):
        """A way's points (N, 3), as they were drawn."""
        return np.array([self.nodes[n][0] for n in self.ways[way][0]])

    def write(self, path, *, local=False, heights=True):
        rows = ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6'>"]
        for identity, ((x, y, z), tags) in self.nodes.items():
            lon, lat = self.plane(x, y, inverse=True)
            place = "lat='' lon=''" if local else f"lat='{lat:.11f}' lon='{lon:.11f}'"
            said = dict(tags, **({"local_x": f"{x:.4f}", "local_y": f"{y:.4f}"} if local else {}))
            if heights:
                said["ele"] = f"{z:.4f}"
            rows.append(f"<node id='{identity}' {place}>{_tags(said)}</node>")
        for identity, (refs, tags) in self.ways.items():
            inside = "".join(f"<nd ref='{n}'/>" for n in refs)
            rows.append(f"<way id='{identity}'>{inside}{_tags(tags)}</way>")
        for identity, (members, tags) in self.relations.items():
            inside = "".join(
                f"<member type='{kind}' ref='{ref}' role='{role}'/>" for kind, ref, role in members
            )
            rows.append(f"<relation id='{identity}'>{inside}{_tags(tags)}</relation>")
        path.write_text("\n".join([*rows, "</osm>"]))
        return path


def _tags(tags):
    return "".join(f"<tag k='{k}' v='{v}'/>" for k, v in tags.items())


def hermite(start, end, count=9, pull=1.0):
    """Points of a smooth curve between poses (x, y, heading)."""
    (x0, y0, h0), (x1, y1, h1) = start, end
    reach = pull * math.hypot(x1 - x0, y1 - y0)
    u = np.linspace(0.0, 1.0, count)[:, None]
    p0, p1 = np.array([x0, y0]), np.array([x1, y1])
    d0, d1 = (reach * np.array([math.cos(h), math.sin(h)]) for h in (h0, h1))
    return (
        (2 * u**3 - 3 * u**2 + 1) * p0
        + (u**3 - 2 * u**2 + u) * d0
        + (3 * u**2 - 2 * u**3) * p1
        + (u**3 - u**2) * d1
    )


WIDTH = 3.5


def arm(angle, *, near=14.0, far=70.0, skew=0.0, bend=0.0):
    """Points outwards along an arm: edge on the left going out, middle, edge on the right.

    The left edge is that of the lane that leads in, where people drive on the right.
    """
    c, s = math.cos(angle), math.sin(angle)
    rows = []
    for t in (WIDTH, 0.0, -WIDTH):
        along = np.linspace(near + skew * t, far, 9)
        off = t + bend * ((along - near) / (far - near)) ** 2
        rows.append(np.column_stack([along * c - off * s, along * s + off * c]))
    return rows


def crossing_town(*, anchor=ANCHOR, skew=0.0, bend=0.0, left_hand=False):
    """Four two-way arms, a light, a stop line and a crosswalk; every turn, no U-turns."""
    town = LaneletMap(anchor)
    arms, regulation = [], {}
    for k in range(4):
        angle = k * math.pi / 2 + 0.1
        left, middle, right = arm(angle, skew=skew, bend=bend)
        lines = [
            town.way(left, type="road_border"),
            town.way(middle, type="line_thin", subtype="dashed"),
            town.way(right, type="road_border"),
        ]
        # Traffic keeps to the right of the middle: what leads in lies left of it going out.
        inward, outward = (left, right) if not left_hand else (right, left)
        stop = town.way([inward[0], middle[0]], type="stop_line")
        lamp = middle[0] + 24.0 * np.array([-math.cos(angle), -math.sin(angle)])
        head = town.way(
            [(*(lamp + [0.3, 0]), 5.0), (*(lamp - [0.3, 0]), 5.0)],
            type="traffic_light", subtype="red_yellow_green", height="0.9",
        )  # fmt: skip
        regulation[k] = town.relation(
            [("way", head, "refers"), ("way", stop, "ref_line")],
            type="regulatory_element", subtype="traffic_light",
        )  # fmt: skip
        outer_in, outer_out = (lines[0], lines[2]) if not left_hand else (lines[2], lines[0])
        limit = {"speed_limit": "30 km/h"} if k == 0 else {}
        pair = [(lines[1], outer_in), (lines[1], outer_out)]
        if left_hand:
            pair = [(b, a) for a, b in pair]
        one = town.lanelet(*pair[0], regulations=[regulation[k]], **limit)
        two = town.lanelet(*pair[1], **limit)
        arms.append({"in": one, "out": two, "angle": angle, "edges": (inward, middle, outward)})
    turns = {}
    for i, a in enumerate(arms):
        for j, b in enumerate(arms):
            if i == j:
                continue
            lines = []
            for source, target in ((a["edges"][1], b["edges"][1]), (a["edges"][0], b["edges"][2])):
                start = (*source[0], a["angle"] + math.pi)
                lines.append(hermite(start, (*target[0], b["angle"])))
            inner, outer = lines
            pair = (outer, inner) if left_hand else (inner, outer)
            turns[i, j] = town.between(*pair)
    c, s = math.cos(0.1), math.sin(0.1)
    walk = [[(x * c - y * s, x * s + y * c) for y in (-4.5, 4.5)] for x in (16.0, 19.0)]
    town.between(*walk, subtype="crosswalk", one_way="no")
    town.arms, town.turns = arms, turns
    return town


def sine(x, off):
    """Points beside a gently winding line, ``off`` metres to its left."""
    y, slope = 6.0 * np.sin(x / 60), 0.1 * np.cos(x / 60)
    long = np.hypot(1.0, slope)
    return np.column_stack([x - slope / long * off, y + off / long])


def pose(x, off):
    """Place and direction on that line."""
    return (*sine(np.array([x]), off)[0], math.atan(0.1 * math.cos(x / 60)))


def motorway():
    """Two lanes that an exit leaves and a slip road joins."""
    town = LaneletMap()
    town.main = []
    for first, last in ((0, 100), (100, 220), (220, 330)):
        x = np.linspace(first, last, 14)
        lines = [
            town.way(sine(x, t), type="line_thin", subtype="dashed") for t in (WIDTH, 0, -WIDTH)
        ]
        for k in (0, 1):
            town.main.append(
                town.lanelet(*lines[k : k + 2], subtype="highway", location="nonurban")
            )
    leave = [hermite(pose(100, t), (150, -70 + t, -0.8), 15) for t in (0, -WIDTH)]
    join = [hermite((170, -70 + t, 0.3), pose(220, t), 15) for t in (0, -WIDTH)]
    town.exit = town.between(*leave, subtype="highway")
    town.entry = town.between(*join, subtype="highway")
    return town


def street_with_pocket():
    """Both directions, a bicycle lane, two sidewalks, and a lane that begins with no width."""
    town = LaneletMap()
    ids = {}
    spans = (np.linspace(0, 60, 9), np.linspace(60, 120, 9))
    for k, x in enumerate(spans):
        grow = np.clip((x - 60) / 25, 0, 1) * 3.0
        middle = town.way(sine(x, 0), type="line_thin", subtype="solid_dashed")
        right = town.way(sine(x, -WIDTH), type="line_thin", subtype="dashed")
        kerb = town.way(sine(x, -WIDTH - grow), type="line_thin", subtype="solid") if k else right
        edge = town.way(sine(x, -WIDTH - grow - 1.5), type="curbstone", subtype="high")
        wall = town.way(sine(x, -WIDTH - grow - 3.5), type="fence")
        # The other direction's outer bound is drawn as traffic runs there.
        far = town.way(sine(x, WIDTH)[::-1], type="curbstone", subtype="high")
        ids["ahead", k] = town.lanelet(middle, right)
        ids["back", k] = town.lanelet(middle, far)
        if k:
            ids["pocket", k] = town.lanelet(right, kerb, turn__lane="right")
        ids["bicycle", k] = town.lanelet(kerb, edge, subtype="bicycle_lane")
        ids["walk", k] = town.lanelet(edge, wall, subtype="walkway", one_way="no")
    town.ids = ids
    return town


def roundabout(inner=11.8, outer=16.2):
    """Four arms around a ring."""
    town = LaneletMap()

    def ring(a, r):
        return np.array([r * math.cos(a), r * math.sin(a)])

    cuts = [k * math.pi / 2 + d for k in range(4) for d in (-0.35, 0.35)]
    for a, b in zip(cuts, [*cuts[1:], cuts[0] + 2 * math.pi], strict=True):
        steps = np.linspace(a, b, 8)
        town.between([ring(u, inner) for u in steps], [ring(u, outer) for u in steps])
    for k in range(4):
        a = k * math.pi / 2

        def out(d, t, a=a):
            return d * math.cos(a) - t * math.sin(a), d * math.sin(a) + t * math.cos(a)

        for sign in (-1, 1):
            at, rows = a + 0.35 * sign, []
            for r, t in ((inner, 0.0), (outer, sign * WIDTH)):
                near, far = (
                    (*ring(at, r), at + math.pi / 2),
                    (*out(32, t), a + math.pi * (sign > 0)),
                )
                rows.append(hermite(near, far) if sign < 0 else hermite(far, near))
            town.between(*rows)
        lines = [town.way([out(32, t), out(80, t)], type="line_thin") for t in (0, -WIDTH, WIDTH)]
        town.lanelet(lines[0], lines[1])
        town.lanelet(lines[0], lines[2])
    return town


def closed_ring():
    """Three lanelets in a circle that nothing leads to."""
    town = LaneletMap()
    for a, b in ((0.0, 2.0), (2.0, 4.2), (4.2, 2 * math.pi)):
        steps = np.linspace(a, b, 12)
        town.between(*([(r * math.cos(u), r * math.sin(u)) for u in steps] for r in (18, 22)))
    return town


def overpass():
    """A road over a hill and, tilted, over another road on the flat."""
    town = LaneletMap()
    x = np.linspace(-80, 80, 33)
    z = 105 + 7 * np.exp(-((x / 35) ** 2))
    for line in ("over", "under"):
        rows = []
        for t in (WIDTH, 0.0, -WIDTH):
            y = np.full(len(x), t)
            rows.append(
                np.column_stack([x, y, z + 0.03 * t] if line == "over" else [-y, x, 0 * x + 105])
            )
        lines = [town.way(row, type="road_border") for row in rows]
        town.lanelet(lines[1], lines[2])
        town.lanelet(lines[1], lines[0])
    return town


def parting():
    """A two-way street whose directions part around a median."""
    town = LaneletMap()
    lines = [town.way([(0, t), (50, t)], type="line_thin") for t in (WIDTH, 0, -WIDTH)]
    town.lanelet(lines[1], lines[2])
    town.lanelet(lines[1], lines[0])
    x = np.linspace(50, 120, 8)
    apart = np.clip((x - 50) / 30, 0, 1) * 4
    for sign in (-1, 1):
        town.between(*(np.column_stack([x, sign * (t + apart)]) for t in (0, WIDTH)))
    return town
