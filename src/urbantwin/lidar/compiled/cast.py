"""What beams meet: surfaces that fill the whole beam or, at edges, a part of it.

A beam is cast as one ray along its axis and, where its neighbours meet something else, as rays
spread over its footprint as well. A surface that several of a beam's rays meet is one layer: it
says which of the rays (bits of a mask), and the range at which the beam's axis meets its plane.

Embree or the built-in tracer finds what rays meet, see `trace`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.compiled import per_block, per_ray
from urbantwin.geometry.compiled.packet import LANES
from urbantwin.geometry.compiled.prefetch import prefetch
from urbantwin.geometry.rays import Hits
from urbantwin.lidar.casting import layer_rule
from urbantwin.lidar.casting.layer_rule import BEHIND_M, MOST_PANES, MOST_SURFACES, ON_AXIS
from urbantwin.lidar.compiled.edges import NO_RAY, find_edges, on_plane, slant
from urbantwin.lidar.compiled.sensor_pose import PoseRoom, leaves, pose_room, set_poses, turned
from urbantwin.lidar.compiled.trace import (
    TraceRoom,
    cast_waiting,
    first_of,
    trace_room,
    wait,
    wait_around,
)

__all__ = ["cast_blocks"]

_is_same_surface = per_ray(layer_rule.is_same_surface)
_layer_range = per_ray(layer_rule.layer_range)

#: Ways to spread beams over their footprint, see `tracer.Casting`.
_AT_EDGES, _EVERYWHERE = 1, 2
#: Number of beams by which planes are prefetched.
_AHEAD = 8


class _Surfaces(NamedTuple):
    """The surfaces that one beam's rays meet: which (bits), face, sum of ranges, how many rays."""

    mask: NDArray[np.int64]
    face: NDArray[np.int64]
    total_m: NDArray[np.float64]
    rays: NDArray[np.float64]


class _Room(NamedTuple):
    """What the passes over a block's R rays, in K columns, hand on to each other.

    Attributes:
        columns: the poses of the sensor as the block's actor sees it.
        hits: of the beams' axes.
        depth: (R,) float32, room for `edges.find_edges`.
        edge: (R,) whether a neighbour meets another surface.
        surfaces: of one beam.
        share: (3, 8) float64, how much each ray around an axis has of the axis, across and up.
        trace: for the rays that are cast.
    """

    columns: PoseRoom
    hits: Hits
    depth: NDArray[np.float32]
    edge: NDArray[np.bool_]
    surfaces: _Surfaces
    share: NDArray[np.float64]
    trace: TraceRoom


@per_block
def _room(columns, rays, footprint, edge):
    return _Room(
        pose_room(columns),
        Hits(np.empty(rays, np.float32), np.empty(rays, np.int32)),
        np.empty(rays, np.float32),
        np.full(rays, edge, np.bool_),
        _Surfaces(
            np.empty(MOST_SURFACES, np.int64),
            np.empty(MOST_SURFACES, np.int64),
            np.empty(MOST_SURFACES),
            np.empty(MOST_SURFACES),
        ),
        _shares(footprint),
        trace_room(),
    )


@per_block
def _shares(footprint):
    """Return of what the unit vectors of the rays around a beam's axis are made."""
    share = np.zeros((3, LANES))
    share[0] = 1.0
    for sample in range(1, len(footprint)):
        across, up = footprint[sample, 0], footprint[sample, 1]
        size = np.sqrt(1.0 + across * across + up * up)
        lane = sample - 1
        share[0, lane], share[1, lane], share[2, lane] = 1.0 / size, across / size, up / size
    return share


@per_block
def cast_blocks(address, firing, targets, blocks, casting, layers):
    """Cast blocks of rays, each at its own actor, and write the layers that they meet.

    Args:
        address: of the library's functions for one ray and for eight, see `geometry.rays`.
        firing: `tracer.Firing`.
        targets: `processor.Targets`.
        blocks: `tracer.Blocks`.
        casting: `tracer.Casting`.
        layers: `tracer.Layers` to write, with the actors' ``seen`` and ``seen_s`` 0: the latter
            gets the sum of the times at which beams' axes met each actor.

    Returns:
        How many layers there are (written only while there is room).
    """
    everywhere = casting.spread == _EVERYWHERE
    room = _room(len(firing.column_time_s), len(blocks.ray), firing.footprint, everywhere)
    used = np.int64(0)  # a literal 0 would compile `_find_layers` once more
    for block in range(len(blocks.actor)):
        set_poses(firing, targets.paths, blocks, block, room.columns)
        _cast_axes(address, firing, targets, blocks, block, room)
        if casting.spread == _AT_EDGES:
            planes = targets.triangles.planes[targets.first_face[blocks.actor[block]] :]
            find_edges(
                firing, planes, blocks, block, casting.around, room.hits.range_m, room.hits.face,
                room.columns.poses, room.depth, room.edge,
            )  # fmt: skip
        used = _find_layers(address, firing, targets, blocks, block, casting, room, layers, used)
    return used


@per_ray
def _cast_axes(address, firing, targets, blocks, block, room):
    """Cast the axes of a block's beams."""
    actor = blocks.actor[block]
    count = len(firing.column_time_s)
    ring_time, beams = firing.ring_time_s, firing.directions
    rays, face, poses, trace = blocks.ray, room.hits.face, room.columns.poses, room.trace
    start = blocks.start[block]
    until = start + blocks.rows[block] * blocks.wide[block]
    channel, first, lanes = np.int64(0), np.int64(0), 0
    for at in range(start, until):
        ray = np.int64(rays[at])
        if ray < 0:
            face[at] = NO_RAY
            continue
        # Rays of a row are of one channel: a division for each would take as long as its pose.
        if not first <= ray < first + count:
            channel = ray // count
            first = channel * count
        pose = poses[ray - first]
        ox, oy, oz = leaves(pose, ring_time[channel])
        dx, dy, dz = turned(pose, beams[ray, 0], beams[ray, 1], beams[ray, 2])
        wait(trace, lanes, ox, oy, oz, dx, dy, dz)
        trace.waiting.at[lanes] = at
        lanes += 1
        if lanes == LANES:
            cast_waiting(address, targets, actor, trace, lanes)
            _axes_met(room, lanes)
            lanes = 0
    if lanes:
        cast_waiting(address, targets, actor, trace, lanes)
        _axes_met(room, lanes)


@per_ray
def _axes_met(room, count):
    """Write what the rays in the first lanes met: they are axes."""
    at, met = room.trace.waiting.at, room.trace.waiting.hits
    for lane in range(count):
        room.hits.range_m[at[lane]], room.hits.face[at[lane]] = met.range_m[lane], met.face[lane]


@per_ray
def _find_layers(address, firing, targets, blocks, block, casting, room, layers, used):
    """Write the layers of a block's beams from number ``used`` on; return how many there are."""
    actor = blocks.actor[block]
    base, planes = targets.first_face[actor], targets.triangles.planes
    low, high = targets.low, targets.high
    count, column_time, ring_time = (
        len(firing.column_time_s),
        firing.column_time_s,
        firing.ring_time_s,
    )
    beams, footprint = firing.directions, firing.footprint
    range_m, face, rays = room.hits.range_m, room.hits.face, blocks.ray
    poses, edges, surfaces = room.columns.poses, room.edge, room.surfaces
    trace, waiting = room.trace, room.trace.waiting
    whole = (1 << len(footprint)) - 1
    start = blocks.start[block]
    until = start + blocks.rows[block] * blocks.wide[block]
    channel, first = np.int64(0), np.int64(0)
    for at in range(start, until):
        own, ray, edge = face[at], np.int64(rays[at]), edges[at]
        if at + _AHEAD < until and face[at + _AHEAD] >= 0:
            prefetch(planes, base + face[at + _AHEAD])
        if own == NO_RAY:
            continue
        if not first <= ray < first + count:
            channel = ray // count
            first = channel * count
        column, late = ray - first, ring_time[channel]
        if own >= 0:
            layers.seen[actor] += 1
            layers.seen_s[actor] += column_time[column] + late
        elif not edge:
            continue
        pose = poses[column]
        ox, oy, oz = leaves(pose, late)
        bx, by, bz = beams[ray, 0], beams[ray, 1], beams[ray, 2]
        ax, ay, az = turned(pose, bx, by, bz)

        # Which surfaces the beam meets, and which of its rays meet each.
        met = 0
        if not edge and not (casting.glass and planes[base + own].pane):
            # Most beams: one opaque surface meets all of their light.
            surfaces.mask[0], surfaces.face[0] = whole, own
            surfaces.total_m[0], surfaces.rays[0] = range_m[at], 1
            met = 1
        if edge:
            # Across lies level; up is the beam's axis turned by a quarter.
            flat = np.sqrt(bx * bx + by * by)
            ex, ey = 0.0, 1.0
            if flat > 1e-9:
                ex, ey = -by / flat, bx / flat
            across, up = turned(pose, ex, ey, 0.0), turned(pose, -bz * ey, bz * ex, flat)
            wait_around(trace, room.share, (ox, oy, oz), (ax, ay, az), across, up)
            cast_waiting(address, targets, actor, trace, len(footprint) - 1)
        for sample in range(0 if met else (len(footprint) if edge else 1)):
            if sample > 0:
                one = waiting.ray
                dx, dy, dz = one[3, sample - 1], one[4, sample - 1], one[5, sample - 1]
            else:
                dx, dy, dz = ax, ay, az
            bit = 1 << sample if edge else whole
            near = np.float32(0.0)
            for pane in range(MOST_PANES):
                if sample == 0 and pane == 0:
                    far, hit = range_m[at], own
                elif pane == 0:
                    far, hit = waiting.hits.range_m[sample - 1], waiting.hits.face[sample - 1]
                else:
                    far, hit = first_of(
                        address, targets, actor, trace, near, ox, oy, oz, dx, dy, dz
                    )
                if hit < 0:
                    break
                joined = False
                for g in range(met):
                    if joined or surfaces.mask[g] & bit or not edge:
                        continue
                    other = planes[base + surfaces.face[g]]
                    told = on_plane(other, ox, oy, oz, dx, dy, dz)
                    alike = planes[base + hit].pane == other.pane
                    if alike and _is_same_surface(told, np.float64(far)):
                        surfaces.mask[g] |= bit
                        surfaces.total_m[g] += far
                        surfaces.rays[g] += 1
                        joined = True
                if not joined and met < MOST_SURFACES:
                    surfaces.mask[met], surfaces.face[met] = bit, hit
                    surfaces.total_m[met], surfaces.rays[met] = far, 1
                    met += 1
                if not (casting.glass and planes[base + hit].pane):
                    break
                near = far + np.float32(BEHIND_M)

        # Each is a layer, at the range of its plane along the beam's axis.
        on_axis = 0
        if own >= 0 or _crosses(actor, low, high, ox, oy, oz, ax, ay, az):
            on_axis = ON_AXIS
        for g in range(met):
            mask, plane = surfaces.mask[g], planes[base + surfaces.face[g]]
            told = on_plane(plane, ox, oy, oz, ax, ay, az)
            mean = surfaces.total_m[g] / surfaces.rays[g]
            if used < len(layers.ray):
                layers.ray[used], layers.actor[used] = ray, actor
                layers.mask[used] = mask | on_axis
                layers.range_m[used] = _layer_range(told, mean, mask & 1 == 1)
                layers.cosine[used] = abs(slant(plane, ax, ay, az))
                layers.face[used] = surfaces.face[g]
            used += 1
    return used


@per_ray
def _crosses(n, low, high, ox, oy, oz, dx, dy, dz):
    """Return whether a ray passes through a box."""
    enter, leave = 0.0, np.inf
    for axis in range(3):
        o = ox if axis == 0 else (oy if axis == 1 else oz)
        d = dx if axis == 0 else (dy if axis == 1 else dz)
        if abs(d) < 1e-12:
            if o < low[n, axis] or o > high[n, axis]:
                return False
            continue
        one, other = (low[n, axis] - o) / d, (high[n, axis] - o) / d
        enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    return enter <= leave
