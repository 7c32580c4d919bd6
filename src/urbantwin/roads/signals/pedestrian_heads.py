"""Placing pedestrian signal heads at both ends of their crossing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.roads.model import LaneModel, RoadSignal
from urbantwin.roads.signals.approach import Frame
from urbantwin.roads.signals.pole_sites import FreeGround

__all__ = ["pedestrian_heads"]

#: Middle of a head over the carriageway: 2.2 m clear of the footway (MUTCD 4E.05: 2.1 m), metres.
WALK_M = 2.65
#: Height and width of a head of two lights of 200 mm, metres.
WALKER_SIZE = (0.6, 0.3)


def pedestrian_heads(
    model: LaneModel,
    signal: RoadSignal,
    centre: NDArray[np.float64],
    width: float,
    ground: FreeGround,
) -> list[RoadSignal]:
    """Return a head at each end of a crossing, facing the other end."""
    area = next((a for a in model.areas if a.strip == signal.strip), None)
    road = model.road_by_id[area.road if area else signal.road]
    found = []
    for end, other in ((centre[0], centre[1]), (centre[-1], centre[-2])):
        outward = math.atan2(end[1] - other[1], end[0] - other[0])
        frame = Frame(float(end[0]), float(end[1]), outward)
        spot = _beside_crossing(frame, width / 2 + 0.3, ground, road.level)
        if spot is None:
            continue
        xy = frame.place(*spot)
        pose = (
            float(xy[0, 0]),
            float(xy[0, 1]),
            WALK_M,
            wrapped(outward + math.pi),
        )
        s, t = (float(value[0]) for value in road.curve.locate(xy))
        found.append(
            replace(
                signal,
                road=road.id,
                s=float(np.clip(s, 0.0, road.length)),
                t=t,
                z=WALK_M,
                orientation="none",
                lanes=(),
                height=WALKER_SIZE[0],
                width=WALKER_SIZE[1],
                pose=pose,
            )
        )
    return found or [signal]


def _beside_crossing(
    frame: Frame, side: float, ground: FreeGround, level: int
) -> NDArray[np.float64] | None:
    """Return u, v of the nearest free place beyond a crossing's end, on either side of it."""
    u = np.arange(0.4, 9.0, 0.4)
    for v in (np.array([side]), np.arange(side + 0.4, side + 2.8, 0.4)):
        grid = np.stack(np.meshgrid(u, [*v, *-v], indexing="ij"), axis=-1).reshape(-1, 2)
        cost = grid[:, 0] + np.abs(grid[:, 1])
        found = ground.cheapest(frame.place(grid[:, 0], grid[:, 1]), cost, level)
        if found is not None:
            return np.asarray(grid[found])
    return None
