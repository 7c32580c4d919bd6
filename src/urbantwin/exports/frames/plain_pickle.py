"""Pickles readable by every NumPy: numbers, texts, lists, mappings and arrays.

NumPy 2 pickles arrays with a module that NumPy 1 lacks, and OpenPCDet and MMDetection3D run on
NumPy 1. Here an array is pickled as a call of ``numpy.ndarray`` with shape, type and bytes, which
both support, and which gives a writable array. The same content gives the same bytes.
"""

from __future__ import annotations

import pickle
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["write_plain_pickle"]

#: Python 3.4 reads it.
_PROTOCOL = 4


class _Plain(pickle.Pickler):
    def reducer_override(self, obj: object) -> Any:  # noqa: ANN401 - as the library has it
        if isinstance(obj, np.ndarray) and not obj.dtype.hasobject:
            return np.ndarray, (obj.shape, obj.dtype.str, bytearray(obj.tobytes()))
        if isinstance(obj, np.generic):
            raise TypeError(f"{obj!r} is NumPy's")  # scalars must be Python's own
        return NotImplemented


def write_plain_pickle(path: Path, content: object) -> None:
    """Write a pickle.

    Args:
        path: the file.
        content: Python lists, mappings, numbers and texts, and arrays.
    """
    stream = BytesIO()
    pickler = _Plain(stream, _PROTOCOL)
    pickler.fast = True  # otherwise bytes depend on object identity
    pickler.dump(content)
    path.write_bytes(stream.getvalue())
