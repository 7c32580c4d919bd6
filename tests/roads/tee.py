"""A T-junction as a lane model, drawn by hand: two lanes each way from the west, one elsewhere."""

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
    turned,
)

ZERO = Profile.constant(0.0)
LANE, WALK = 3.5, 2.0
#: Ends of the streets are this far from the middle; the west's turn lane opens at POCKET.
MOUTH, FAR, POCKET = 14.0, 120.0, 80.0
WEST, EAST, SOUTH, JUNCTION = 1, 2, 3, 90


def lane(number, kind, *, forward, width=LANE, before=None, after=None):
    profile = width if isinstance(width, Profile) else Profile.constant(width)
    speed = {"driving": 50 / 3.6, "sidewalk": 0.0}[kind]
    return SectionLane(
        number, kind, profile, forward, speed, predecessor=before, successor=after,
        height=0.15 if kind == "sidewalk" else 0.0,
    )  # fmt: skip


def road(number, curve, sections, *, slope=(0.0, 0.0), **values):
    x, y, heading = curve.at([0.0])[0]
    rise = slope[0] * math.cos(heading) + slope[1] * math.sin(heading)
    level = slope[0] * x + slope[1] * y
    fields = {"name": "", "kind": "", "ways": (), "junction": -1, "offset": ZERO, "bank": ZERO}
    fields |= {"elevation": Profile(np.zeros(1), np.array([[level, rise, 0.0, 0.0]]))}
    return ModelRoad(
        id=number, curve=curve, crown=ZERO, sections=tuple(sections), **{**fields, **values}
    )


def both_ways(side, s=0.0, extra=(), **links):
    """One lane and a sidewalk each way; ``side`` is the sign of the lanes along the line."""
    lanes = [
        lane(side, "driving", forward=True, **links.get("along", {})),
        lane(2 * side, "sidewalk", forward=True, width=WALK, **links.get("walk", {})),
        lane(-side, "driving", forward=False, **links.get("against", {})),
        lane(-2 * side, "sidewalk", forward=False, width=WALK, **links.get("back", {})),
    ]
    return LaneSection(s, tuple(sorted([*lanes, *extra], key=lambda item: -item.id)))


def tee(driving_side="right", *, slope=(0.0, 0.0), signals=False, crosswalk=True, at=(0.0, 0.0)):
    """The model. West of the junction a second lane to the right opens at ``POCKET``.

    Args:
        slope: rise of streets to the east and to the north.
        signals: one light per approach, with a program: west and east, then south.
        crosswalk: one on the southern street.
        at: where the middle is.
    """
    side = -1 if driving_side == "right" else 1
    x, y = at
    opening = Profile(np.array([0.0, 10.0]), np.array([[0, 0, 0.105, -0.007], [LANE, 0, 0, 0]]))
    first = both_ways(
        side,
        along={"after": side},
        walk={"after": 3 * side},
        against={"after": -side},
        back={"after": -2 * side},
    )
    second = LaneSection(
        FAR - POCKET,
        tuple(
            sorted(
                [
                    lane(side, "driving", forward=True, before=side),
                    lane(2 * side, "driving", forward=True, width=opening),
                    lane(3 * side, "sidewalk", forward=True, width=WALK, before=2 * side),
                    lane(-side, "driving", forward=False, before=-side),
                    lane(-2 * side, "sidewalk", forward=False, width=WALK, before=-2 * side),
                ],
                key=lambda item: -item.id,
            )
        ),
    )
    end = RoadLink("junction", JUNCTION)
    straight = FAR - MOUTH
    streets = {
        WEST: road(
            WEST,
            Curve((Piece(x - FAR, y, 0.0, straight),)),
            [first, second],
            successor=end,
            name="Long Street",
            kind="secondary",
        ),
        EAST: road(
            EAST,
            Curve((Piece(x + MOUTH, y, 0.0, straight),)),
            [both_ways(side)],
            predecessor=end,
            name="Long Street",
            kind="secondary",
        ),
        SOUTH: road(
            SOUTH,
            Curve((Piece(x, y - FAR, math.pi / 2, straight),)),
            [both_ways(side)],
            successor=end,
            name="Short Street",
            kind="residential",
        ),
    }
    # From, lane there, to, lane there: the right lane from the west turns to the kerb's side.
    kerb_turn = (WEST, 2 * side, SOUTH, -side) if side < 0 else (WEST, side, SOUTH, -side)
    ways = [
        (WEST, side, EAST, side),
        kerb_turn,
        (EAST, -side, WEST, -side),
        (EAST, -side, SOUTH, -side),
        (SOUTH, side, WEST, -side),
        (SOUTH, side, EAST, side),
    ]
    roads, connections = list(streets.values()), []
    for number, (a, i, b, j) in enumerate(ways, start=10):
        contact = ["end" if k != EAST else "start" for k in (a, b)]
        start, stop = (pose(streets[k], lane, end=c, entering=n == 0) for n, (k, lane, c) in
                       enumerate(((a, i, contact[0]), (b, j, contact[1]))))  # fmt: skip
        inner = lane(side, "driving", forward=True, before=i, after=j)
        roads.append(
            road(
                number,
                turned(start, stop),
                [LaneSection(0.0, (inner,))],
                junction=JUNCTION,
                offset=Profile.constant(-side * LANE / 2),
                predecessor=RoadLink("road", a, contact[0]),
                successor=RoadLink("road", b, contact[1]),
            )
        )
        connections.append(Connection(a, number, "start", ((i, side),)))
    model = LaneModel(
        driving_side,
        tuple(sloped(item, slope) for item in roads),
        (ModelJunction(JUNCTION, "", tuple(connections)),),
    )
    areas, lights, controllers = (), (), ()
    if crosswalk:
        box = np.array([[-1.5, -5.5, 0.0], [1.5, -5.5, 0.0], [1.5, 5.5, 0.0], [-1.5, 5.5, 0.0]])
        s = straight - 2.0
        areas = (RoadArea(200, SOUTH, "crosswalk", "crosswalk", s, box, marking="dashes"),)
    if signals:
        lights = tuple(light(300 + k, k, side, straight) for k in (WEST, EAST, SOUTH))
        phases = ((30.0, "GGGgrr"), (4.0, "yyyyrr"), (20.0, "rrrrGG"), (4.0, "rrrryy"))
        # Links as the map counts them: two for each approach.
        controllers = (SignalController(400, "main", (301, 302, 303), (JUNCTION,), 7.0, phases),)
    return LaneModel(driving_side, model.roads, model.junctions, areas, lights, controllers)


def light(number, street, side, length):
    onward = street != EAST
    first = {WEST: 0, EAST: 2, SOUTH: 4}[street]
    return RoadSignal(
        number, street, "", True, "OpenDRIVE", "1000001", "-1", math.nan, "",
        length if onward else 0.0, (1 if onward else -1) * side * 8.0, 4.0,
        "+" if onward else "-", (), "main", (first, first + 1),
    )  # fmt: skip


def pose(street, number, *, end, entering):
    """Middle of a lane at a street's end, and the heading of the traffic there."""
    s = street.length if end == "end" else 0.0
    section = street.sections[-1 if end == "end" else 0]
    item = section.by_id[number]
    x, y = street.curve.beside(s, street.middle(section, item, s))[0]
    heading = float(street.curve.at([s])[0, 2]) + (0.0 if item.forward else math.pi)
    assert item.forward == ((end == "end") == entering)
    return np.array([x, y, math.remainder(heading, math.tau)])


def sloped(item, slope):
    """Return a road whose reference line lies on a plane, level across."""
    s = np.linspace(0.0, item.length, 60)
    x, y = item.curve.at(s)[:, :2].T
    z = slope[0] * x + slope[1] * y
    abcd = np.zeros((59, 4))
    abcd[:, 0], abcd[:, 1] = z[:-1], np.diff(z) / np.diff(s)
    heading = item.curve.at(s)[:, 2]
    across = np.arctan(slope[1] * np.cos(heading) - slope[0] * np.sin(heading))
    bank = np.zeros((59, 4))
    bank[:, 0], bank[:, 1] = across[:-1], np.diff(across) / np.diff(s)
    return ModelRoad(
        **{**{k: getattr(item, k) for k in item.__dataclass_fields__},
           "elevation": Profile(s[:-1], abcd), "bank": Profile(s[:-1], bank)}
    )  # fmt: skip
