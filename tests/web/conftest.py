"""A small place to look at: twin, motion and a dataset of 25 frames, one in a folder."""

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from urbantwin.dataset import record

from ..dataset.conftest import motion_of, rig, rig_spec, twin

__all__ = ["motion_of", "rig", "rig_spec", "twin"]

#: Frames of the dataset: more than the 20 that a browser plays.
FRAMES = 25
TRUCK, HIDDEN, WALKER, LATE = 4, 9, 12, 20


@pytest.fixture(scope="session")
def place(twin, motion_of, rig, made_once) -> Path:
    """A truck stands between the sensor and a car; one walks; one comes late, towards another."""
    rows = []
    for step in range(FRAMES):
        time_s = round(step * 0.1, 9)
        truck = {"track": TRUCK, "class": "truck", "asset": "truck-box-7t5", "x": 12.0, "y": 0.0}
        truck |= {"yaw": np.pi / 2, "length": 8.0, "width": 2.4, "height": 3.2}
        car = {
            "track": HIDDEN,
            "class": "car",
            "asset": "car-sedan",
            "x": 17.0,
            "y": 1.0,
            "yaw": np.pi / 2,
        }
        walker = {"track": WALKER, "class": "pedestrian", "asset": "pedestrian-man", "x": 6.0}
        walker |= {"y": -6.0 + time_s, "yaw": np.pi / 2, "speed": 1.0}
        here = [truck, car, walker]
        if step >= 10:
            late = {"track": LATE, "class": "car", "asset": "car-sedan", "y": -2.4, "speed": 10.0}
            here.append({**late, "x": -28.0 + 10 * (time_s - 1.0)})
        rows += [{"time_s": time_s, **one} for one in here]

    def make(folder: Path) -> None:
        shutil.copytree(twin.folder, folder / "twin")
        motion = motion_of(twin, rows, steps=FRAMES)
        record(twin, motion, rig, folder / "dataset", workers=1, seed=5)

    return made_once("looked-at", make)


@pytest.fixture(scope="session")
def dataset(place: Path) -> Path:
    return place / "dataset"


@pytest.fixture(scope="session")
def unpacked() -> Callable[[bytes], tuple[dict[str, Any], dict[str, np.ndarray]]]:
    """What reads a packet by the words of docs/reference/formats.md alone."""

    def read(data: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        magic, length = struct.unpack_from("<4sI", data)
        assert magic == b"UTWP"
        assert (8 + length) % 8 == 0
        header = json.loads(data[8 : 8 + length])
        arrays = {}
        for one in header["arrays"]:
            assert one["offset"] % 8 == 0
            count = int(np.prod(one["shape"]))
            begin = 8 + length + one["offset"]
            values = np.frombuffer(data, f"<{one['type']}", count, begin)
            arrays[one["name"]] = values.reshape(one["shape"])
        return header, arrays

    return read
