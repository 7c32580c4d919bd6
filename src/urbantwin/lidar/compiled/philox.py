"""Random words by counting: Philox4x64-10 (Salmon et al. 2011), word for word numpy's.

Numpy hands out one word at a time; here blocks of four follow each other, and the processor works
on several at once.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from urbantwin.geometry.compiled import per_ray

__all__ = ["fill_words"]

_ROUNDS = 10
#: Multipliers of the rounds, and what their keys grow by.
_M_0, _M_1 = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
_W_0, _W_1 = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)


@intrinsic
def _high_product(_typing, one, other):
    """Return the upper half of the product of two words, for which Python has no operator."""

    def generate(_context, builder, _signature, words):
        wide = ir.IntType(128)
        product = builder.mul(*(builder.zext(word, wide) for word in words))
        return builder.trunc(builder.lshr(product, wide(64)), ir.IntType(64))

    return types.uint64(one, other), generate


@per_ray
def fill_words(key, stream, out):
    """Fill words (4 B,) uint64: ``Philox(key=key, counter=[0, 0, 0, stream]).random_raw``.

    Args:
        key: (2,) uint64.
        stream: uint64.
        out: to write.
    """
    for block in range(len(out) // 4):
        a, b, c, d = np.uint64(block + 1), np.uint64(0), np.uint64(0), stream
        k, m = key[0], key[1]
        for _ in range(_ROUNDS):
            high, higher = _high_product(_M_0, a), _high_product(_M_1, c)
            a, b, c, d = higher ^ b ^ k, _M_1 * c, high ^ d ^ m, _M_0 * a
            k, m = k + _W_0, m + _W_1
        at = 4 * block
        out[at], out[at + 1], out[at + 2], out[at + 3] = a, b, c, d
