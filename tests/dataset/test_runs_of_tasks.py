"""How frames are handed to workers."""

import pytest

from urbantwin.dataset.workers import _runs


@pytest.mark.parametrize("workers", [2, 3, 16])
@pytest.mark.parametrize("frames", [0, 1, 5, 40, 200])
def test_every_frame_comes_once_in_order_and_few_frames_reach_all_workers(
    workers: int, frames: int
) -> None:
    runs = list(_runs(iter(range(frames)), frames, workers))  # type: ignore[arg-type]
    assert [one for run in runs for one in run] == list(range(frames))
    assert all(runs)
    assert len(runs) >= min(workers, frames)
    # When they are at their ends nobody holds many that others wait for.
    assert all(len(run) == 1 for run in runs[-workers:])
