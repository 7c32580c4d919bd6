"""One ray at a time through Embree's C interface, which the built-in tracer also has.

An address and a scene are of either library, see `geometry.rays`.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from urbantwin.geometry.compiled import per_block, per_ray

__all__ = ["cast_rays", "intersect", "new_ray"]


@intrinsic
def _call(typingctx, address, first, second, third):
    """Call a C function of three words at an address that is known when the code runs.

    A function that uses a ctypes function cannot be stored in numba's cache; a function with an
    address as an argument can.
    """

    def codegen(context, builder, signature, args):
        word = ir.IntType(64)
        function = ir.FunctionType(ir.VoidType(), [word, word, word])
        builder.call(builder.inttoptr(args[0], function.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.uint64, types.uint64, types.uint64, types.uint64), codegen


@per_block
def new_ray():
    """Return memory for a ``RTCRayHit``, aligned as Embree requires.

    The result has (32,) float32, the same words as uint32, and their address.
    """
    block = np.zeros(64, np.float32)
    skip = (64 - block.ctypes.data % 64) % 64 // 4
    room = block[skip : skip + 32]
    return room, room.view(np.uint32), np.uint64(room.ctypes.data)


@per_ray
def intersect(address, scene, ray, near, ox, oy, oz, dx, dy, dz):
    """Return range and face of the first hit beyond ``near``; ``inf`` and -1 without one.

    ``address`` is that of ``rtcIntersect1`` or `bvh.intersect1`, and ``scene`` that of a tree of
    the same library, or 0 for an empty one. ``ray`` is the result of `new_ray`. The ray starts at o
    and has the direction d, a unit vector.
    """
    if scene == 0:
        return np.float32(np.inf), np.int32(-1)
    floats, words, place = ray
    floats[0], floats[1], floats[2], floats[3] = ox, oy, oz, near
    floats[4], floats[5], floats[6], floats[7] = dx, dy, dz, 0.0
    floats[8] = np.inf
    words[9], words[10], words[11] = 0xFFFFFFFF, 0, 0
    words[18], words[19], words[20] = 0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF
    _call(np.uint64(address), np.uint64(scene), place, np.uint64(0))
    if words[18] == 0xFFFFFFFF:
        return np.float32(np.inf), np.int32(-1)
    return floats[8], np.int32(words[17])


@per_block
def cast_rays(address, scene, origins, directions, hits):
    """Write the first `rays.Hits` of rays from origins (N, 3) float32."""
    ray = new_ray()
    for n in range(len(directions)):
        hits.range_m[n], hits.face[n] = intersect(
            address,
            scene,
            ray,
            np.float32(0.0),
            origins[n, 0],
            origins[n, 1],
            origins[n, 2],
            directions[n, 0],
            directions[n, 1],
            directions[n, 2],
        )
