"""Detections beside the frames that are observed: by the names of frames, the likely ones."""

import numpy as np
import pytest

from urbantwin.detections import Detections, write_detections
from urbantwin.errors import InputError
from urbantwin.interface.observed_traffic import detected_actors


def written(folder):
    names = ("pedestrian", "car", "bicycle", "pedestrian")
    box = np.array([[k, 2.0, 0.5, 0.8, 0.6, 1.7, 0.3] for k in range(4)])
    found = Detections(
        ("0002.bin", "0001.bin"),
        np.array([0, 0, 1, 1]),
        box,
        names,
        np.array([0.9, 0.9, 0.41, 0.39]),
        np.full(4, -1),
    )
    write_detections(folder, found, {"by": "hand"})
    return folder


def test_people_and_riders_who_are_likely_come_frame_by_frame(tmp_path):
    first, second = detected_actors(written(tmp_path / "found"), ["0001", "0002"])
    assert [(one.actor_class, *one.place) for one in first] == [("bicycle", 2.0, 2.0)]
    assert [(one.actor_class, *one.place) for one in second] == [("pedestrian", 0.0, 2.0)]
    assert (second[0].size, second[0].yaw) == ((0.8, 0.6, 1.7), 0.3)


def test_a_frame_that_was_not_looked_at_is_named(tmp_path):
    with pytest.raises(InputError, match="frame 0003 was not looked at"):
        detected_actors(written(tmp_path / "found"), ["0001", "0003"])


def test_a_folder_without_detections_is_refused(tmp_path):
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match="none"):
        detected_actors(tmp_path / "none", ["0001"])
