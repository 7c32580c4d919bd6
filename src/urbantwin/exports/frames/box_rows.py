"""Boxes of a frame as rows of names and values, for formats with free fields."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from urbantwin.dataset.reading.columns import BOX, VELOCITY
from urbantwin.dataset.reading.objects import LabelledObjects

__all__ = ["BOX_KEYS", "box_rows"]

#: The keys of a row, in its order; see docs/reference/labels.md.
BOX_KEYS = (
    *("track", "class", *BOX, *VELOCITY, "num_points", "num_points_alone", "occlusion"),
    *("truncation", "difficulty", "ignored", "observed_s", "parked", "towed_by"),
)


def box_rows(boxes: LabelledObjects) -> Iterator[dict[str, Any]]:
    """Yield a row per box, in the points' frame; unknown values are ``None``."""
    hidden = np.isnan(boxes.occlusion)
    columns = (
        boxes.track.tolist(),
        boxes.class_name.tolist(),
        *boxes.box.T.tolist(),
        *boxes.velocity.T.tolist(),
        boxes.num_points.tolist(),
        boxes.num_points_alone.tolist(),
        [None if no else value for no, value in zip(hidden, boxes.occlusion.tolist(), strict=True)],
        boxes.truncation.tolist(),
        [text or None for text in boxes.difficulty.tolist()],
        [text or None for text in boxes.ignored.tolist()],
        boxes.observed_s.tolist(),
        boxes.parked.tolist(),
        [None if track < 0 else track for track in boxes.towed_by.tolist()],
    )
    for values in zip(*columns, strict=True):
        yield dict(zip(BOX_KEYS, values, strict=True))
