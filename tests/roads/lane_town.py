"""A small town as a lane model, made by hand: three streets that meet, on a slope."""

import math

import numpy as np

from urbantwin.roads.model import (
    Connection,
    Curve,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    Piece,
    Profile,
    RoadArea,
    RoadLink,
    RoadSignal,
    SectionLane,
    SignalController,
    splined,
)

#: The slope of the ground, to the east and to the north.
SLOPE = (0.03, 0.01)
ZERO = Profile.constant(0.0)
VEHICLES = ("car", "truck", "bus", "motorcycle", "bicycle")
USERS = {"driving": VEHICLES, "bus": ("bus", "bicycle"), "bicycle": ("bicycle",)}
MOTOR = ("driving", "bus", "bicycle")
RAISED = {"sidewalk": 0.15, "curb": 0.15, "island": 0.12, "median": 0.1}


def ground(x, y):
    return SLOPE[0] * x + SLOPE[1] * y


def laid(curve):
    """Elevation and superelevation of a reference line on the ground."""
    s = np.linspace(0, curve.length, max(2, round(curve.length)))
    x, y, heading = curve.at(s).T
    level = Profile(s[:-1], np.zeros((len(s) - 1, 4)))
    tilt = Profile(s[:-1], np.zeros((len(s) - 1, 4)))
    across = np.arctan(SLOPE[1] * np.cos(heading) - SLOPE[0] * np.sin(heading))
    for profile, value in ((level, ground(x, y)), (tilt, across)):
        profile.abcd[:, 0] = value[:-1]
        profile.abcd[:, 1] = np.diff(value) / np.diff(s)
    return level, tilt


def side_lanes(kinds, sign, *, forward, speed=13.89):
    """Lanes of one side from the reference line outwards: (kind, width or Profile)."""
    found = []
    for k, (kind, width) in enumerate(kinds, start=1):
        profile = width if isinstance(width, Profile) else Profile.constant(width)
        found.append(
            SectionLane(
                sign * k,
                kind,
                profile,
                forward,
                speed if kind in MOTOR else 0.0,
                USERS.get(kind, ("pedestrian",) if kind == "sidewalk" else ()),
                height=RAISED.get(kind, 0.0),
                mark="curb" if kind == "curb" else "solid",
            )
        )
    return found


def section(s, along, against, side):
    """A lane section; ``side`` is the sign of lanes along the reference line."""
    lanes = side_lanes(along, side, forward=True) + side_lanes(against, -side, forward=False)
    ordered = tuple(sorted(lanes, key=lambda lane: -lane.id))
    return LaneSection(s, ordered, "broken" if against else "solid")


def linked(sections, pairs):
    """Sections with links between them: for each border, {lane before: lane after}."""
    done = list(sections)
    for k, links in enumerate(pairs):
        back = {b: a for a, b in links.items()}
        for j, name, table in ((k, "successor", links), (k + 1, "predecessor", back)):
            lanes = tuple(
                SectionLane(**{**vars(lane), name: table.get(lane.id)}) for lane in done[j].lanes
            )
            done[j] = LaneSection(done[j].s, lanes, done[j].centre_mark)
    return tuple(done)


def road(number, curve, sections, crown=ZERO, **values):
    elevation, bank = laid(curve)
    fields = {"name": "", "kind": "residential", "ways": (), "junction": -1, "offset": ZERO}
    return ModelRoad(
        id=number,
        curve=curve,
        elevation=elevation,
        bank=bank,
        crown=crown,
        sections=sections,
        **{**fields, **values},
    )


def end_pose(street, lane, *, leaving):
    """Middle of a lane at the end towards the junction, and the heading of its traffic."""
    at_end = lane.forward == leaving
    s = street.length if at_end else 0.0
    part = street.sections[-1 if at_end else 0]
    lane = part.by_id[lane.id]
    x, y, heading = street.curve.at(s)[0]
    t = float(street.middle(part, lane, s)[0]) * math.cos(float(street.bank.at(s)[0]))
    if not lane.forward:
        heading += math.pi
    return np.array([x, y]) + t * np.array([-1, 1]) * [
        math.sin(street.curve.at(s)[0, 2]),
        math.cos(street.curve.at(s)[0, 2]),
    ], heading


def town(driving_side="right"):
    """Three streets that meet at a junction with signals, a crosswalk and an island.

    Street 1 has two sections (parking ends, a turn lane opens) and a crown; street 2 bends and has
    a bus lane; street 3 is a cubic and has a median.
    """
    side = -1 if driving_side == "right" else 1
    edge = [("curb", 0.2), ("sidewalk", 2.0)]
    closing = Profile(np.array([0.0, 10.0]), np.array([[2.0, 0, 0, 0], [2.0, 0, -0.06, 0.004]]))
    opening = Profile(np.array([0.0, 10.0]), np.array([[0, 0, 0.09, -0.006], [3.0, 0, 0, 0]]))
    one = linked(
        (
            section(
                0.0,
                [("driving", 3.25), ("bicycle", 1.5), ("parking", closing), *edge],
                [("driving", 3.25), *edge],
                side,
            ),
            section(
                20.0,
                [("driving", 3.25), ("bicycle", 1.5), ("driving", opening), *edge],
                [("driving", 3.25), *edge],
                side,
            ),
        ),
        [
            {side * 1: side, side * 2: side * 2, side * 4: side * 4, side * 5: side * 5}
            | {-side * k: -side * k for k in (1, 2, 3)}
        ],
    )
    two = (
        section(
            0.0,
            [("driving", 3.5), ("bus", 3.2), ("shoulder", 0.8), *edge],
            [("driving", 3.5), ("shoulder", 0.8)],
            side,
        ),
    )
    three = (
        section(
            0.0,
            [("median", 0.6), ("driving", 3.0), *edge],
            [("island", 0.6), ("driving", 3.0)],
            side,
        ),
    )
    west = Curve((Piece(-62.0, 0.0, 0.0, 50.0),))
    bend = Curve((Piece(12.0, 0.0, 0.0, 10.0), Piece(22.0, 0.0, 0.0, 40.0, 0.012)))
    south = splined(np.array([[0.5, -12.0], [0.0, -30], [4.0, -45], [12.0, -60]]), -1.6, -0.9)
    crown = Profile(np.array([0.0, 30.0]), np.array([[0.02, 0, 0, 0], [0.02, 0, -1.5e-4, 5e-6]]))
    streets = [
        road(
            1, west, one, crown, name="High Street", ways=(7, 8), successor=RoadLink("junction", 90)
        ),
        road(2, bend, two, name="Bend", kind="secondary", predecessor=RoadLink("junction", 90)),
        road(3, south, three, name="Mill & Co", predecessor=RoadLink("junction", 90)),
    ]
    ways, connections = [], []
    for entry in streets:
        into = [e for e in entry.sections[-1 if entry.id == 1 else 0].lanes if e.kind == "driving"]
        into = [lane for lane in into if lane.forward == (entry.id == 1)]
        for leave in streets:
            out = leave.sections[-1 if leave.id == 1 else 0].lanes
            out = [e for e in out if e.kind == "driving" and e.forward == (leave.id != 1)]
            if entry is leave or not out:
                continue
            lane, target = into[0], out[0]
            start, end = (
                end_pose(entry, lane, leaving=True),
                end_pose(leave, target, leaving=False),
            )
            curve = splined(
                np.array([start[0], end[0]]), start[1], start[1] + turn(end[1] - start[1])
            )
            widths = [
                float(e.width.at((20.0 if r.id == 1 and len(r.sections) > 1 else 0.0) + 10)[0])
                for r, e in ((entry, lane), (leave, target))
            ]
            width = Profile.ramp(*widths, curve.length)
            number = 10 + len(ways)
            inner = SectionLane(
                side, "driving", width, True, 8.33, VEHICLES, "", lane.id, target.id
            )
            ways.append(
                road(
                    number,
                    curve,
                    (LaneSection(0.0, (inner,)),),
                    junction=90,
                    offset=Profile(width.start, -side * width.abcd / 2),
                    predecessor=RoadLink("road", entry.id, "end" if entry.id == 1 else "start"),
                    successor=RoadLink("road", leave.id, "end" if leave.id == 1 else "start"),
                )
            )
            connections.append(Connection(entry.id, number, "start", ((lane.id, side),)))
    junction = ModelJunction(90, "centre", tuple(connections))
    square = np.array([[-1.5, -3.5, 0.01], [1.5, -3.5, 0.01], [1.5, 3.5, 0.01], [-1.5, 3.5, 0.01]])
    areas = (
        RoadArea(101, 1, "crosswalk", "crosswalk", 47.0, square),
        RoadArea(102, ways[0].id, "crosswalk", "crosswalk", 4.0, square),
        RoadArea(103, 1, "roadMark", "StopLine", 44.0, square[:, [1, 0, 2]] * [0.1, 1, 1]),
        RoadArea(104, 2, "trafficIsland", "island", 12.0, square * [1, 0.2, 1], 0.12),
    )
    head = ("OpenDRIVE", "1000001", "-1", math.nan, "")
    signals = (
        RoadSignal(201, 1, "links 0", True, *head, 48.0, side * 5.2, 5.0, "+", (side,), "p", (0,)),
        RoadSignal(
            202, 1, "links 1 2", True, *head, 48.0, side * 6, 3.0, "+", (side * 3,), "p", (1, 2)
        ),
        RoadSignal(
            203, 3, "links 3", True, *head, 1.0, -side * 5, 3.0, "-", (-side * 2,), "p", (3,)
        ),
        RoadSignal(204, 1, "50", False, "DE", "274", "50", 50.0, "km/h", 5.0, side * 7.5, 2.2, "+"),
    )
    controllers = (
        SignalController(
            301, "p", (201, 202, 203), (90,), 4.0, ((20.0, "GGGr"), (3.0, "yyyr"), (12.5, "rrrG"))
        ),
    )
    return LaneModel(driving_side, (*streets, *ways), (junction,), areas, signals, controllers)


def turn(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi
