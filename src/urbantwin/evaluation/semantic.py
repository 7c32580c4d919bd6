"""Evaluation of semantic classes of points: intersection over union per class, and its mean.

As in SemanticKITTI (Behley et al. 2019), values are over the points of all frames; unlabelled
points do not count. The mean is over the classes with labelled points.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import read_semantic
from urbantwin.fidelity.readers import Recording
from urbantwin.progress import Progress, each
from urbantwin.taxonomy import semantic_classes

__all__ = ["confusion_of", "judged_semantic"]

#: Labels that do not count: unlabelled, outlier.
_NOTHING = (0, 1)
_IDS = 256


def confusion_of(
    labelled: NDArray[np.int64], said: NDArray[np.int64], looked_at: NDArray[np.bool_] | None = None
) -> NDArray[np.int64]:
    """Return the confusion matrix (256, 256): labelled classes (rows), predicted (columns).

    Args:
        labelled: (N,) labelled ids.
        said: (N,) predicted ids.
        looked_at: (N,) mask of the points that count; all if not given.
    """
    counts = (labelled < _IDS) & (said < _IDS) & ~np.isin(labelled, _NOTHING)
    if looked_at is not None:
        counts &= looked_at
    return np.bincount(labelled[counts] * _IDS + said[counts], minlength=_IDS**2).reshape(
        _IDS, _IDS
    )


def judged_semantic(
    detections: Path, recording: Recording, tell: Progress
) -> dict[str, Any] | None:
    """Return the values of semantic classes; None without labels or predictions.

    Points that the model did not process (beyond its range, far above the ground) do not count;
    ``looked_at`` is the share of labelled points that were processed.

    Args:
        detections: a folder of detections.
        recording: the labelled frames.
        tell: called with the fraction done.

    Raises:
        InputError: the predictions are of another number of points.
    """
    if not (detections / "semantic").is_dir():
        return None
    confusion = np.zeros((_IDS, _IDS), np.int64)
    frames = points = 0
    for number in each(range(len(recording)), tell, "classes of points"):
        frame = recording.read(number)
        if frame.semantic is None:
            continue
        said = read_semantic(detections, frame.name, len(frame.points))
        if said is None:
            continue
        frames += 1
        points += int((~np.isin(frame.semantic, _NOTHING)).sum())
        confusion += confusion_of(frame.semantic, said, said > 0)
    if not frames:
        return None
    right = np.diag(confusion)
    labelled, said_of = confusion.sum(axis=1), confusion.sum(axis=0)
    union = np.maximum(labelled + said_of - right, 1)
    classes = {
        one.name: {
            "points": int(labelled[one.id]),
            "iou": float(right[one.id] / union[one.id]),
            "recall": float(right[one.id] / labelled[one.id]),
        }
        for one in semantic_classes().values()
        if labelled[one.id]
    }
    return {
        "frames": frames,
        "mean_iou": float(np.mean([one["iou"] for one in classes.values()] or [0.0])),
        "right": float(right.sum() / max(int(confusion.sum()), 1)),
        "looked_at": float(confusion.sum() / max(points, 1)),
        "classes": classes,
    }
