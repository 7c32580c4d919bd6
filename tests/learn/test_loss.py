"""What a training is told to be wrong, against closed forms."""

import numpy as np
import pytest

torch = pytest.importorskip(
    "torch", reason="torch is not installed: pip install 'urbantwin[learn]'"
)

from urbantwin.learn.grid import Grid  # noqa: E402
from urbantwin.learn.heads import OUTPUTS, class_heads  # noqa: E402
from urbantwin.learn.loss import detection_loss, target_arrays, targets_in  # noqa: E402
from urbantwin.learn.targets import targets_of  # noqa: E402

HEADS = class_heads(("pedestrian",))
GRID = Grid(0.0, 0.0, 0.4, 64)


def centres_loss(people: list[int], surely: float = -30.0) -> float:
    """The loss of centres of samples with some people each, 2 m apart.

    Half of what is said of their cells is right; elsewhere ``surely`` is said of the first cell.
    """
    samples, said = [], torch.full((len(people), OUTPUTS, 64, 64), -30.0)
    for sample, count in enumerate(people):
        at = np.arange(count)
        middles = np.column_stack([2.2 + 2 * (at % 10), 2.2 + 2 * (at // 10)])
        boxes = np.column_stack([middles, np.tile([0.9, 0.6, 0.6, 1.8, 0.0], (count, 1))])
        samples.append(targets_of(boxes, np.zeros(count, np.int64), GRID, HEADS))
        column, row = np.floor(middles.T / 0.4).astype(int)
        said[sample, 0, row, column] = 0.0
        said[sample, 0, 63, 63] = surely
    batch = {key: torch.from_numpy(one) for key, one in target_arrays(samples).items()}
    loss = detection_loss([said], targets_in(batch, 1), HEADS, [5.0])
    return float(loss[0, 0])


def test_a_crowd_counts_as_much_as_one_person() -> None:
    right = 0.25 * np.log(2)  # (1 - p)^2 times -log p with p = 0.5
    assert centres_loss([1]) == pytest.approx(right, rel=1e-5)
    assert centres_loss([30]) == pytest.approx(right, rel=1e-5)
    assert centres_loss([30, 1]) == pytest.approx(right, rel=1e-5)


def test_who_is_seen_where_nobody_is_counts_whoever_is_in_other_samples() -> None:
    wrong = 0.25 * np.log(2) / 2
    for crowd in (1, 30):
        more = centres_loss([crowd, 0], surely=0.0) - centres_loss([crowd, 0])
        own = wrong / crowd + wrong
        assert more == pytest.approx(own, rel=1e-4)
