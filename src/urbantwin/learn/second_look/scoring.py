"""Rescoring of detections by the second stage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from urbantwin.learn.decoding import Found
from urbantwin.learn.second_look.crop import LOOKED_AT, crops_of
from urbantwin.learn.second_look.network import SecondLook

__all__ = ["looked_again", "looked_at"]

#: Boxes in a batch.
_TOGETHER = 512


def looked_at(found: Found, classes: Sequence[str]) -> NDArray[np.int64]:
    """Return the rows of boxes whose class is rescored.

    Args:
        found: detected boxes.
        classes: classes of the detector.
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
    """Return detections rescored by the second stage, by descending score.

    The new score is the geometric mean of the scores of both stages.

    Args:
        look: second stage in evaluation mode, on the device.
        found: detected boxes in the levelled frame.
        points: (N, 3+) points of the levelled frame.
        sensors: (S, 3) positions of the sensors in it.
        classes: classes of the detector.
        device: torch device.
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
