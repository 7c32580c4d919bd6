"""Beam directions against closed forms."""

import numpy as np
import pytest

from urbantwin.lidar import beam_azimuths, beam_directions, beam_elevations, sensor, sensor_names


@pytest.mark.parametrize("name", sensor_names())
def test_directions_are_unit_and_give_back_elevation_and_azimuth(name):
    lidar = sensor(name)
    columns = lidar.columns_options[0]
    directions = beam_directions(lidar, columns)
    assert directions.shape == (lidar.channels, columns, 3)
    assert np.abs(np.linalg.norm(directions, axis=-1) - 1).max() < 1e-12
    elevation = np.degrees(np.arcsin(directions[..., 2]))
    assert np.abs(elevation - lidar.elevation_deg[:, None]).max() < 1e-9
    # Undo the encoder's turn: what is left must be the channel's own offset at every column.
    azimuth = np.arctan2(directions[..., 1], directions[..., 0])
    encoder = -2 * np.pi * np.arange(columns) / columns  # all of them turn clockwise
    offset = np.angle(np.exp(1j * (azimuth - encoder)), deg=True)
    assert np.abs(offset - lidar.azimuth_offset_deg[:, None]).max() < 1e-9
    assert np.abs(azimuth - beam_azimuths(lidar, columns)).max() < 1e-9 or np.allclose(
        np.exp(1j * azimuth), np.exp(1j * beam_azimuths(lidar, columns))
    )


def test_first_column_looks_forward_and_a_clockwise_quarter_turn_looks_right():
    directions = beam_directions(sensor("VLP-16"), 1800)
    level = int(np.argmin(np.abs(sensor("VLP-16").elevation_deg - 1)))
    forward, right = directions[level, 0], directions[level, 450]
    one = np.radians(1.0)
    assert forward == pytest.approx([np.cos(one), 0, np.sin(one)])
    assert right == pytest.approx([0, -np.cos(one), np.sin(one)])


def test_azimuths_stay_in_one_turn_and_elevations_are_radians():
    lidar = sensor("OS1-128")
    azimuth = beam_azimuths(lidar)
    assert azimuth.shape == (128, 1024)
    assert azimuth.min() >= -np.pi
    assert azimuth.max() < np.pi
    assert beam_elevations(lidar).max() == pytest.approx(np.radians(lidar.elevation_deg.max()))


def test_no_columns_is_refused():
    with pytest.raises(ValueError, match="columns"):
        beam_directions(sensor("OS0-64"), 0)
