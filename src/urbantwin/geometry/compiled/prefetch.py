"""Prefetching of memory that will be needed soon."""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["prefetch"]

#: Arguments of LLVM's instruction: read access, kept in the nearest cache, data.
_READ, _NEAR, _DATA = 0, 3, 1


@intrinsic
def prefetch(typingctx, array, index):
    """Prefetch an element of a one-dimensional array; an index outside the array has no effect."""

    def codegen(context, builder, signature, args):
        kind, _ = signature.args
        values = context.make_array(kind)(context, builder, args[0])
        place = cgutils.get_item_pointer(
            context, builder, kind, values, [args[1]], wraparound=False
        )
        byte = ir.IntType(8).as_pointer()
        word = ir.IntType(32)
        function = cgutils.get_or_insert_function(
            builder.module,
            ir.FunctionType(ir.VoidType(), [byte, word, word, word]),
            "llvm.prefetch.p0",
        )
        how = [ir.Constant(word, one) for one in (_READ, _NEAR, _DATA)]
        builder.call(function, [builder.bitcast(place, byte), *how])
        return context.get_dummy_value()

    return types.void(array, types.intp), codegen
