"""Reported azimuths against the steps of the sensors' packets."""

import numpy as np
import pytest

from urbantwin.lidar import beam_directions, sensor
from urbantwin.lidar.beams import as_reported, encoder_errors


@pytest.mark.parametrize(("name", "columns"), [("HDL-32E", 2170), ("HDL-64E", 2083)])
def test_azimuths_are_whole_steps_and_half_a_step_off_at_most(name, columns):
    one = sensor(name)
    true = beam_directions(one, columns)
    told = as_reported(true.reshape(-1, 3), one, columns).reshape(true.shape)
    # Seen from above without its channel's offset, clockwise, in hundredths of a degree.
    flat = np.degrees(np.arctan2(told[..., 1], told[..., 0])) - one.azimuth_offset_deg[:, None]
    steps = -flat * 100
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    apart = np.degrees(np.arccos(np.clip((told * true).sum(-1), -1, 1)))
    assert 0.003 < apart.max() <= 0.005 + 1e-6
    np.testing.assert_allclose(told[..., 2], true[..., 2])


@pytest.mark.parametrize(("name", "columns"), [("OS1-128", 2048), ("VLP-32C", 1800)])
def test_columns_on_whole_steps_are_told_exactly(name, columns):
    assert not encoder_errors(sensor(name), columns).any()


def test_frames_tell_azimuths_in_steps_unless_turned_off(ground_mesh, rig_of):
    from urbantwin.lidar import Scanner

    world = ground_mesh(half=60.0)
    off_noise = {"noise": False, "dropout": False, "rolling_shutter": False}
    azimuths = []
    for quantised in (True, False):
        effects = {**off_noise, "quantisation": quantised}
        rig = rig_of(world, {"model": "HDL-32E", "effects": effects}, frame="sensor")
        points = Scanner(world, rig, 1).scan(0, []).points.astype(float)
        azimuths.append(np.degrees(np.arctan2(points[:, 1], points[:, 0])) * 100)
    away = [np.abs(one - np.rint(one)) for one in azimuths]
    assert np.percentile(away[0], 99) < 0.02
    assert np.percentile(away[1], 50) > 0.1
