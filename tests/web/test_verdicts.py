"""Detections over labels: what hits, what misses, what is a false alarm."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from urbantwin.detections import joined, write_detections
from urbantwin.errors import InputError
from urbantwin.web import open_shown
from urbantwin.web.wanted import Wanted

from .conftest import LATE, TRUCK, WALKER

FRAME = "000020"


@pytest.fixture(scope="module")
def detections(dataset, tmp_path_factory):
    """In one frame: the truck found twice, the walker a little beside, a car where none is."""
    rows = {
        row["track"]: row
        for row in pq.read_table(dataset / "boxes.parquet").to_pylist()
        if row["frame"] == FRAME
    }
    assert min(rows[one]["num_points"] for one in (TRUCK, WALKER, LATE)) >= 5
    fields = ("x", "y", "z", "length", "width", "height", "yaw")
    box = {one: np.array([rows[one][name] for name in fields]) for one in (TRUCK, WALKER, LATE)}
    beside = box[WALKER] + [0.2, 0.1, 0, 0, 0, 0, 0.1]
    nowhere = box[LATE] + [0, 15.0, 0, 0, 0, 0, 0]
    found = np.array([box[TRUCK], box[TRUCK] + [0.5, 0, 0, 0, 0, 0, 0], beside, nowhere])
    kinds = ["truck", "truck", "pedestrian", "car"]
    nothing = (np.zeros((0, 7)), [], np.zeros(0))
    both = joined(["000019", FRAME], [nothing, (found, kinds, np.array([0.9, 0.8, 0.7, 0.6]))])
    folder = tmp_path_factory.mktemp("found") / "detections"
    write_detections(folder, both, {"model": "by hand"})
    return folder


def test_every_detection_and_every_object_has_its_verdict(dataset, detections, unpacked):
    for wanted in (Wanted(dataset, detections=detections), Wanted(dataset, detections)):
        shown = open_shown(wanted)
        assert shown.document()["detections"] is True
        header, _ = unpacked(shown.packet(f"boxes/0/{int(FRAME)}"))
        boxes = header["boxes"]
        labels = {one["track"]: one for one in boxes if one["score"] is None}
        found = [one for one in boxes if one["score"] is not None]
        assert [one["score"] for one in found] == [0.9, 0.8, 0.7, 0.6]
        verdicts = [one["verdict"] for one in found]
        assert verdicts == ["hit", "false alarm", "hit", "false alarm"]
        assert boxes[found[0]["match"]]["track"] == TRUCK
        assert boxes[found[2]["match"]]["track"] == WALKER
        assert "match" not in found[1]
        assert labels[TRUCK]["verdict"] == labels[WALKER]["verdict"] == "hit"
        assert labels[LATE]["verdict"] == "miss"
        # Detections stand where labels do: in the frame of the scene.
        assert found[0]["box"][:3] == pytest.approx(labels[TRUCK]["box"][:3], abs=1e-3)
        turn = np.sin((found[0]["box"][6] - labels[TRUCK]["box"][6]) / 2)
        assert abs(turn) < 1e-3


def test_a_frame_that_was_looked_at_without_a_box_has_misses_alone(dataset, detections, unpacked):
    shown = open_shown(Wanted(dataset, detections=detections))
    header, _ = unpacked(shown.packet("boxes/0/19"))
    assert {one["verdict"] for one in header["boxes"]} <= {None, "miss"}
    assert any(one["verdict"] == "miss" for one in header["boxes"])
    header, _ = unpacked(shown.packet("boxes/0/2"))  # nobody looked at this one
    assert {one["verdict"] for one in header["boxes"]} == {None}


def test_detections_of_other_frames_are_refused(dataset, tmp_path):
    other = joined(["elsewhere"], [(np.zeros((0, 7)), [], np.zeros(0))])
    write_detections(tmp_path / "detections", other, {})
    with pytest.raises(InputError, match="none of the frames"):
        open_shown(Wanted(dataset, detections=tmp_path / "detections"))
    with pytest.raises(InputError, match="no dataset lies beside"):
        open_shown(Wanted(tmp_path / "detections"))
