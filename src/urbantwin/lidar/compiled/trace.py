"""Rays at actors and at the street: eight neighbours at a time.

Embree or the built-in tracer finds what they meet, see `geometry.rays`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.compiled import packet, per_block, per_ray
from urbantwin.geometry.compiled.intersect import intersect, new_ray
from urbantwin.geometry.compiled.planes import first_met
from urbantwin.geometry.compiled.prefetch import prefetch
from urbantwin.geometry.rays import Hits
from urbantwin.lidar.casting.layer_rule import GRAZING
from urbantwin.lidar.compiled.edges import slant

__all__ = ["TraceRoom", "cast_waiting", "first_of", "trace_room", "wait", "wait_around"]

_LANES = packet.LANES
_cast, _met_by, _new_packet = packet.cast, packet.met_by, packet.new_packet


class _Waiting(NamedTuple):
    """Rays that are cast next, by lane.

    Attributes:
        at: (8,) int64, whose ray it is, among the rays of all blocks.
        ray: (6, 8) float64, origin and unit vector.
        hits: (8,) what they met.
    """

    at: NDArray[np.int64]
    ray: NDArray[np.float64]
    hits: Hits


class TraceRoom(NamedTuple):
    """Rays as the libraries of `geometry.rays` take them.

    Attributes:
        ray: one, see `intersect.new_ray`.
        packet: eight, see `packet.new_packet`.
        waiting: those eight.
    """

    ray: tuple[NDArray[np.float32], NDArray[np.uint32], np.uint64]
    packet: tuple[
        NDArray[np.float32], NDArray[np.uint32], NDArray[np.int32], np.uint64, np.uint64, np.uint64
    ]
    waiting: _Waiting


@per_block
def trace_room():
    """Return room for rays."""
    return TraceRoom(
        new_ray(),
        _new_packet(),
        _Waiting(
            np.empty(_LANES, np.int64),
            np.zeros((6, _LANES)),
            Hits(np.empty(_LANES, np.float32), np.empty(_LANES, np.int32)),
        ),
    )


@per_ray
def wait(room, lane, ox, oy, oz, dx, dy, dz):
    """Put a ray into a lane."""
    ray = room.waiting.ray
    ray[0, lane], ray[1, lane], ray[2, lane] = ox, oy, oz
    ray[3, lane], ray[4, lane], ray[5, lane] = dx, dy, dz


@per_ray
def wait_around(room, share, origin, axis, across, up):
    """Put rays around the axis of a beam into all lanes.

    Args:
        room: `TraceRoom`.
        share: (3, 8) float64, of the ray in each lane: how much it has of the three vectors.
        origin: (3,) where all leave.
        axis: (3,) unit vector of the beam.
        across: (3,) unit vector across it.
        up: (3,) unit vector across both.
    """
    ray = room.waiting.ray
    # Loops without branches over one kind of array each: they become vector instructions.
    for lane in range(_LANES):
        ray[0, lane], ray[1, lane], ray[2, lane] = origin
    for lane in range(_LANES):
        k, m, n = share[0, lane], share[1, lane], share[2, lane]
        ray[3, lane] = k * axis[0] + m * across[0] + n * up[0]
        ray[4, lane] = k * axis[1] + m * across[1] + n * up[1]
        ray[5, lane] = k * axis[2] + m * across[2] + n * up[2]


@per_ray
def cast_waiting(address, targets, actor, room, count):
    """Cast the rays of the first lanes at an actor, as a packet.

    Args:
        address: of the library's functions for one ray and for eight, see `geometry.rays`.
        targets: `processor.Targets`.
        actor: its number.
        room: `TraceRoom`; its ``waiting.hits`` are written.
        count: how many lanes.
    """
    ray, met = room.waiting.ray, room.waiting.hits
    tree, planes = targets.tree[actor], targets.triangles.planes
    base = targets.first_face[actor]
    _cast(address[1], tree, room.packet, ray, count)
    for lane in range(count):
        met.range_m[lane], met.face[lane] = _met_by(room.packet, lane)
        # Rays meet triangles all over a mesh: their planes come from far off, while the next rays
        # are cast. A plane may reach into the line of memory in which the next one begins.
        if met.face[lane] >= 0:
            prefetch(planes, base + met.face[lane])
            prefetch(planes, base + met.face[lane] + 1)
    for lane in range(count):
        met.range_m[lane], met.face[lane] = _confirmed(
            address, targets, actor, room, np.float32(0.0), met.range_m[lane], met.face[lane],
            ray[0, lane], ray[1, lane], ray[2, lane], ray[3, lane], ray[4, lane], ray[5, lane],
        )  # fmt: skip


@per_ray
def first_of(address, targets, actor, room, near, ox, oy, oz, dx, dy, dz):
    """Return range and face of what a ray meets first of an actor beyond ``near``."""
    tree = targets.tree[actor]
    found, hit = intersect(address[0], tree, room.ray, near, ox, oy, oz, dx, dy, dz)
    return _confirmed(address, targets, actor, room, near, found, hit, ox, oy, oz, dx, dy, dz)


@per_ray
def _confirmed(address, targets, actor, room, near, found, hit, ox, oy, oz, dx, dy, dz):
    """Return range and face of a hit, or of what comes in its place."""
    planes, vertices, corners = targets.triangles
    base = targets.first_face[actor]
    if hit < 0 or abs(slant(planes[base + hit], dx, dy, dz)) >= GRAZING:
        return found, hit
    # Along a triangle single precision knows but rounding: see ``planes``.
    return first_met(
        address[0], targets.tree[actor], room.ray, vertices, corners[base:], near,
        ox, oy, oz, dx, dy, dz,
    )  # fmt: skip
