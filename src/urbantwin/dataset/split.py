"""Which frames train and which validate."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["split_frames"]

VALIDATION_SHARE = 0.2


def split_frames(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the names of the training frames and of the validation frames.

    The last fifth of the time validates. One cut, not a draw per frame: frames a tenth of a
    second apart show the same actors in nearly the same places, and a draw would put one in the
    training set and its twin in the validation set.

    Args:
        names: of all frames, in the order of time. A single frame trains.
    """
    count = max(1, round(len(names) * VALIDATION_SHARE)) if len(names) > 1 else 0
    cut = len(names) - count
    return list(names[:cut]), list(names[cut:])
