"""What always stands at a fixed site and is taken for people or riders: posts, signs, hedges.

A detector sees one frame and cannot know it; whoever has frames of another hour from the same
sensors can: nobody stands at the same place in half of them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.detections.detections import Detections
from urbantwin.errors import InputError

__all__ = ["FEWEST_FRAMES", "frames_about", "standing_places", "without_standing"]

#: Classes that thin things are taken for. A parked car is a car, however long it stands.
_SLIGHT = ("bicycle", "motorcycle", "pedestrian")
#: Detections this near to each other are of one thing, metres: half a person's width, and what the
#: centre of a box varies by.
_APART_M = 0.4
#: A thing stands where it is found in this share of the frames,
_OFTEN = 0.5
#: of no fewer than so many.
FEWEST_FRAMES = 10


def frames_about(
    places: NDArray[np.float64], frame: NDArray[np.int64], apart_m: float
) -> tuple[list[list[int]], NDArray[np.int64]]:
    """Return which of N places lie about each, itself too, and in how many frames they are (N,).

    Args:
        places: (N, 2) x and y.
        frame: (N,) of each.
        apart_m: places no farther from each other are one.
    """
    near = cKDTree(places).query_ball_point(places, apart_m).tolist() if len(places) else []
    return near, np.array([len(np.unique(frame[one])) for one in near], np.int64)


def standing_places(found: Detections, file: Path | None = None) -> NDArray[np.float64]:
    """Return places (K, 2), x and y, where what is found stands all the time.

    Args:
        found: in frames of sensors that stand still, over longer than anybody stays at one place.
        file: where it was read from, for errors.

    Raises:
        InputError: there are too few frames to tell.
    """
    count = len(found.frames)
    if count < FEWEST_FRAMES:
        raise InputError(
            f"{count} frames do not tell what always stands there",
            file=file,
            expected=f"at least {FEWEST_FRAMES}, over longer than anybody stays at one place",
        )
    slight = found.only([name in _SLIGHT for name in found.class_names])
    places = slight.box[:, :2]
    _, seen_in = frames_about(places, slight.frame, _APART_M)
    return np.asarray(places[seen_in >= _OFTEN * count])


def without_standing(found: Detections, places: NDArray[np.float64]) -> Detections:
    """Return detections without those of people and riders at places of `standing_places`.

    Args:
        found: in frames of the same sensors, in the same frame of reference.
        places: (K, 2) x and y.
    """
    if not len(places) or not len(found):
        return found
    away, _ = cKDTree(places).query(found.box[:, :2])
    slight = np.array([name in _SLIGHT for name in found.class_names], bool)
    return found.only(~slight | (away > _APART_M))
