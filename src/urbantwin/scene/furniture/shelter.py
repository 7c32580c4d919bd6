"""Shelters, cycle stands and parked bicycles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Polygon

from urbantwin.scene.piece import Piece, block
from urbantwin.scene.solids import rods
from urbantwin.scene.tag_values import count_of, length_m_of

__all__ = ["HOUSED", "bicycle", "cycle_stands", "oriented", "shelter"]

#: A wheel of 622 mm with a tyre of 37 mm (ISO 5775), the usual wheelbase of a city bicycle.
WHEEL_M, TYRE_M, BASE_M = 0.34, 0.018, 1.08
#: Corners of a wheel's rim; a few thick spokes represent the real ones, which hide little.
CORNERS, SPOKES = 10, 4
#: Middles of the hubs, crank, top of the seat tube, head, and bars: along the bicycle, and up.
HUB = [(-BASE_M / 2, WHEEL_M), (BASE_M / 2, WHEEL_M)]
CRANK, SEAT, HEAD, BAR = (-0.10, 0.28), (-0.24, 0.80), (0.34, 0.82), (0.30, 1.03)
TUBES = [(CRANK, SEAT), (CRANK, HEAD), (SEAT, HEAD), (HUB[0], CRANK), (HUB[0], SEAT),
         (HUB[1], HEAD), (HEAD, BAR)]  # fmt: skip


def bicycle(x: float, y: float, way: int) -> list[Piece]:
    """Return a bicycle upright at a place, its front ahead (1) or behind (-1), along x."""
    turn = np.arange(CORNERS) * 2 * np.pi / CORNERS
    rim = WHEEL_M * np.column_stack([np.cos(turn), np.sin(turn)])
    rims = np.concatenate([np.add(hub, rim) for hub in HUB])
    nexts = np.concatenate([np.add(hub, np.roll(rim, -1, axis=0)) for hub in HUB])
    half = rim[: CORNERS // 2][:: max(1, CORNERS // 2 // SPOKES)][:SPOKES]
    spokes = np.concatenate([np.add(hub, half) for hub in HUB])
    ends = np.concatenate([np.add(hub, -half) for hub in HUB])
    tubes = np.array(TUBES)

    def tube(a: np.ndarray, b: np.ndarray, radius: float, material: str) -> Piece:
        start, end = (np.column_stack([x + way * p[:, 0], np.full(len(p), y), p[:, 1]])
                      for p in (a, b))  # fmt: skip
        return Piece(rods(start, end, radius, radius, 3), "other-object", material)

    across = np.array([[x + way * BAR[0], y - 0.28, BAR[1]], [x + way * BAR[0], y + 0.28, BAR[1]]])
    return [
        tube(rims, nexts, TYRE_M, "rubber"),
        tube(spokes, ends, 0.008, "metal-bare"),
        tube(tubes[:, 0], tubes[:, 1], 0.018, "metal-painted"),
        Piece(rods(across[0], across[1], 0.014, 0.014, 3), "other-object", "metal-dark"),
        block([x + way * (SEAT[0] - 0.03), y, 0.90], [0.26, 0.15, 0.06], "rubber"),
    ]


#: A bus shelter of three bays: 4 m long, 1.5 m deep, 2.5 m high.
SHELTER_M = (1.5, 4.0, 2.5)
#: A Sheffield stand is a hoop 0.75 m long and 0.8 m high; stands are 0.9 m apart; two bikes each.
HOOP_M, HOOP_HIGH_M, STAND_STEP_M, BIKE_M = 0.75, 0.8, 0.9, 2.0
MOST_STANDS, MOST_BICYCLES, TUBE_M = 80, 40, 0.025
#: Cycle parking that is a box from outside.
HOUSED = ("shed", "lockers", "building", "two-tier")


def oriented(area: Polygon) -> tuple[NDArray[np.float64], float, float, float]:
    """Return the smallest rectangle: middle (2,), yaw across its long side, short and long side."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))[:4]
    first, second = corners[1] - corners[0], corners[2] - corners[1]
    long, short = (first, second) if np.hypot(*first) >= np.hypot(*second) else (second, first)
    yaw = float(np.arctan2(short[1], short[0]))
    return corners.mean(axis=0), yaw, float(np.hypot(*short)), float(np.hypot(*long))


def shelter(tags: Mapping[str, str], deep: float, long: float) -> list[Piece]:
    """Return a shelter with an open front: posts, a roof, three walls, a seat.

    Args:
        tags: ``height``, ``shelter_type``: shelters for public transport are glass, others wood.
        deep: its depth in the direction of its heading, metres.
        long: its width, metres.
    """
    high = min(max(length_m_of(tags.get("height")) or SHELTER_M[2], 2.0), 6.0)
    kind = tags.get("shelter_type", "public_transport")
    wall = "wood" if kind in ("picnic_shelter", "lean_to", "basic_hut", "gazebo") else "glass"
    other = "other-structure"
    posts = max(round(long / 2.0), 1)
    spots = np.linspace(-long / 2 + 0.1, long / 2 - 0.1, posts + 1)
    pieces = [
        block([x, y, 0], [0.08, 0.08, high - 0.1], "metal-dark", other)
        for y in spots.tolist()
        for x in (-deep / 2 + 0.1, deep / 2 - 0.15)
    ]
    pieces.append(block([0, 0, high - 0.1], [deep + 0.2, long + 0.2, 0.1], "metal-painted", other))
    if kind not in ("picnic_shelter", "gazebo", "pavilion", "sun_shelter"):
        pane = high - 0.5
        pieces.append(block([-deep / 2 + 0.03, 0, 0.2], [0.02, long - 0.1, pane], wall, other))
        pieces += [
            block([-0.1, side * (long / 2 - 0.03), 0.2], [deep - 0.5, 0.02, pane], wall, other)
            for side in (1, -1)
        ]
    if tags.get("bench") != "no" and long > 2:
        pieces.append(block([-deep / 2 + 0.4, 0, 0.42], [0.4, 0.6 * long, 0.05], "wood", other))
        pieces += [
            block([-deep / 2 + 0.4, side * 0.25 * long, 0], [0.3, 0.06, 0.42], "metal-dark", other)
            for side in (1, -1)
        ]
    return pieces


def cycle_stands(
    tags: Mapping[str, str],
    deep: float | None,
    long: float | None,
    free: Geometry | None = None,
) -> list[Piece]:
    """Return cycle stands in rows with their bicycles, under a roof if they are covered.

    Lockers and sheds are represented by a box.

    Args:
        tags: ``bicycle_parking``, ``capacity``, ``covered``; ``parked``: share of occupied places.
        deep: the size of the area along its stands, metres; ``None`` if mapped as a point.
        long: its size across.
        free: area for stands, in their own frame: x along them, y across; ``None``: no limit. A
            roof is built only if all stands are possible.
    """
    kind = tags.get("bicycle_parking", "stands")
    if kind in ("informal", "floor", "wall", "handlebar_holder"):
        return []
    capacity = count_of(tags.get("capacity")) or 10
    stands = int(np.clip(np.ceil(capacity / 2), 1, MOST_STANDS))
    rows = 1 if deep is None else max(int(deep / BIKE_M), 1)
    if long is not None and "capacity" not in tags:
        stands = int(np.clip(rows * (long // STAND_STEP_M), 1, MOST_STANDS))
    each = int(np.ceil(stands / rows))
    wide = each * STAND_STEP_M if long is None else long
    deep = BIKE_M * rows if deep is None else deep
    if kind in HOUSED:
        high = {"lockers": 1.3, "two-tier": 2.6}.get(kind, 2.3)
        return [block([0, 0, 0], [deep, wide, high], "metal-painted", "other-structure")]
    low = kind in ("wall_loops", "rack", "anchors", "ground_slots", "crossbar")
    high, reach = (0.45, 0.4) if low else (HOOP_HIGH_M, HOOP_M)
    hoops, places = [], []
    for number in range(stands):
        row, place = divmod(number, each)
        x = (row - (rows - 1) / 2) * deep / rows
        y = (place + 0.5) / each * wide - wide / 2
        a, b = x - reach / 2, x + reach / 2
        if free is not None and not free.covers(LineString([(a, y), (b, y)])):
            continue
        places += [(x, y + 0.17), (x, y - 0.17)]
        hoops.append([[[a, y, -0.3], [a, y, high]], [[b, y, -0.3], [b, y, high]],
                      [[a, y, high], [b, y, high]]])  # fmt: skip
    if not hoops:
        return []
    ends = np.array(hoops).reshape(-1, 2, 3)
    tubes = rods(ends[:, 0], ends[:, 1], TUBE_M, TUBE_M, 6)
    pieces = [Piece(tubes, "other-object", "metal-painted")]
    share = float(tags.get("parked", "0"))
    # A step of the golden ratio spreads the occupied places evenly, without a draw.
    taken = [p for k, p in enumerate(places[:MOST_BICYCLES]) if (0.382 + 0.618 * k) % 1 < share]
    for k, (x, y) in enumerate(taken):
        pieces += bicycle(x, y, 1 if k % 3 else -1)
    if tags.get("covered") == "yes" and len(hoops) == stands:
        cover = {"height": tags.get("height", ""), "shelter_type": "sun_shelter", "bench": "no"}
        pieces += shelter(cover, deep, wide)
    return pieces
