"""Voxels of the traffic, and which of them a sensor's beams cross.

The probabilistic occupancy grid of Hu et al. 2022 (CVPR, "Investigating the Impact of Multi-LiDAR
Placement on Object Detection for Autonomous Driving"): the frequency of occupation of each voxel by
traffic, whose entropy is the information gained by a beam that crosses it. Here beams end at the
static scene, as those of roadside sensors do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.compiled import per_block
from urbantwin.studies.placement.moments import Targets

__all__ = ["Voxels", "occupied_voxels", "passed_voxels"]


@dataclass(frozen=True, eq=False)
class Voxels:
    """V voxels with uncertain occupancy.

    Attributes:
        low: (3,) corner of the grid, site frame, metres.
        edge_m: edge of a voxel, metres.
        number: (nx, ny, nz) int32, number of each voxel; -1 if never or always occupied.
        entropy: (V,) float64, nats.
    """

    low: NDArray[np.float64]
    edge_m: float
    number: NDArray[np.int32]
    entropy: NDArray[np.float64]


def occupied_voxels(targets: Targets, moments: int, edge_m: float) -> Voxels:
    """Return the voxels that the boxes of actors occupy at times.

    A voxel is occupied if its centre is in a box.

    Args:
        targets: boxes of actors.
        moments: number of moments.
        edge_m: edge of a voxel, metres.
    """
    reach = np.hypot(targets.size[:, 0], targets.size[:, 1])[:, None] / 2
    half = np.column_stack([reach, reach, targets.size[:, 2] / 2])
    low = np.floor((targets.middle - half).min(axis=0) / edge_m) * edge_m
    high = (targets.middle + half).max(axis=0)
    shape = np.maximum(np.ceil((high - low) / edge_m).astype(np.int64), 1)
    times = np.zeros(shape, np.int64)
    last = np.full(shape, -1, np.int64)
    order = np.argsort(targets.moment, kind="stable")
    for row in order.tolist():
        first = np.maximum(((targets.middle[row] - half[row] - low) / edge_m).astype(int), 0)
        end = np.minimum(((targets.middle[row] + half[row] - low) / edge_m).astype(int) + 1, shape)
        axes = [low[k] + (np.arange(first[k], end[k]) + 0.5) * edge_m for k in range(3)]
        x, y, z = np.meshgrid(*axes, indexing="ij")
        x, y, z = x - targets.middle[row, 0], y - targets.middle[row, 1], z - targets.middle[row, 2]
        cosine, sine = np.cos(targets.yaw[row]), np.sin(targets.yaw[row])
        length, width, height = targets.size[row]
        inside = (np.abs(x * cosine + y * sine) <= length / 2) & (np.abs(z) <= height / 2)
        inside &= np.abs(y * cosine - x * sine) <= width / 2
        here = tuple(slice(a, b) for a, b in zip(first, end, strict=True))
        inside &= last[here] != targets.moment[row]
        times[here] += inside
        last[here][inside] = targets.moment[row]
    share = times / max(moments, 1)
    uncertain = (share > 0) & (share < 1)
    number = np.full(shape, -1, np.int32)
    number[uncertain] = np.arange(int(uncertain.sum()), dtype=np.int32)
    p = share[uncertain]
    return Voxels(low, edge_m, number, -p * np.log(p) - (1 - p) * np.log(1 - p))


def passed_voxels(
    voxels: Voxels,
    origin: NDArray[np.float64],
    directions: NDArray[np.float64],
    reach_m: NDArray[np.floating],
) -> NDArray[np.bool_]:
    """Return which voxels (V,) beams cross (Amanatides and Woo 1987, Eurographics).

    Args:
        voxels: voxels of the traffic.
        origin: (3,) origin of the beams, site frame.
        directions: (N, 3) unit vectors, site frame.
        reach_m: (N,) length of each beam, metres.
    """
    passed = np.zeros(len(voxels.entropy), np.bool_)
    start = (np.asarray(origin, np.float64) - voxels.low) / voxels.edge_m
    reach = np.minimum(np.asarray(reach_m, np.float64), 1e4) / voxels.edge_m
    _pass(voxels.number, start, np.ascontiguousarray(directions, np.float64), reach, passed)
    return passed


@per_block
def _pass(number, start, directions, reach, passed):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, PLR0912
    """Mark the voxels crossed by rays; all lengths are in voxels."""
    shape = number.shape
    cell = np.empty(3, np.int64)
    edge, per_cell = np.empty(3), np.empty(3)
    step = np.empty(3, np.int64)
    for ray in range(len(directions)):
        t, end = 0.0, reach[ray]
        for axis in range(3):
            slope = directions[ray, axis]
            if slope == 0.0:
                if start[axis] < 0.0 or start[axis] >= shape[axis]:
                    end = -1.0
                continue
            one, other = -start[axis] / slope, (shape[axis] - start[axis]) / slope
            t, end = max(t, min(one, other)), min(end, max(one, other))
        if t >= end:
            continue
        for axis in range(3):
            slope = directions[ray, axis]
            at = int(np.floor(start[axis] + slope * t))
            cell[axis] = min(max(at, 0), shape[axis] - 1)
            step[axis] = 1 if slope > 0.0 else -1
            if slope == 0.0:
                edge[axis], per_cell[axis] = np.inf, np.inf
            else:
                border = cell[axis] + (1 if slope > 0.0 else 0)
                edge[axis], per_cell[axis] = (border - start[axis]) / slope, abs(1.0 / slope)
        while True:
            one = number[cell[0], cell[1], cell[2]]
            if one >= 0:
                passed[one] = True
            axis = 0
            if edge[1] < edge[axis]:
                axis = 1
            if edge[2] < edge[axis]:
                axis = 2
            if edge[axis] >= end:
                break
            cell[axis] += step[axis]
            if cell[axis] < 0 or cell[axis] >= shape[axis]:
                break
            edge[axis] += per_cell[axis]
