"""Matrices of numbers in files of MATLAB, up to version 7."""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import may_unpack, one_line
from urbantwin.errors import InputError

__all__ = ["read_matlab"]

#: MATLAB's classes of numbers, as scipy calls them and as the file numbers them. Cells, structs and
#: texts are no matrices; they are not even read.
_CLASSES = {
    "double": 6, "single": 7, "int8": 8, "uint8": 9, "int16": 10, "uint16": 11, "int32": 12,
    "uint32": 13, "int64": 14, "uint64": 15,
}  # fmt: skip
#: Types of the elements of a matrix: whole numbers of 8 to 32 bits, single, double, 64 bits.
_TYPES = (*range(1, 8), 9, 12, 13)
_MATRIX, _COMPRESSED = 14, 15
_HEADER = 128


def read_matlab(path: Path, expected: str) -> dict[str, NDArray[Any]]:
    """Return the matrices of numbers in a file by their names.

    Raises:
        InputError: missing, damaged, without a matrix, or with one that the file cannot hold.
    """
    from scipy.io import loadmat, whosmat

    try:
        content = path.read_bytes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of names that are given twice
            sizes = {
                name: shape
                for name, shape, kind in whosmat(path, appendmat=False)
                if kind in _CLASSES
            }
            # Eight bytes hold any of these numbers.
            most = sum(8 * math.prod(one) for one in sizes.values())
            negative = any(min(one, default=0) < 0 for one in sizes.values())
            if negative or not may_unpack(most, len(content)):
                raise ValueError("its matrices are larger than it can hold")
            _check_types(content, most)
            read = loadmat(path, appendmat=False, variable_names=list(sizes)) if sizes else {}
        found = {name: np.asarray(read[name]) for name in sizes if name in read}
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except Exception as error:  # scipy's parser raises what it likes
        problem = f"is not readable ({one_line(error)})"
        raise InputError(problem, file=path, expected=expected) from None
    if not found:
        raise InputError("holds no matrix of numbers", file=path, expected=expected)
    return found


def _check_types(content: bytes, most: int) -> None:
    """Refuse a matrix with an element of a type that there is not: scipy looks it up unchecked.

    MathWorks, "MAT-File Format", level 5. Files of level 4 have no such elements.

    Args:
        content: of the file.
        most: bytes that all its matrices take at most.

    Raises:
        ValueError: there is one.
        zlib.error: a packed matrix is damaged.
    """
    order = {b"IM": "<", b"MI": ">"}.get(content[_HEADER - 2 : _HEADER])
    if order is None:
        return
    at = _HEADER
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        inner = content[at + 8 : at + 8 + size]
        at += 8 + size
        if kind == _COMPRESSED:
            # Names, dimensions and padding besides.
            inner = zlib.decompressobj().decompress(inner, most + len(content) + _HEADER)
            kind, inner = int.from_bytes(inner[:4], "little" if order == "<" else "big"), inner[8:]
        if kind != _MATRIX:
            raise ValueError(f"an element is of type {kind}")
        _check_matrix(inner, order)


def _check_matrix(content: bytes, order: str) -> None:
    at = 0
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        short = kind >> 16  # of four bytes at the most: its size stands beside its type
        if kind & 0xFFFF not in _TYPES:
            raise ValueError(f"an element of a matrix is of type {kind & 0xFFFF}")
        flags = struct.unpack_from(f"{order}I", content, at + 8)[0] if at == 0 else None
        if flags is not None and flags & 0xFF not in _CLASSES.values():
            return
        at += 8 if short else 8 + -(-size // 8) * 8
