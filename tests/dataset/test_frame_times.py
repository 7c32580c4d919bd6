"""Which frames of a motion are recorded."""

import numpy as np
import pytest

from urbantwin.dataset.recording import frame_times
from urbantwin.errors import InputError

STEPS = np.arange(0, 10.01, 0.1)


def test_each_tenth_frame_is_the_one_it_is_among_all():
    every = frame_times(10.0, 1.25, 9.0, STEPS)
    some = frame_times(10.0, 1.25, 9.0, STEPS, every=10)
    assert list(some) == [20, 30, 40, 50, 60, 70, 80, 90]
    assert all(every[number] == time for number, time in some.items())
    with pytest.raises(InputError, match=r"no frame at 0\.1 Hz lies in 1 to 9 s"):
        frame_times(10.0, 1.0, 9.0, STEPS, every=100)
    with pytest.raises(InputError, match="every"):
        frame_times(10.0, 1.0, 9.0, STEPS, every=0)
