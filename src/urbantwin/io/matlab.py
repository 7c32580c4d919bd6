"""Numeric matrices of MATLAB files up to version 7, read by scipy in a child process."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_bytes
from urbantwin.errors import InputError
from urbantwin.io.child import read_in_child

__all__ = ["read_matlab"]

#: MATLAB's numeric classes; cells, structs and texts are not read.
_NUMBERS = {
    "double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
}  # fmt: skip


def read_matlab(path: Path, expected: str) -> dict[str, NDArray[Any]]:
    """Return the numeric matrices of a file by name.

    Raises:
        InputError: missing, damaged, or without a matrix.
    """
    size = len(read_bytes(path, expected))
    matrices: dict[str, NDArray[Any]] = read_in_child(
        "urbantwin.io.matlab:_matrices", path, file=path, size=size, expected=expected
    )
    if not matrices:
        raise InputError("holds no matrix of numbers", file=path, expected=expected)
    return matrices


def _matrices(path: Path) -> dict[str, NDArray[Any]]:
    from scipy.io import loadmat, whosmat

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about duplicate names
        names = [name for name, _, kind in whosmat(path, appendmat=False) if kind in _NUMBERS]
        read = loadmat(path, appendmat=False, variable_names=names) if names else {}
    return {name: np.asarray(read[name]) for name in names if name in read}
