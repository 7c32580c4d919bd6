"""How fast sensors turn and how many columns they then have, as the makers' tables say."""

import pytest

from urbantwin.errors import InputError
from urbantwin.lidar import place_rig, sensor, sensor_names
from urbantwin.lidar.sensor_options import columns_at, spin_of
from urbantwin.site.rig import RigSpec


@pytest.mark.parametrize(
    ("model", "rate_hz", "columns"),
    [
        # VLP-16 User Manual, 8.3: 0.1, 0.2 and 0.4 degrees at 5, 10 and 20 turns per second.
        ("VLP-16", 5, 3600),
        ("VLP-16", 10, 1800),
        ("VLP-16", 20, 900),
        # Between them, a sequence of 55.296 us goes into a turn of 0.125 s 2261 times.
        ("VLP-16", 8, 2261),
        # The Ousters' modes: 1024 columns at both rates.
        ("OS1-128", 10, 1024),
        ("OS1-128", 20, 1024),
        ("OS1-128", 15, 1024),
        ("Pandar64", 20, 900),
        # Not published: no more firings per second than in the mode that is known.
        ("JT16", 20, 900),
        ("XT32M2X", 20, 1000),
    ],
)
def test_columns_go_with_the_rate(model, rate_hz, columns):
    assert columns_at(sensor(model), rate_hz) == columns


@pytest.mark.parametrize("model", sensor_names())
def test_at_its_own_rate_a_sensor_has_its_own_columns(model):
    one = sensor(model)
    assert columns_at(one, one.rate_hz) == one.columns
    assert 1 <= columns_at(one, 5.0) <= 65535


def test_a_sensor_turns_as_often_as_its_rig_has_frames_if_it_can():
    one = sensor("OS1-128")
    assert [spin_of(one, rate) for rate in (5.0, 7.5, 10.0, 20.0)] == [5.0, 7.5, 10.0, 20.0]
    assert [spin_of(one, rate) for rate in (0.1, 1.0, 2.0)] == [10.0] * 3


def test_frames_now_and_then_are_single_turns(street):
    def placed(frames_per_second, **own):
        one = {"name": "a", "model": "VLP-16", "east_m": 0.0, "north_m": 0.0, "height_m": 5.0}
        spec = RigSpec.model_validate({"rate_hz": frames_per_second, "sensors": [{**one, **own}]})
        return place_rig(spec, street).sensors[0]

    rare = placed(2.0)
    assert (rare.turns_per_second, rare.frame_window_s, rare.columns) == (10.0, 0.1, 1800)
    for own in (10.0, 20.0):  # its own rate is how fast it turns, not how much a frame holds
        told = placed(1.0, rate_hz=own)
        assert (told.turns_per_second, told.frame_window_s) == (own, 1 / own)
    swift = placed(20.0)
    assert (swift.turns_per_second, swift.frame_window_s, swift.columns) == (20.0, 0.05, 900)
    with pytest.raises(InputError, match=r"^rate_hz: VLP-16 does not turn 30 times a second"):
        placed(30.0)
    assert placed(30.0, rate_hz=20.0).turns_per_second == 20.0
    # Who asks for a rate of its own gets all of its turns.
    asked = placed(10.0, rate_hz=20.0)
    assert (asked.turns_per_second, asked.frame_window_s, asked.columns) == (20.0, 0.1, 900)
    assert placed(10.0, rate_hz=20.0, columns=1800).columns == 1800
