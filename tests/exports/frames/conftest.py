"""Two small datasets to write in other formats: of two fused sensors, and of a rig that rides."""

import numpy as np
import pytest

from urbantwin.dataset import record
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar import place_rig

from ...dataset.conftest import _rig_spec, motion, motion_of, twin

__all__ = ["motion", "motion_of", "twin"]

_SENSORS = [
    {
        **_rig_spec().sensors[0].model_dump(exclude_none=True),
        "returns": "dual",
    },
    {
        "name": "mast",
        "model": "VLP-16",
        "columns": 900,
        "east_m": 12.0,
        "north_m": -9.0,
        "height_m": 4.5,
        "pitch_deg": -4.0,
        "roll_deg": 2.0,
        "yaw_deg": -100.0,
        "phase_deg": 90.0,
    },
]


@pytest.fixture(scope="session")
def two_sensors(twin, motion, tmp_path_factory):
    """12 frames of two fused sensors; in the first two nobody is there."""
    out = tmp_path_factory.mktemp("two-sensors") / "dataset"
    record(twin, motion, place_rig(_rig_spec(sensors=_SENSORS), twin.mesh), out, workers=1, seed=5)
    return out


@pytest.fixture(scope="session")
def riding(twin, motion, tmp_path_factory):
    """8 frames of a sensor that rides on the first car: the frame of its points moves."""
    out = tmp_path_factory.mktemp("riding") / "dataset"
    spec = _rig_spec(
        ride={"track": 4},
        sensors=[
            {
                "name": "roof",
                "model": "VLP-16",
                "columns": 900,
                "forward_m": 0.3,
                "left_m": 0.1,
                "above_roof_m": 0.4,
            }
        ],
    )
    record(twin, motion, place_rig(spec, twin.mesh), out, workers=1, seed=5, start_s=0.4)
    return out


@pytest.fixture(scope="session")
def same_frames():
    """Return what compares the frames of two recordings in all that a format holds.

    ``same(dataset, exported, holds, within_m, in_site)``: coordinates and boxes to ``within_m``;
    what is not in ``holds`` is not there.
    """

    def same(dataset, exported, holds, *, within_m=0.0, in_site=False):
        ours, theirs = open_recording(dataset), open_recording(exported)
        assert len(ours) == len(theirs) > 0
        for wanted, found in zip(ours, theirs, strict=True):
            assert found.name == wanted.name
            place = wanted.world_SE3_frame
            mine = wanted.moved(place) if in_site else wanted
            _same(found.points, mine.points, within_m + 1e-12)
            for name in ("ring", "column", "sensor", "semantic", "instance"):
                if name in holds:
                    assert (getattr(found, name) == getattr(mine, name)).all(), name
            for name, off in (("intensity", 1e-5), ("time_s", 1e-7)):
                if name.removesuffix("_s") in holds:
                    _same(getattr(found, name), getattr(mine, name), off)
            if "boxes" in holds:
                _same_boxes(mine.boxes, found.boxes, holds, within_m)
            if "frame_pose" in holds:
                pose = mine.world_SE3_frame
                assert found.world_SE3_frame.rotation == pytest.approx(pose.rotation, abs=1e-9)
                assert found.world_SE3_frame.translation == pytest.approx(
                    pose.translation, abs=1e-9
                )
            if "sensor_poses" in holds:
                assert found.sensor_places == pytest.approx(mine.sensor_places, abs=1e-6)

    return same


def _same(found, wanted, within):
    """Numbers of every point, which `pytest.approx` compares one by one."""
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=within)


def _same_boxes(wanted, found, holds, within_m):
    assert len(found) == len(wanted)
    if not len(wanted):
        return
    assert found.source_names == wanted.source_names
    assert found.box[:, :6] == pytest.approx(wanted.box[:, :6], abs=within_m + 1e-9)
    turn = found.box[:, 6] - wanted.box[:, 6]
    assert np.abs(np.sin(turn / 2)).max(initial=0) < within_m + 1e-9
    for name in ("track", "num_points", "velocity"):
        if name in holds:
            assert getattr(found, name) == pytest.approx(getattr(wanted, name), abs=1e-9)
    if "occlusion" in holds:
        assert found.occlusion == pytest.approx(wanted.occlusion, nan_ok=True)
    if "ignored" in holds:
        assert found.ignored == wanted.ignored
