"""MATLAB's files of matrices, up to version 7 (scipy reads them; 7.3 is HDF5)."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import may_unpack, one_line
from urbantwin.errors import InputError

__all__ = ["read_matlab"]

#: MATLAB's classes of numbers. Cells, structs and texts are no matrices; they are not even read.
_CLASSES = {
    *("double", "single", "int8", "int16", "int32", "int64"),
    *("uint8", "uint16", "uint32", "uint64"),
}


def read_matlab(path: Path, expected: str) -> dict[str, NDArray[Any]]:
    """Return the matrices of numbers in a file by their names.

    Raises:
        InputError: missing, damaged, without a matrix, or with one that the file cannot hold.
    """
    from scipy.io import loadmat, whosmat

    try:
        size = path.stat().st_size
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of names that are given twice
            sizes = {
                name: shape
                for name, shape, kind in whosmat(path, appendmat=False)
                if kind in _CLASSES
            }
            # Eight bytes hold any of these numbers.
            if any(min(one, default=0) < 0 for one in sizes.values()) or not may_unpack(
                sum(8 * math.prod(one) for one in sizes.values()), size
            ):
                raise ValueError("its matrices are larger than it can hold")
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
