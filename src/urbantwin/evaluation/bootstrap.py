"""Confidence intervals by resampling frames in moving blocks (Künsch 1989)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.evaluation.truth import Truth

__all__ = ["SEED", "block_length", "drawn_frames", "interval", "same_objects"]

SEED = 19
#: Minimum number of blocks in a recording; fewer do not represent other hours and places.
_FEWEST_BLOCKS = 4
#: Stopped objects are labelled within this distance in the next frame, metres.
_AT_REST_M = 0.5
#: Share of boxes of repeated objects above which a doubt is reported.
_OFTEN = 0.1


def same_objects(truth: Truth) -> NDArray[np.int64]:
    """Return an object number (L,) for every label, equal for labels of the same object.

    Objects are identified by track. Without tracks, labels of one class at the same position in
    consecutive frames are the same object.
    """
    if (truth.track >= 0).any():
        found = truth.track.copy()
        alone = found < 0
        found[alone] = -1 - np.arange(int(alone.sum()))
        return found
    number = np.arange(len(truth))
    for frame in range(1, len(truth.frames)):
        before, here = (np.flatnonzero(truth.frame == k) for k in (frame - 1, frame))
        if not len(before) or not len(here):
            continue
        away, nearest = cKDTree(truth.box[before, :2]).query(truth.box[here, :2])
        for row, old in zip(
            here[away <= _AT_REST_M], before[nearest[away <= _AT_REST_M]], strict=True
        ):
            if truth.class_names[row] == truth.class_names[old]:
                number[row] = number[old]
    return number


def block_length(truth: Truth) -> tuple[int, str | None]:
    """Return the number of consecutive frames drawn together, and a doubt about it or None.

    The length is the median number of frames that show one object, weighted by boxes: frames with
    the same objects are not independent.
    """
    count = len(truth.frames)
    if count < 2 or not len(truth):
        return 1, None
    _, number = np.unique(same_objects(truth), return_inverse=True)
    first = np.full(number.max() + 1, count)
    last = np.zeros(number.max() + 1, np.int64)
    np.minimum.at(first, number, truth.frame)
    np.maximum.at(last, number, truth.frame)
    span = int(np.ceil(np.median((last - first + 1)[number])))
    most = max(count // _FEWEST_BLOCKS, 1)
    length = min(span, most)
    again = 1 - len(first) / len(truth)
    if span <= most and again < _OFTEN:
        return length, None
    return length, (
        f"The {len(truth)} labelled boxes are of {len(first)} objects, some of them the same in "
        "several frames. Intervals are those of this hour and place, too narrow for others."
    )


def drawn_frames(count: int, length: int, draws: int) -> NDArray[np.int64]:
    """Return how often each frame is drawn (draws, count), in blocks that wrap at the end."""
    random = np.random.default_rng([SEED, count, length])
    blocks = -(-count // length)
    starts = random.integers(0, count, (draws, blocks))
    rows = (starts[..., None] + np.arange(length)).reshape(draws, -1)[:, :count] % count
    often = np.zeros((draws, count), np.int64)
    np.add.at(often, (np.arange(draws)[:, None], rows), 1)
    return often


def interval(values: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the 2.5th and 97.5th percentile of draws; None with fewer than 20 values."""
    known = values[~np.isnan(values)]
    if len(known) < 20:
        return None
    low, high = np.percentile(known, [2.5, 97.5])
    return float(low), float(high)
