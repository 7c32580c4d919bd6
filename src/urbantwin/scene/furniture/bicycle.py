"""Parked bicycles: wheels, a frame of tubes, bars and a saddle."""

from __future__ import annotations

import numpy as np

from urbantwin.scene.furniture.piece import Piece, block
from urbantwin.scene.solids import rods

__all__ = ["bicycle"]

#: A wheel of 622 mm with a tyre of 37 mm (ISO 5775), the usual wheelbase of a city bicycle.
WHEEL_M, TYRE_M, BASE_M = 0.34, 0.018, 1.08
#: Corners of a wheel's rim; spokes hide little, few thick ones stand for them.
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
