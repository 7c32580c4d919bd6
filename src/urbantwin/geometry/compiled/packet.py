"""Eight neighbouring rays at a time through the C interface of `intersect`.

Rays close to each other pass the same boxes of the tree. The tree is traversed once for all eight,
in half the time, and each ray has the same hit as with `intersect.intersect`. An address and a
scene are of either library, see `geometry.rays`.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from urbantwin.geometry.compiled import per_block, per_ray

__all__ = ["LANES", "cast", "cast_beside", "met_by", "new_packet"]

#: Rays in a packet.
LANES = 8
#: ``RTC_RAY_QUERY_FLAG_COHERENT``, and every feature (``RTC_FEATURE_FLAG_ALL``) in the upper half.
_COHERENT = np.uint64(0xFFFFFFFF << 32 | 1 << 16)


@intrinsic
def _call(typingctx, address, first, second, third, fourth):
    """Call a C function of four words; `intersect` calls a function of three."""

    def codegen(context, builder, signature, args):
        word = ir.IntType(64)
        function = ir.FunctionType(ir.VoidType(), [word, word, word, word])
        builder.call(builder.inttoptr(args[0], function.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(*[types.uint64] * 5), codegen


@per_block
def new_packet():
    """Return memory for a ``RTCRayHit8``, aligned as Embree requires.

    The result has the rays as (256,) float32, the same words as uint32, the active lanes (8,)
    int32, and the addresses of the rays, of the lanes and of ``RTCIntersectArguments``.
    """
    block = np.zeros(20 + 8 + 256 + 16, np.float32)
    skip = (64 - block.ctypes.data % 64) % 64 // 4
    room = block[skip : skip + 284]
    rays, valid, arguments = room[:256], room[256:264].view(np.int32), room[264:284].view(np.uint64)
    arguments[0] = _COHERENT
    # Values common to all rays: nearest range, time and flags are 0, and no mask is set.
    words = rays.view(np.uint32)
    words[72:80] = 0xFFFFFFFF
    words[144:168] = 0xFFFFFFFF
    return (
        rays,
        words,
        valid,
        np.uint64(rays.ctypes.data),
        np.uint64(valid.ctypes.data),
        np.uint64(arguments.ctypes.data),
    )


@per_ray
def cast(address, scene, packet, rays, count):
    """Cast the rays of the first lanes.

    Args:
        address: address of ``rtcIntersect8`` or `bvh.intersect8`.
        scene: address of a tree of the same library, or 0 for an empty one.
        packet: result of `new_packet`.
        rays: (6, 8), origins and unit vectors; values of inactive lanes are ignored.
        count: number of active lanes.
    """
    floats, words, valid = packet[0], packet[1], packet[2]
    # Without branches over lanes: they become vector instructions.
    for lane in range(LANES):
        floats[lane] = rays[0, lane]
        floats[8 + lane] = rays[1, lane]
        floats[16 + lane] = rays[2, lane]
        floats[32 + lane] = rays[3, lane]
        floats[40 + lane] = rays[4, lane]
        floats[48 + lane] = rays[5, lane]
    floats[64 : 64 + LANES] = np.inf
    words[144 : 144 + LANES] = 0xFFFFFFFF
    for lane in range(LANES):
        valid[lane] = -1 if lane < count else 0
    if scene != 0:
        _call(np.uint64(address), packet[4], np.uint64(scene), packet[3], packet[5])


@per_ray
def met_by(packet, lane):
    """Return range and face of the first hit of a lane's ray; ``inf`` and -1 without a hit."""
    floats, words = packet[0], packet[1]
    if words[144 + lane] == 0xFFFFFFFF:
        return np.float32(np.inf), np.int32(-1)
    return floats[64 + lane], np.int32(words[136 + lane])


@per_block
def cast_beside(address, scene, origins, directions, hits):
    """Write the first `rays.Hits` of rays from origins (N, 3) float32, neighbours in packets."""
    packet, rays = new_packet(), np.zeros((6, LANES), np.float32)
    for start in range(0, len(directions), LANES):
        count = min(LANES, len(directions) - start)
        for lane in range(count):
            for axis in range(3):
                rays[axis, lane] = origins[start + lane, axis]
                rays[3 + axis, lane] = directions[start + lane, axis]
        cast(address, scene, packet, rays, count)
        for lane in range(count):
            hits.range_m[start + lane], hits.face[start + lane] = met_by(packet, lane)
