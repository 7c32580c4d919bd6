"""Outages of sectors and channels, by where the beams point."""

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.lidar.beams import dead_beams
from urbantwin.lidar.pattern import beam_directions


def dead(rig_of, ground_mesh, outage, time_s=1.0, model="VLP-16"):
    rig = rig_of(ground_mesh(), {"model": model, "outages": [outage]})
    one = rig.sensors[0]
    return one, dead_beams(one, time_s)


@pytest.mark.parametrize("model", ["VLP-16", "OS1-32", "VLP-32C"])
@pytest.mark.parametrize("sector", [[30, 75], [150, -150], [-170, 170], [0, 360], [350, 10]])
def test_a_sector_is_where_the_beams_point(rig_of, ground_mesh, model, sector):
    """Whichever way the sensor turns and whatever its channels' offsets."""
    low, high = (float(value) for value in sector)
    one, found = dead(rig_of, ground_mesh, {"sector_deg": [low, high]}, model=model)
    beams = beam_directions(one.sensor, one.columns)
    middle = np.radians(low + ((high - low) % 360.0 or 360.0) / 2)
    half = np.radians(((high - low) % 360.0 or 360.0) / 2)
    flat = beams[..., :2] / np.linalg.norm(beams[..., :2], axis=-1, keepdims=True)
    off = np.arccos(np.clip(flat @ [np.cos(middle), np.sin(middle)], -1, 1))
    clear = np.abs(off - half) > 1e-6
    np.testing.assert_array_equal(found[clear], (off <= half)[clear])
    assert found.shape == (one.sensor.channels, one.columns)


def test_channels_and_their_spans(rig_of, ground_mesh):
    _, found = dead(rig_of, ground_mesh, {"channels": [1, "4-6"]})
    assert np.flatnonzero(found.all(axis=1)).tolist() == [1, 4, 5, 6]
    assert found.sum() == 4 * found.shape[1]


def test_a_channel_within_a_sector(rig_of, ground_mesh):
    one, both = dead(rig_of, ground_mesh, {"channels": [3], "sector_deg": [0.0, 90.0]})
    assert not np.delete(both, 3, axis=0).any()
    assert both[3].sum() == pytest.approx(one.columns / 4, abs=1)


def test_an_outage_has_a_time(rig_of, ground_mesh):
    outage = {"start_s": 2.0, "stop_s": 3.0}
    for time_s, fails in [(0.0, False), (1.9, False), (2.0, True), (2.9, True), (3.0, False)]:
        _, found = dead(rig_of, ground_mesh, outage, time_s)
        assert (found is not None) == fails
        assert not fails or found.all()


def test_a_channel_that_the_sensor_does_not_have(rig_of, ground_mesh):
    with pytest.raises(InputError, match="VLP-16 has no channel 16; expected 0 to 15") as error:
        dead(rig_of, ground_mesh, {"channels": ["10-16"]})
    assert error.value.place == "sensors[0].outages[0].channels"
