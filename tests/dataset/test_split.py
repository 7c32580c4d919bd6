"""The split of frames into training and validation."""

import pytest

from urbantwin.dataset import split_frames


@pytest.mark.parametrize("count", [2, 3, 10, 11, 600])
def test_one_cut_in_time_gives_a_fifth_to_validation(count):
    names = [f"{index:06d}" for index in range(count)]
    train, val = split_frames(names)
    assert train + val == names
    assert train
    assert val
    assert abs(len(val) - count / 5) <= 0.6


def test_a_single_frame_trains():
    assert split_frames(["000000"]) == (["000000"], [])
