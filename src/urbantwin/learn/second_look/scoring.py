"""What was found, scored anew by the second look."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from urbantwin.learn.decoding import Found
from urbantwin.learn.second_look.crop import LOOKED_AT, crops_of
from urbantwin.learn.second_look.network import SecondLook

__all__ = ["looked_again", "looked_at"]

#: Boxes that are looked at together.
_TOGETHER = 512


def looked_at(found: Found, classes: Sequence[str]) -> NDArray[np.int64]:
    """Return the numbers of boxes whose class is looked at again.

    Args:
        found: by the detector.
        classes: of the detector.
    """
    of_class = np.array([name in LOOKED_AT for name in classes], bool)
    return np.flatnonzero(of_class[found.number])


def looked_again(
    look: SecondLook,
    found: Found,
    points: NDArray[np.float32],
    sensors: NDArray[np.float64],
    classes: Sequence[str],
    device: str,
) -> Found:
    """Return what was found, the likeliest first, as the second look has it.

    The score of a box that is looked at is the geometric mean of the detector's and its own.

    Args:
        look: in evaluation mode, on the device.
        found: by the detector, on level ground.
        points: (N, 3+) of the level frame.
        sensors: (S, 3) in it.
        classes: of the detector.
        device: of torch.
    """
    mine = looked_at(found, classes)
    crops = crops_of(points, sensors, found.only(mine))
    score = found.score.copy()
    for first in range(0, len(mine), _TOGETHER):
        rows = slice(first, first + _TOGETHER)
        given = (
            torch.from_numpy(one[rows]).to(device)
            for one in (crops.points, crops.told, crops.number)
        )
        with torch.inference_mode():
            likely = torch.sigmoid(look(*given)).double().cpu().numpy()
        score[mine[rows]] = np.sqrt(score[mine[rows]] * likely)
    order = np.argsort(-score, kind="stable")
    return Found(found.box[order], found.number[order], score[order])
