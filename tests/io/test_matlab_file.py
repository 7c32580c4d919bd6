"""Matrices of MATLAB's files, as scipy writes them, and files that end scipy's own reader."""

import struct
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from urbantwin.errors import InputError
from urbantwin.io.matlab import read_matlab

RANGES = np.arange(12.0).reshape(3, 4)
BESIDE = {
    "note": "a text",
    "made": {"by": "somebody"},
    "cells": np.array([1, "s"], object),
    "few": np.array([[1, -2]], np.int16),
}


@pytest.mark.parametrize("packed", [True, False])
def test_matrices_are_read_beside_what_is_none(tmp_path, packed):
    savemat(tmp_path / "a.mat", {**BESIDE, "ranges": RANGES}, do_compression=packed)
    found = read_matlab(tmp_path / "a.mat", "a matrix")
    assert set(found) == {"ranges", "few"}
    np.testing.assert_array_equal(found["ranges"], RANGES)


def test_files_of_level_4_are_read(tmp_path):
    savemat(tmp_path / "a.mat", {"ranges": RANGES}, format="4")
    np.testing.assert_array_equal(read_matlab(tmp_path / "a.mat", "a matrix")["ranges"], RANGES)


@pytest.mark.parametrize("packed", [True, False])
def test_an_element_of_a_type_that_there_is_not_is_told(tmp_path, packed):
    """scipy takes the type as an index, unchecked, and the process ends."""
    path = tmp_path / "a.mat"
    savemat(path, {"ranges": RANGES})
    data = path.read_bytes()
    of_doubles = struct.pack("<II", 9, RANGES.nbytes)
    assert data.count(of_doubles) == 1
    bad = data.replace(of_doubles, struct.pack("<II", 1033, RANGES.nbytes))
    if packed:
        inner = zlib.compress(bad[128:])
        bad = bad[:128] + struct.pack("<II", 15, len(inner)) + inner
    path.write_bytes(bad)
    with pytest.raises(InputError, match="cannot be read"):
        read_matlab(path, "a matrix")
